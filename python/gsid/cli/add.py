"""gsid add"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import click

from gsid.cli.common import (
    band_option,
    json_option,
    load_plant,
    options_as_arguments,
    plant_option,
    print_json,
    print_ladder,
    print_parameters,
    reading_options,
    record_words,
    say,
    suggest,
)

if TYPE_CHECKING:
    from gsid.ladder import Addition
    from gsid.record import Record


class Value(click.ParamType):
    """NAME=VALUE."""

    name = "NAME=VALUE"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        if isinstance(value, tuple):
            return value
        name, equals, number = str(value).partition("=")
        try:
            if equals:
                return name.strip(), float(number)
        except ValueError:
            pass
        self.fail(f"{value} is not NAME=VALUE, for example level=2", param, ctx)


@click.command(short_help="Add an effect to a model and see how much the error falls.")
@click.argument("effect", metavar="EFFECT", required=False)
@click.argument("records", metavar="REC...", nargs=-1, type=click.Path())
@reading_options
@plant_option("Stack of effects to add to.")
@click.option(
    "--param",
    "params",
    type=Value(),
    multiple=True,
    help="Where the fit starts. [default: the best of several]",
)
@click.option(
    "--held-out",
    "held_out",
    metavar="REC",
    multiple=True,
    type=click.Path(),
    help="Judge on this record. [default: a third of REC... of each level, or the later periods]",
)
@band_option("Lines from LO to HI [Hz] only.")
@click.option("--undo", is_flag=True, help="Take the last step back instead.")
@click.option("-o", "--output", metavar="M2.json", type=click.Path(), required=True, help="Model to write.")
@json_option
@click.pass_context
def add(
    ctx: click.Context,
    effect: str | None,
    records: Sequence[str],
    read: Callable[[Sequence[str]], list[Record]],
    model_path: str,
    params: Sequence[tuple[str, float]],
    held_out: Sequence[str],
    band: tuple[float, float] | None,
    undo: bool,
    output: str,
    as_json: bool,
) -> None:
    """Add an effect of the catalogue to a model, fit it, and judge it on records that were not fitted.

    The model keeps every step in its history: this is the ladder, printed with the error after each step.
    """
    if undo:
        if effect or held_out or params:
            raise click.UsageError("--undo takes a step back: leave out effect, records and options", ctx)
        _undo(model_path, output, as_json)
        return
    if not effect or not records:
        raise click.UsageError("a record is missing" if effect else "the name of an effect is missing", ctx)
    from gsid.ladder import add as add_effect

    with options_as_arguments():
        result = add_effect(
            effect,
            load_plant(model_path),
            read(records),
            params=dict(params) or None,
            held_out=read(held_out) if held_out else None,
            band=band,
            on_step=lambda text: say(f"-- {text}"),
        )
    result.model.save(output)
    say(f"wrote {output}")
    if as_json:
        print_json(result.to_dict())
    else:
        _print(result)
        suggest(f"gsid diagnose --model {output} {record_words(records)} tells whether more is missing")


def _print(result: Addition) -> None:
    print(result.rung.sentence)
    if result.undetermined:
        print(f"Not determined by these data: {', '.join(result.undetermined)}.")
    if not result.fit.converged:
        print("The fit has NOT converged.")
    print()
    print_ladder(result.ladder)
    print()
    print_parameters(result.model)


def _undo(model_path: str, output: str, as_json: bool) -> None:
    from gsid.ladder import ladder, undo

    model = load_plant(model_path)
    before = undo(model)
    before.save(output)
    say(f"wrote {output}")
    taken, left = ladder(model).rungs[-1].effect, ladder(before)
    if as_json:
        print_json({"undone": taken, "ladder": [rung.to_dict() for rung in left.rungs]})
        return
    print(f"Took back {taken}; steps left: {len(left.rungs)}.")
    if left.rungs:
        print()
        print_ladder(left)
