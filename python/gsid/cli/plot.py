"""gsid plot"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.files_in_use import INPUT
from gsid.cli.options import (
    LIMIT,
    PICTURES,
    UsageError,
    band_option,
    is_given,
    json_option,
    picture_option,
    reading_options,
    records_argument,
)
from gsid.cli.output import answered, draw, print_table

if TYPE_CHECKING:
    from gsid.models.piecewise import PiecewiseModel
    from gsid.models.rational import RationalModel
    from gsid.records.record import Record
    from gsid.response.frf import Frf


@click.command(short_help="Draw several responses and their uncertainties in one picture.")
@records_argument
@reading_options
@band_option("Lines from LO to HI [Hz] only.")
@click.option(
    "--legend",
    type=click.Choice(["file", "level"]),
    default="file",
    show_default=True,
    help="Name each response by its file, or by the rms of its input, the smallest first.",
)
@click.option(
    "--model",
    "model_paths",
    metavar="M.json",
    multiple=True,
    type=INPUT,
    help="Draw the error of this rational model beside the gain of one REC. May be repeated, for example for"
    " several orders.",
)
@click.option(
    "--leakage",
    metavar="PERIODS",
    type=LIMIT,
    help="Draw the spectrum of the input of one REC over one period and over so many, for example 1.2.",
)
@picture_option
@json_option
def plot(
    *,
    records: Sequence[str],
    read: Callable[[Sequence[str]], list[Record]],
    band: tuple[float, float] | None,
    legend: str,
    model_paths: Sequence[str],
    leakage: float | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Draw gain, phase and standard deviation of several responses, each with its own colour.

    Each REC is a record, or a response that `gsid frf -o FILE.csv` wrote. With --legend level, records of
    several levels are beside each other: an axis that is linear has the same response at all levels. The
    picture is responses.png unless --plot names another.
    """
    from gsid.plots.responses import model_errors, responses

    if leakage is not None:
        _refuse_with("--leakage", ("band", "legend", "model_paths"))
        _draw_leakage(records, read, leakage, picture or PICTURE)
        answered(as_json, lambda: {"picture": picture or PICTURE})
        return
    if model_paths and len(records) > 1:
        raise UsageError("--model is compared with one response", "name one REC")
    if model_paths:
        _refuse_with("--model", ("legend",))
    models = [(path, _transfer_function(path)) for path in model_paths]
    shown = [(path, _response(path, read, band)) for path in records]
    if legend == "level":
        shown.sort(key=lambda one: _rms(one[1]))
        shown = [(_level(one), one) for _, one in shown]
    _check_units([one for _, one in shown])
    draw(lambda: model_errors(shown[0][1], models) if models else responses(shown), picture or PICTURE)
    facts = [_facts(text, one) for text, one in shown]
    if answered(as_json, lambda: {"responses": facts, "picture": picture or PICTURE}):
        return
    names = ["response", "lines", "from [Hz]", "to [Hz]", "rms of u", "median sigma/|G| [dB]"]
    rows = [[str(one["name"]), str(one["lines"]), *(_number(one[key]) for key in NUMBERS)] for one in facts]
    print_table(Table(names, rows, left=["response"]))


def _refuse_with(option: str, names: Sequence[str]) -> None:
    """Refuse options that `option` does not use."""
    context = click.get_current_context()
    given = [
        param.opts[0]
        for param in context.command.params
        if param.name in names and is_given(context, str(param.name))
    ]
    if given:
        raise click.UsageError(f"{option} does not use {', '.join(given)}: leave it out", context)


def _draw_leakage(
    records: Sequence[str], read: Callable[[Sequence[str]], list[Record]], periods: float, picture: str
) -> None:
    from gsid.plots.leakage import leakage

    if len(records) > 1:
        raise UsageError("--leakage draws one record", "name one REC")
    (record,) = read(records)
    draw(lambda: leakage(record, periods), picture)


PICTURE = f"responses{PICTURES[0]}"
NUMBERS = ("f_lo_hz", "f_hi_hz", "rms_u", "sigma_db")


def _response(
    path: str, read: Callable[[Sequence[str]], list[Record]], band: tuple[float, float] | None
) -> Frf:
    from gsid.response.estimate import frf
    from gsid.response.files import is_response, read_response

    found = read_response(path) if is_response(path) else frf(read([path])[0])
    if band is None:
        return found
    use = (found.f_hz >= band[0]) & (found.f_hz <= band[1])
    if not use.any():
        from gsid.base.errors import InputError

        words = f"{found.f_hz[0]:g} to {found.f_hz[-1]:g} Hz"
        raise InputError("the response has no line in the band", path, words, "widen --band")
    return found.at(use)


def _transfer_function(path: str) -> RationalModel | PiecewiseModel:
    from gsid.base.errors import InputError
    from gsid.models.load import load_single
    from gsid.plant.model import PlantModel

    model = load_single(path)
    if isinstance(model, PlantModel):
        raise InputError(
            "the model is a stack of effects", path, None, "`gsid compare --plot` draws its errors"
        )
    return model


def _check_units(shown: Sequence[Frf]) -> None:
    from gsid.base.errors import InputError

    first = shown[0]
    for one in shown[1:]:
        if (one.u_unit, one.y_unit) != (first.u_unit, first.y_unit):
            units = f"{one.y_unit} per {one.u_unit}, and {first.y_unit} per {first.u_unit}"
            raise InputError("the responses have different units", one.name, units, "`gsid cut --scale`")


def _rms(one: Frf) -> float:
    """Of the excited lines of the input."""
    import numpy as np

    return float(np.sqrt(np.sum(np.abs(one.u) ** 2) / 2))


def _level(one: Frf) -> str:
    return f"{_rms(one):.3g} {one.u_unit} rms".replace("  ", " ")


def _number(value: object) -> str:
    return "unknown" if value is None else f"{value:.4g}"


def _facts(text: str, one: Frf) -> dict[str, object]:
    import numpy as np

    ratio = float(np.median(np.sqrt(one.var_g) / np.abs(one.g)))
    return {
        "name": text,
        "lines": len(one.f_hz),
        "f_lo_hz": float(one.f_hz[0]),
        "f_hi_hz": float(one.f_hz[-1]),
        "rms_u": _rms(one),
        "sigma_db": float(20 * np.log10(ratio)) if ratio > 0 else None,
    }
