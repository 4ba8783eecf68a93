"""gsid diagnose"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import click

from gsid.base.tables import Table
from gsid.cli.common import with_ladder
from gsid.cli.options import (
    INPUT,
    OUTPUT,
    SEED,
    alpha_option,
    band_option,
    found_model_option,
    is_given,
    json_option,
    options_as_arguments,
    output_is_option,
    picture_option,
    reading_options,
    records_argument,
    reference_option,
)
from gsid.cli.output import (
    command_line,
    draw,
    note_assumed_hold,
    print_json,
    print_ladder,
    print_message,
    print_parameters,
    print_table,
    suggest,
)

if TYPE_CHECKING:
    from gsid.comparison import Comparison
    from gsid.diagnosis.diagnose import Diagnosis
    from gsid.diagnosis.ladder import Ladder
    from gsid.diagnosis.torque_residual import TorqueResidual
    from gsid.records.record import Record


@click.command(short_help="Find the physical effect that is missing from a model.")
@records_argument
@reading_options
@reference_option
@click.option(
    "--model",
    "model_path",
    metavar="M.json",
    type=INPUT,
    help="Stack of effects (model file) to test. [default: the linear structure is found from the records]",
)
@output_is_option
@band_option("Lines from LO to HI [Hz] only.")
@alpha_option(0.05)
@click.option(
    "--seed",
    metavar="N",
    type=SEED,
    default=0,
    help="Random seed of the bootstrap. [default: 0]",
)
@click.option("--fast", is_flag=True, help="Stop at the first draft, which no simulation confirms.")
@click.option(
    "--time",
    "time_s",
    metavar="SECONDS",
    type=click.FloatRange(0, min_open=True),
    help="Budget: the result is the best so far. [default: 60]",
)
@found_model_option
@click.option(
    "--curve",
    metavar="CURVE.csv",
    type=OUTPUT,
    help="Write the torque missing from the model as a law, for `gsid add --table`.",
)
@picture_option
@json_option
def diagnose(
    *,
    records: Sequence[str],
    read: Callable[[Sequence[str]], list[Record]],
    reference: str | None,
    model_path: str | None,
    y_is: str | None,
    band: tuple[float, float] | None,
    fast: bool,
    time_s: float | None,
    alpha: float,
    seed: int,
    path: str | None,
    curve: str | None,
    picture: str | None,
    as_json: bool,
) -> int | None:
    """Find the physical effect that is missing from a model of an axis.

    Without --model, the linear structure is found from the records. The laws of the catalogue are ranked by
    the missing torque that they explain, and the best ones are fitted by simulation. A law is named if these
    fits confirm it, and is called the nearest or unknown otherwise. Ctrl-C prints the result reached so far.

    With --model, the free parameters of the model are fitted first. Then the effects of the catalogue that
    could explain the remaining error are fitted one by one and ranked by evidence. Effects that the data
    cannot distinguish form one group.

    Measure several realisations at two levels of the excitation for the best result.
    """
    _check_options(model_path)
    if model_path is None:
        from gsid.cli.diagnose_records import diagnose_without_model

        how = {"output": y_is, "reference": reference, "band": band, "fast": fast, "time_s": time_s}
        files = {"path": path, "curve": curve, "picture": picture}
        return diagnose_without_model(records, read, how, **files, as_json=as_json)
    how = {"band": band, "alpha": alpha, "seed": seed}
    files = {"output": path, "curve": curve, "picture": picture}
    _diagnose_model(records, read, model_path, **how, **files, as_json=as_json)
    return None


def _check_options(model_path: str | None) -> None:
    """Refuse options of the other kind of diagnosis."""
    context = click.get_current_context()
    of_records = {"reference": "--r", "y_is": "--output", "fast": "--fast", "time_s": "--time"}
    of_models = {"alpha": "--alpha", "seed": "--seed"}
    for name, option in (of_records if model_path else of_models).items():
        if is_given(context, name):
            place = "without --model" if model_path else "with --model"
            raise click.UsageError(f"{option} applies only {place}", context)


def _diagnose_model(
    records: Sequence[str],
    read: Callable[[Sequence[str]], list[Record]],
    model_path: str,
    *,
    band: tuple[float, float] | None,
    alpha: float,
    seed: int,
    output: str | None,
    curve: str | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Run `gsid diagnose --model`."""
    from gsid.comparison import compare
    from gsid.diagnosis.diagnose import diagnose as find_missing
    from gsid.diagnosis.ladder import ladder
    from gsid.models.load import load_plant
    from gsid.spectrum.realisation import spectra

    model = load_plant(model_path)
    measured = [spectra(record) for record in read(records)]
    with options_as_arguments():
        result = find_missing(
            model,
            measured,
            band=band,
            alpha=alpha,
            seed=seed,
            on_step=lambda text: print_message(f"-- {text}"),
        )
        measured = result.read(measured)
        before = compare(result.steps[0].fit.model, measured, band=band, alpha=alpha, fitted=True)
    note_assumed_hold(result.hold_assumed, result.hold, result.other_delay_s)
    final = with_ladder(model, result, measured, band) if output else None
    if output:
        final.save(output)
        print_message(f"wrote {output}")
    missing = None
    if curve or result.verdict == "unknown_effect":
        from gsid.diagnosis.torque_residual import torque_residual

        missing = torque_residual(result.steps[0].fit.model, measured, band=band)
    if curve:
        missing.best.save(curve)
        print_message(f"wrote {curve}: torque against {missing.best.name}")
    draw((result if result.rounds else before).plot, picture)
    if as_json:
        print_json(before.to_dict() | result.to_dict() | _curve(missing))
        return
    _print(result, before)
    if final and final.history:
        print()
        _print_ladder(ladder(final))
    if missing:
        print(f"\n{missing.sentence}")
    _suggest(result, records, model_path, curve)


