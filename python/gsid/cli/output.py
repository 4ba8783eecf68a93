"""What the verbs print: tables and JSON on stdout, messages on stderr."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import shlex
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TextIO

import click

from gsid.base.tables import Table
from gsid.cli.options import HOW_READ

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.diagnosis.ladder import Ladder
    from gsid.plant.model import PlantModel
    from gsid.records.record import Record


def draw(figure: Callable[[], Figure], picture: str | None) -> None:
    """Draw and write a figure if --plot is given."""
    if picture:
        from gsid.base.files import write_atomically

        write_atomically(picture, lambda part: _write_figure(figure(), part))
        print_message(f"wrote {picture}")


def _write_figure(figure: Figure, part: Path) -> None:
    if part.suffix != ".json":
        figure.savefig(part)
        return
    from gsid.plots.interactive import interactive

    part.write_text(json.dumps(interactive(figure), allow_nan=False), encoding="utf-8")


def describe(records: Sequence[Record]) -> str:
    """Short name of the records, for messages."""
    return records[0].name if len(records) == 1 else f"{len(records)} records"


def is_terminal(stream: TextIO) -> bool:
    """Whether this stream is a terminal."""
    return stream.isatty()


TEXT_MOST = 1000  # characters of a text that is printed
MUCH_LEFT = 3.0  # cost per degree of freedom from which on the errors of a model are larger than noise
SOME_LEFT = 1.3  # and from which on they may be more than chance


def visible(text: str) -> str:
    """Text that is safe to print: names and values in files may hold control codes.

    Unprintable characters are escaped and long text is cut. A line break is kept if the next line is
    indented by four spaces, as in the errors of expressions.
    """
    if len(text) > TEXT_MOST:
        text = f"{text[:TEXT_MOST]} ... ({len(text)} characters)"
    if text.isprintable():
        return text
    lines = re.split(r"\n(?=    )", text)
    return "\n".join("".join(map(_visible_character, line)) for line in lines)


def _visible_character(char: str) -> str:
    return char if char.isprintable() else char.encode("unicode_escape", "surrogatepass").decode()


MESSAGES: list[str] = []  # printed on stderr by this command, without progress
PROGRESS = "GSID_PROGRESS"  # environment variable: "json" for a program that reads stderr


def prints_lines() -> bool:
    """Whether stderr is one JSON object a line: a message or a step."""
    return os.environ.get(PROGRESS) == "json"


def _print_line(values: dict) -> None:
    click.echo(json.dumps(values, allow_nan=False), err=True)


def print_step(text: str) -> None:
    """Print the step that begins; of a `ProgressText` its parts, for a program that reads stderr."""
    if not prints_lines():
        click.echo(f"-- {visible(text)}", err=True, color=False)
        return
    words, part = getattr(text, "words", text), getattr(text, "part", "")
    left = getattr(text, "seconds_left", None)
    _print_line({"step": part or None, "words": visible(words), "seconds_left": left})


def print_message(text: str, mark: str = "", colour: str = "") -> None:
    """Print a message on stderr, after a coloured mark if one is given."""
    message = visible(f"{mark} {text}" if mark else text)
    MESSAGES.append(message)
    if prints_lines():
        _print_line({"message": message})
        return
    mark = f"{click.style(mark, fg=colour, bold=colour == 'red')} " if mark else ""
    show = is_terminal(sys.stderr) and "NO_COLOR" not in os.environ
    click.echo(mark + visible(text), err=True, color=show)


@contextlib.contextmanager
def working(text: str) -> Iterator[None]:
    """Show a progress message while stderr is a terminal, or a program that reads steps."""
    if prints_lines():
        print_step(text)
        yield
        return
    if not is_terminal(sys.stderr):
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(text):
        yield


@contextlib.contextmanager
def steps_shown() -> Iterator[Callable[[str], None]]:
    """Show the steps of a long command: one line each, or the present one while stderr is a terminal."""
    if prints_lines() or not is_terminal(sys.stderr):
        yield print_step
        return
    from rich.console import Console
    from rich.text import Text

    with Console(stderr=True).status("") as status:
        yield lambda text: status.update(Text(text))


def print_json(values: dict) -> None:
    """Print one JSON object: arrays become lists, numbers that are not finite become null."""
    print(json.dumps(_plain(values), allow_nan=False))


class Answers(Protocol):
    """What keeps the answer of a command, as a study does."""

    def kept(self, answer: dict) -> dict:
        """Keep an answer of plain values; returns it as it is printed."""


def answered(as_json: bool, values: Callable[[], dict]) -> bool:
    """Print the answer of a command as `print_json` does if --json is given, and keep it in the study.

    Parameters
    ----------
    as_json : bool
    values : callable
        Called if the answer is printed or kept.

    Returns
    -------
    bool
        `as_json`.
    """
    study: Answers | None = click.get_current_context().find_root().obj
    if not as_json and study is None:
        return False
    answer = values()
    if study is not None:
        answer = study.kept(_plain(answer))
    if as_json:
        print_json(answer)
    return as_json


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, complex):
        return [_plain(value.real), _plain(value.imag)]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_table(table: Table) -> None:
    """Print a table on stdout: with rich on a terminal, as plain aligned columns elsewhere."""
    head, left = list(map(visible, table.head)), list(map(visible, table.left))
    shown = Table(head, [list(map(visible, row)) for row in table.rows], left)
    if is_terminal(sys.stdout):
        _print_on_terminal(shown)
    else:
        print(shown.text())


def _print_on_terminal(shown: Table) -> None:
    """Print a table as wide as the terminal, or row after row where a word would have to be cut."""
    from rich import table as rich_table
    from rich.console import Console
    from rich.text import Text  # as it stands: brackets, as in [Hz], are markup in a plain string

    console = Console()
    columns = list(zip(shown.head, *shown.rows, strict=True))
    widths = column_widths(columns, console.width - 3 * len(columns) - 1)  # less the borders
    if widths is None:
        for row in shown.rows:
            for name, cell in zip(shown.head, row, strict=True):
                print(_wrapped(f"{name}: {cell}", console.width))
            print()
        return
    drawn = rich_table.Table(header_style="bold")
    for name, width in zip(shown.head, widths, strict=True):
        drawn.add_column(Text(name), justify="left" if name in shown.left else "right", width=width)
    for row in shown.rows:
        drawn.add_row(*map(Text, row))
    console.print(drawn)


def column_widths(columns: Sequence[Sequence[str]], room: int) -> list[int] | None:
    """Widths of columns that wrap between words only: the widest columns are narrowed first.

    Parameters
    ----------
    columns : sequence of sequences of str
        Cells of each column, its name included.
    room : int
        Characters for all columns together.

    Returns
    -------
    list of int or None
        None if the longest words alone need more.
    """
    widths = [max(map(len, cells)) for cells in columns]
    words = [max(len(word) for cell in cells for word in [*cell.split(), ""]) for cells in columns]
    while sum(widths) > room:
        spare = [width if width > word else 0 for width, word in zip(widths, words, strict=True)]
        if not any(spare):
            return None
        widths[spare.index(max(spare))] -= 1
    return widths


def _wrapped(text: str, width: int) -> str:
    """Lines of a text, broken between words only: names and options stay whole."""
    return textwrap.fill(
        text, width, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )


def print_parameters(model: PlantModel, cost_per_dof: float) -> None:
    """Print the parameters of a plant with their standard deviations and units.

    Parameters
    ----------
    model : PlantModel
    cost_per_dof : float
        Of its fit: a note states that the standard deviations do not include what the model leaves.
    """
    rows = []
    for label, effect in model.labels():
        for name, p in effect.params.items():
            if not p.free:
                sigma = "fixed"
            else:
                sigma = "" if p.std is None else f"{p.std:.2g}" if math.isfinite(p.std) else "undetermined"
            row = [label, name, f"{p.value:.6g}", sigma, model.unit_of(effect, name)]
            rows.append([*row, *model.torques_of(effect, name)])
    head, more = ["effect", "parameter", "value", "sigma", "unit"], list(model.torque_head)
    print_table(Table([*head, *more], rows, left=["effect", "parameter", "unit", *more]))
    if cost_per_dof > SOME_LEFT and any(model[name].std for name in model.free_names):
        left = f"the model leaves {cost_per_dof:.4g} times the power of noise"
        are = "are" if cost_per_dof > MUCH_LEFT else "may be"
        print_message(f"note: {left}: sigma is by noise only, and the values {are} off by more")


def print_ladder(ladder: Ladder) -> None:
    """Print the error after each step."""
    unit = f" [{ladder.rungs[0].y_unit}]" if ladder.rungs[0].y_unit else ""
    header = ["step", "cost per d.o.f.", f"rms error fitted{unit}"]
    header += [f"{ladder.judged_on}{unit}", f"noise alone{unit}"]
    print_table(Table(header, ladder.rows(), left=["step"]))


def note_assumed_hold(is_assumed: bool, hold: str, other_delay_s: float | None = None) -> None:
    """Note that the records do not state their hold, which one was assumed, and how to state it."""
    if is_assumed:
        from gsid.base.hold import note_of_hold

        print_message(f"note: {note_of_hold(hold, other_delay_s)}")


def suggest(text: str) -> None:
    """Suggest the next command."""
    print_message(text, "hint:", "cyan")


def command_line(
    *words: str, records: Sequence[str], output: str | None = None, without: Sequence[str] = ()
) -> str:
    """A complete command for the same records, or for REC... if they are more than three.

    It repeats -C, --library and the options by which the records were read, except those of `without`.
    """
    context = click.get_current_context()
    own = context.params.get("library")
    folder = context.find_root().params.get("folder")
    typed = ["gsid"] if folder is None else ["gsid", "-C", folder]
    for library in dict.fromkeys([*context.find_root().params.get("libraries", ()), *([own] if own else [])]):
        typed += ["--library", ":".join(library)]
    typed += [*words, *(records if len(records) <= 3 else ["REC..."])]
    for option in context.command.params:
        value = context.params.get(option.name)
        if option.name in ("units", "factors"):
            typed += [word for name, one in value or () for word in (option.opts[0], f"{name}={one}")]
        elif option.name in HOW_READ and option.name not in without and value is not None:
            typed += [option.opts[0], _band_words(value) if option.name == "band" else str(value)]
    return shlex.join([*typed, *(["-o", output] if output else [])])


def _band_words(band: tuple[float, float]) -> str:
    """LO:HI with all digits: a rounded edge may exclude its line."""
    return ":".join(repr(end).removesuffix(".0") for end in band)
