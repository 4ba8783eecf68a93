"""Options and arguments that several verbs have."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gsid.cli.files_in_use import FILE_OUTPUT, INPUT, OUTPUT, RECORD, FilesInUse, Library
from gsid.cli.option_types import Band, FiniteRange, Order, Scale, UnitOf, Value

if TYPE_CHECKING:
    from gsid.records.mimo import MimoRecord
    from gsid.records.record import Record


class UsageError(click.UsageError):
    """A usage error of the running command, with a remedy of its own."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message, click.get_current_context())
        self.hint = hint


def add_options(options: Sequence[Callable]) -> Callable:
    """Decorator that adds several options in this order."""
    return lambda command: functools.reduce(lambda c, option: option(c), reversed(options), command)


def _with_default(text: str, default: str) -> str:
    """Help text with a default in words."""
    return f"{text} [default: {default}]" if default else text


SEED = click.IntRange(0, 2**64 - 1)
LIMIT = FiniteRange(0, min_open=True)


def rate_option(shown_default: str = "", **how: Any) -> Callable:
    """--fs."""
    text = _with_default("Sample rate.", shown_default)
    rate = click.FloatRange(0, min_open=True)
    return click.option("--fs", "fs_hz", metavar="HZ", type=rate, help=text, **how)


def period_option(shown_default: str = "", **how: Any) -> Callable:
    """--period."""
    text = _with_default("Samples in a period.", shown_default)
    return click.option("--period", metavar="N", type=click.IntRange(1), help=text, **how)


def periods_option(default: int) -> Callable:
    """--periods."""
    text = _with_default("Periods to measure.", str(default))
    return click.option("--periods", metavar="P", type=click.IntRange(1), default=default, help=text)


def amplitude_option(shown_default: str, **how: Any) -> Callable:
    """--amplitude."""
    text = _with_default("Amplitude of the command; of a multisine, of its first line.", shown_default)
    return click.option("--amplitude", metavar="A", type=float, help=text, **how)


READING_OPTIONS = (
    click.option("--u", "u_name", metavar="NAME", help="Column or array of the input. [default: u]"),
    click.option("--y", "y_name", metavar="NAME", help="Column or array of the output. [default: y]"),
    rate_option("as the file states"),
    period_option("detected"),
    click.option(
        "--settle",
        metavar="N",
        type=click.IntRange(0),
        help="Samples to discard at the start. [default: detected]",
    ),
    click.option(
        "--hold",
        type=click.Choice(["zoh", "none"]),
        help="Whether u is held over each sample (zoh). [default: as the file states, otherwise both are"
        " tried]",
    ),
    click.option(
        "--unit",
        "units",
        metavar=UnitOf.name,
        type=UnitOf(),
        multiple=True,
        help="Unit of the column of the input or the output, after its --factor. May be repeated. [default:"
        " as the file states]",
    ),
    click.option(
        "--factor",
        "factors",
        metavar=Value.name,
        type=Value(),
        multiple=True,
        help="Factor by which a column is multiplied, for example y=57.29578 for deg/s. May be repeated."
        " [default: 1]",
    ),
)
HOW_READ = (
    "reference",
    "u_name",
    "y_name",
    "fs_hz",
    "period",
    "settle",
    "hold",
    "units",
    "factors",
    "band",
)  # options that a suggested command repeats


def _print_json_alone(ctx: click.Context, param: click.Parameter, value: bool) -> bool:
    if value:
        FilesInUse.of(ctx).stream("--json", ctx)
    return value


json_option = click.option("--json", "as_json", is_flag=True, callback=_print_json_alone, help="Print JSON.")


reference_option = click.option(
    "--r",
    "reference",
    metavar="NAME",
    help="Column or array of the reference, for a closed loop. [default: open loop]",
)


output_is_option = click.option(
    "--output",
    "y_is",
    type=click.Choice(["rate", "angle", "acceleration"]),
    help="What y is. [default: by its unit, else inferred from the data]",
)
inertia_option = click.option(
    "--inertia",
    "inertia_kg_m2",
    metavar="KG_M2",
    type=LIMIT,
    help="Inertia of the axis [kg m^2]: also print parameters as torques, and keep it in the model.",
)
noise_model_option = click.option(
    "--noise-model", metavar="FILE.json", type=OUTPUT, help="Write the noise spectrum and disturbances."
)
found_model_option = click.option(
    "-o", "path", metavar="M.json", type=OUTPUT, help="Write the model that was found."
)


def band_option(text: str) -> Callable:
    """--band with the help text of a verb."""
    return click.option("--band", type=Band(), help=text)


MULTISINE_OPTIONS = (
    click.option(
        "--lines",
        type=click.Choice(["full", "odd", "odd-random", "quasi-log"]),
        default="full",
        show_default=True,
        help="Lines to excite: every line, odd lines, odd lines with random gaps, or odd lines spaced "
        "evenly in log f.",
    ),
    click.option(
        "--shape",
        metavar="DB_PER_DECADE",
        type=float,
        default=0.0,
        help="Slope of the amplitude over frequency: 0 is flat, -10 falls as 1/sqrt(f). [default: 0]",
    ),
    click.option(
        "--phases",
        type=click.Choice(["schroeder", "random"]),
        default="schroeder",
        show_default=True,
        help="Low crest factor, or another realisation for each seed.",
    ),
    click.option(
        "--seed",
        metavar="N",
        type=SEED,
        default=0,
        help="Random seed of the phases and of the gaps of odd-random. [default: 0]",
    ),
    click.option(
        "--offset-phase",
        metavar="RAD",
        type=float,
        default=0.0,
        help="Add this to every phase: it moves the mean position; the thesis has 0.2793. [default: 0]",
    ),
)