def _suggest(result: Diagnosis, records: Sequence[str], model_path: str, curve: str | None) -> None:
    """Suggest the next command. Only a new record can judge the effect, since these records selected it."""
    given, judge = ["--model", model_path], ["--held-out", "NEW.csv"]
    if result.named:
        effect = result.found[0].effects[0]
        typed = command_line("add", effect, *given, *judge, records=records, output="M2.json")
        suggest(f"{typed} judges it on a new record, which the search has not used")
    if result.verdict == "unknown_effect":
        report = command_line("report", "--diagnose", *given, records=records)
        suggest(f"{report} draws the missing torque")
        if curve:
            as_law = command_line("add", "--table", curve, *given, *judge, records=records, output="M2.json")
            suggest(f"{as_law} adds it as a law and judges it on a new record")
        else:
            suggest("--curve CURVE.csv saves it as a law")


def _print_ladder(steps: Ladder) -> None:
    print_ladder(steps)
    idle = [rung.effect for rung in steps.rungs if not rung.falls]
    if idle:
        named = " and ".join(idle)
        fall = f"The error on {steps.judged_on} DOES NOT FALL significantly"
        print(f"{fall} with {named}: the data do not confirm it.")
    if any(rung.judged_on == "search_records" for rung in steps.rungs):
        print("The search used these records too. Only new records show how well the model predicts.")


def _curve(missing: TorqueResidual | None) -> dict[str, Any]:
    """The law of the missing torque, for --json."""
    if missing is None:
        return {}
    best = missing.best
    keys = {"variable": best.name, "unit": best.unit, "explained": best.explained, "std": best.std}
    return {"missing_torque": keys | {"at": best.at, "torque": -best.torque}}


def _print(result: Diagnosis, before: Comparison) -> None:
    print(result.sentence)
    if before.where:
        print(before.verdict)
    rows = [
        [
            one.name,
            f"{group.probability:.1%}",
            " or ".join(group.effects),
            "" if one.before is None else f"{one.before:.4g}",
            f"{group.candidates[0].fit.cost_per_dof:.4g}",
        ]
        for one in result.rounds
        for group in one.ranking
    ]
    for note in result.notes:
        print(note)
    if rows:
        print()
        header = ["round", "probability", "effects", "cost per d.o.f. before", "after"]
        print_table(Table(header, rows, left=["effects"]))
    print()
    print_parameters(result.model)
    if result.next_experiment:
        print(f"\n{result.next_experiment}")
