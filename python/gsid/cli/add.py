"""gsid add"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import click

from gsid.cli.files_in_use import INPUT, OUTPUT, RECORD
from gsid.cli.option_types import Value
from gsid.cli.options import (
    band_option,
    held_out_option,
    json_option,
    library_option,
    options_as_arguments,
    picture_option,
    plant_option,
    reading_options,
    reference_option,
)
from gsid.cli.output import (
    answered,
    command_line,
    draw,
    note_assumed_hold,
    print_ladder,
    print_message,
    print_parameters,
    print_step,
    suggest,
)

if TYPE_CHECKING:
    from gsid.diagnosis.add import Addition
    from gsid.effects.types import EffectType
    from gsid.records.record import Record

Bounds = tuple[float, float] | None


class Start(Value):
    """NAME=VALUE or NAME=VALUE,LO:HI."""

    name = "NAME=VALUE[,LO:HI]"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float, Bounds]:
        if isinstance(value, tuple):
            return value
        assigned, comma, limits = str(value).partition(",")
        name, number = super().convert(assigned, param, ctx)
        try:
            lo, hi = map(float, limits.split(":")) if comma else (0.0, 0.0)
        except ValueError:
            self.fail(f"{value} is not NAME=VALUE,LO:HI, for example width=0.1,0.01:1", param, ctx)
        return name, number, (lo, hi) if comma else None


@click.command(short_help="Add an effect to a model and report how much the error falls.")
@click.argument("effect", metavar="EFFECT", required=False)
@click.argument("records", metavar="REC...", nargs=-1, type=RECORD)
@reading_options
@reference_option
@plant_option("Stack of effects (model file) to extend.")
@click.option(
    "--torque",
    metavar="EXPRESSION",
    help="Instead of EFFECT: a law of w (rate), theta (angle), u (command) and --param, for example "
    "c*tanh(w/0.1).",
)
@click.option(
    "--table",
    metavar="CURVE.csv",
    type=INPUT,
    help="Instead of EFFECT: a law given by points, as written by `gsid diagnose --curve`.",
)
@library_option(
    "Instead of EFFECT: an effect compiled from C. This runs its code.", "library", multiple=False
)
@click.option(
    "--param",
    "params",
    type=Start(),
    multiple=True,
    help="Start value of a parameter, with its bounds for --torque. May be repeated. [default: the best "
    "of several starts]",
)
@held_out_option("a third of REC... at each level, or the later periods")
@band_option("Lines from LO to HI [Hz] only.")
@click.option("--undo", is_flag=True, help="Remove the last added effect instead.")
@click.option("-o", "--output", metavar="M2.json", type=OUTPUT, required=True, help="Model to write.")
@picture_option
@json_option
@click.pass_context
def add(
    ctx: click.Context,
    *,
    effect: str | None,
    records: Sequence[str],
    read: Callable[[Sequence[str]], list[Record]],
    reference: str | None,
    model_path: str,
    torque: str | None,
    table: str | None,
    library: tuple[str, str] | None,
    params: Sequence[tuple[str, float, Bounds]],
    held_out: Sequence[str],
    band: tuple[float, float] | None,
    undo: bool,
    output: str,
    picture: str | None,
    as_json: bool,
) -> None:
    """Add an effect to a model, fit the model, and judge it on data that were not fitted.

    The effect comes from the catalogue (see `gsid effects`), or it is your own: an expression, a table or a
    compiled function. A law is a torque that opposes the motion, divided by the inertia [unit of angle /
    s^2]. An expression may use numbers, + - * / ^, abs, sqrt, exp, log, sin, cos, tanh, min, max, pi and rad
    (radians in a unit of angle).

    With --r the model is simulated with the reference as its input. If it has no controller, the one that
    reference, output and command show is put around it and stays in the model.

    The model file keeps every added effect in its history. The printed ladder shows the error after each
    step.
    """
    from gsid.models.load import load_plant

    own = [choice for choice in (torque, table, library) if choice is not None]
    if undo:
        if effect or held_out or params or own or picture or reference:
            raise click.UsageError(
                "--undo removes the last added effect: leave out effect, records and options", ctx
            )
        _undo(model_path, output, as_json)
        return
    _check(ctx, effect, own, params)
    if own and effect:  # the first name is a record
        effect, records = None, (effect, *records)
    if not records:
        raise click.UsageError("a record is missing", ctx)
    from gsid.base.files import is_stdout
    from gsid.diagnosis.add import add as add_effect

    with options_as_arguments():
        chosen = _own_effect(torque, table, library, params) if own else effect
        if torque is None and any(limits for *_, limits in params):
            raise click.UsageError(
                "bounds in --param are for --torque: other effects have their own bounds", ctx
            )
        start = {name: value for name, value, _ in params} if torque is None else {}
        result = add_effect(
            chosen,
            load_plant(model_path),
            read(records),
            params=start or None,
            held_out=read(held_out) if held_out else None,
            reference=reference,
            band=band,
            on_step=print_step,
        )
    result.model.save(output)
    note_assumed_hold(result.fit.hold_assumed, result.fit.hold, result.fit.other_delay_s)
    print_message(f"wrote {output}")
    draw(result.plot, picture)
    if not answered(as_json, result.to_dict):
        _print(result)
        if result.rung.judged_on in ("not_fitted", "later_periods"):
            print_message(
                "note: if these records were used to choose this effect, judge it on a new record: "
                "--held-out NEW.csv"
            )
        if is_stdout(output):
            return
        suggest(
            f"{command_line('diagnose', '--model', output, records=records)} tests whether another is missing"
        )


def _check(
    ctx: click.Context, effect: str | None, own: Sequence[object], params: Sequence[tuple[str, float, Bounds]]
) -> None:
    """Refuse options that do not name exactly one effect, or that give a value twice."""
    from gsid.effects.types import catalogue

    if len(own) > 1:
        raise click.UsageError("--torque, --table and --library name one effect each: give one of them", ctx)
    if not own and not effect:
        raise click.UsageError("the name of an effect is missing", ctx)
    if own and effect in catalogue():
        raise click.UsageError(
            f"{effect} and an effect of your own are two effects: add one after the other", ctx
        )
    names = [name for name, *_ in params]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise click.UsageError(f"--param {twice} is given twice: give it once", ctx)


def _own_effect(
    torque: str | None,
    table: str | None,
    library: tuple[str, str] | None,
    params: Sequence[tuple[str, float, Bounds]],
) -> EffectType:
    """Effect that --torque, --table or --library describes."""
    from gsid import effects

    if library:
        return effects.load(*library)
    if table:
        return effects.table(table)
    bounds = {name: limits for name, _, limits in params if limits}
    return effects.expression(torque, {name: value for name, value, _ in params}, bounds=bounds)


def _print(result: Addition) -> None:
    print(result.rung.sentence)
    if result.undetermined:
        print(f"Not determined by these data: {', '.join(result.undetermined)}.")
    if not result.fit.converged:
        print("The fit has NOT converged.")
    print()
    print_ladder(result.ladder)
    print()
    print_parameters(result.model, result.fit.cost_per_dof)


def _remaining(n: int) -> str:
    if n == 0:
        return "no added effects remain"
    return "1 added effect remains" if n == 1 else f"{n} added effects remain"


def _undo(model_path: str, output: str, as_json: bool) -> None:
    from gsid.diagnosis.ladder import ladder, undo
    from gsid.models.load import load_plant

    model = load_plant(model_path)
    before = undo(model)
    before.save(output)
    print_message(f"wrote {output}")
    taken, left = ladder(model).rungs[-1].effect, ladder(before)
    if answered(as_json, lambda: {"undone": taken, "ladder": [rung.to_dict() for rung in left.rungs]}):
        return
    print(f"Removed {taken}; {_remaining(len(left.rungs))}.")
    if left.rungs:
        print()
        print_ladder(left)