def multisine_options(command: Callable) -> Callable:
    """Options of verbs that make a multisine; the command receives `shape`, arguments of Multisine.design."""

    @functools.wraps(command)
    def with_shape(
        *args: object, lines: str, shape: float, phases: str, seed: int, offset_phase: float, **kwargs: object
    ) -> object:
        design = {"grid": lines, "phases": phases, "seed": seed, "shape_db_per_decade": shape}
        design["offset_phase_rad"] = offset_phase
        return command(*args, shape=design, **kwargs)

    return add_options(MULTISINE_OPTIONS)(with_shape)


def held_out_option(shown_default: str = "") -> Callable:
    """--held-out."""
    text = "Judge the model on this record, which was not used to fit or to choose it. May be repeated."
    return click.option(
        "--held-out", metavar="REC", multiple=True, type=RECORD, help=_with_default(text, shown_default)
    )


order_option = click.option(
    "--order",
    type=Order(may_be_auto=True),
    help="Numbers of poles and zeros, for example 4/3. auto chooses the order of least MDL.",
)
limit_command_option = click.option("--limit-command", metavar="C", type=LIMIT, help="Limit of |command|.")
limit_travel_option = click.option(
    "--limit-travel-deg",
    metavar="D",
    type=LIMIT,
    help="Limit of the travel to each side of its middle [deg].",
)


def plant_option(text: str) -> Callable:
    """--model of verbs that need a stack of effects."""
    return click.option("--model", "model_path", metavar="M.json", type=INPUT, required=True, help=text)


scale_option = click.option(
    "--scale",
    metavar=Scale.name,
    type=Scale(),
    help="Unit of the command: 179=10V if 179 on the line is 10 V. Amplitude, limits and record are then"
    " in V. [default: as on the line]",
)


def library_option(text: str, name: str, *, multiple: bool) -> Callable:
    """--library with the help text of a verb."""
    return click.option("--library", name, metavar=Library.name, type=Library(), multiple=multiple, help=text)


def alpha_option(default: float) -> Callable:
    """--alpha."""
    return click.option(
        "--alpha",
        metavar="P",
        type=click.FloatRange(0, 1, min_open=True, max_open=True),
        default=default,
        show_default=True,
        help="Significance level: rate of false alarms.",
    )


def reading_options(command: Callable) -> Callable:
    """Options of verbs that read records; the command receives `read`, a function from paths to records."""

    @functools.wraps(command)
    def with_reader(
        *args: object,
        u_name: str | None,
        y_name: str | None,
        fs_hz: float | None,
        period: int | None,
        settle: int | None,
        hold: str | None,
        units: Sequence[tuple[str, str]],
        factors: Sequence[tuple[str, float]],
        **kwargs: object,
    ) -> object:
        def read(
            paths: Sequence[str], *, matrix: bool = False, **how: bool
        ) -> list[Record] | list[MimoRecord]:
            from gsid.records.files import read_record

            given = {"fs_hz": fs_hz, "period": period, "settle": settle, "hold": hold}
            given |= {"units": dict(units), "factors": dict(factors)}
            if matrix and "," in f"{u_name}{y_name}":
                from gsid.records.mimo import read_mimo_record

                names = [(name or default).split(",") for name, default in ((u_name, "u"), (y_name, "y"))]
                return [read_mimo_record(path, *names, **given) for path in paths]
            return [read_record(path, u=u_name, y=y_name, **given, **how) for path in paths]

        return command(*args, read=read, **kwargs)

    return add_options(READING_OPTIONS)(with_reader)


def record_options(command: Callable, *, matrix: bool = False) -> Callable:
    """Arguments and options of verbs that read records; the command receives `records`, already read.

    With `matrix` several names in --u or --y give records of several inputs and outputs.
    """

    @functools.wraps(command)
    def with_records(
        *args: object, records: Sequence[str], read: Callable[..., list], **kwargs: object
    ) -> object:
        return command(*args, records=read(records, matrix=matrix), **kwargs)

    return records_argument(reading_options(with_records))


experiment_options = functools.partial(record_options, matrix=True)


PICTURES = (".png", ".svg", ".pdf", ".json")


def picture_option(command: Callable) -> Callable:
    """--plot, whose kind of file is checked before the work begins."""

    @functools.wraps(command)
    def with_picture(*args: object, picture: str | None, **kwargs: object) -> object:
        if picture and Path(picture).suffix.lower() not in PICTURES:
            raise click.UsageError(f"--plot draws {', '.join(PICTURES)} only", click.get_current_context())
        return command(*args, picture=picture, **kwargs)

    text = "Draw the result to .png, .svg, .pdf, or as a plotly figure to .json."
    return click.option("--plot", "picture", metavar="FILE", type=FILE_OUTPUT, help=text)(with_picture)


def records_argument(command: Callable) -> Callable:
    """REC..., at least one."""
    return click.argument("records", metavar="REC...", nargs=-1, required=True, type=RECORD)(command)


@contextlib.contextmanager
def options_as_arguments() -> Iterator[None]:
    """Turn a ValueError or TypeError of the library into a usage error: its argument came from an option."""
    from gsid.base.errors import InputError

    try:
        yield
    except InputError:
        raise
    except (ValueError, TypeError) as error:
        raise click.UsageError(str(error), click.get_current_context()) from error


def is_given(context: click.Context, name: str) -> bool:
    """Whether an option was given on the command line."""
    return context.get_parameter_source(name) is not click.core.ParameterSource.DEFAULT
