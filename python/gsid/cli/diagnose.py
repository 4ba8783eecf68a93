"""gsid diagnose"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import click

from gsid.cli.common import EXIT_GOOD, EXIT_INTERRUPT, with_ladder
from gsid.cli.files_in_use import INPUT, OUTPUT
from gsid.cli.options import (
    alpha_option,
    band_option,
    found_model_option,
    inertia_option,
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
    MUCH_LEFT,
    answered,
    command_line,
    draw,
    note_assumed_hold,
    print_ladder,
    print_message,
    print_parameters,
    print_table,
    steps_shown,
    suggest,
)

if TYPE_CHECKING:
    from gsid.comparison import Comparison
    from gsid.diagnosis.from_records.result import Diagnosis
    from gsid.diagnosis.ladder import Ladder
    from gsid.diagnosis.torque_residual import TorqueResidual
    from gsid.plant.model import PlantModel
    from gsid.records.record import Record


@click.command(short_help="Find the physical effects that a model of an axis lacks.")
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
    "--fast", is_flag=True, help="Stop after the first draft: no fits by simulation, and no effect is named."
)
@click.option(
    "--time",
    "time_s",
    metavar="SECONDS",
    type=click.FloatRange(0, min_open=True),
    help="Time limit. The result is the best one found until then. [default: 60]",
)
@inertia_option
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
    inertia_kg_m2: float | None,
    band: tuple[float, float] | None,
    fast: bool,
    time_s: float | None,
    alpha: float,
    path: str | None,
    curve: str | None,
    picture: str | None,
    as_json: bool,
) -> int:
    """Find the physical effects that a model of an axis lacks.

    No model is needed: without --model, the linear structure is found from the records. With --model, the
    free parameters of this model are fitted; several effects may be missing from it, and --alpha is the level
    of the test whether it is adequate.

    The laws of the catalogue are ranked by the missing torque that they explain, and the best ones are fitted
    by simulation. A law is named only if these fits confirm it. Otherwise it is reported as the nearest, or
    the missing effect is unknown. Effects that the data cannot distinguish form one group. Ctrl-C prints the
    result reached so far.

    Measure several realisations at two levels of the excitation for the best result.
    """
    context = click.get_current_context()
    if model_path is None and is_given(context, "alpha"):
        raise click.UsageError("--alpha applies only with --model", context)
    from gsid.diagnosis.from_records.diagnose import diagnose_records
    from gsid.diagnosis.from_records.fingerprints import fingerprints
    from gsid.models.load import load_plant

    model = load_plant(model_path) if model_path else None
    with options_as_arguments(), steps_shown() as on_step:
        found = diagnose_records(
            read(records),
            model,
            output=y_is,
            reference=reference,
            band=band,
            fast=fast,
            time_s=time_s,
            alpha=alpha,
            on_step=on_step,
        )
    _give_inertia(found, inertia_kg_m2 or (model.inertia_kg_m2 if model else None))
    before = _compared(found)
    if model is not None and found.hold is not None:
        note_assumed_hold(found.hold_assumed, found.hold, found.other_delay_s)
    final = _saved(model, found, path) if path else None
    missing = _missing(found, curve)
    draw((found if found.model or not before else before).plot, picture)

    def numbers() -> dict[str, object]:
        beside = {"fingerprints": [one.to_dict() for one in fingerprints(found)]}
        return (before.to_dict() if before else {}) | found.to_dict() | _law(missing) | beside

    if answered(as_json, numbers):
        return _exit_code(found)
    _print(found, before, missing)
    if final and final.history:
        from gsid.diagnosis.ladder import ladder

        print()
        _print_ladder(ladder(final))
    _suggest(found, records, model_path, curve, path)
    return _exit_code(found)


def _give_inertia(found: Diagnosis, inertia_kg_m2: float | None) -> None:
    if found.model is not None and found.model.angle_unit != "m":
        found.model.inertia_kg_m2 = inertia_kg_m2


def _exit_code(found: Diagnosis) -> int:
    return EXIT_INTERRUPT if found.interrupted else EXIT_GOOD


def _compared(found: Diagnosis) -> Comparison | None:
    """The linear part, or the given model, with its parameters fitted, against the records."""
    from gsid.comparison import compare

    if found.linear is None:
        return None
    return compare(found.linear, found.measured, band=found.band, fitted=True)


def _saved(given: PlantModel | None, found: Diagnosis, path: str) -> PlantModel | None:
    if found.model is None:
        print_message(f"note: no stack of effects represents the data: {path} was not written")
        return None
    final = with_ladder(given, found)
    final.save(path)
    which = "with the effects found" if found.named else "without an added effect"
    print_message(f"wrote {path}: the model {which}")
    return final


def _missing(found: Diagnosis, curve: str | None) -> TorqueResidual | None:
    """The missing torque as a curve, if it was requested or if no law explains it."""
    if found.linear is None:
        if curve:
            print_message(f"note: without a linear model there is no missing torque: {curve} was not written")
        return None
    if not (curve or found.verdict in ("unknown_effect", "nearest_effect")):
        return None
    missing = found.torque_residual()
    if curve:
        missing.best.save(curve)
        print_message(f"wrote {curve}: torque against {missing.best.name}")
    return missing


def _law(missing: TorqueResidual | None) -> dict[str, object]:
    """The law of the missing torque, for --json."""
    if missing is None:
        return {}
    best = missing.best
    keys = {"variable": best.name, "unit": best.unit, "explained": best.explained, "std": best.std}
    return {"missing_torque": keys | {"at": best.at, "torque": -best.torque}}


def _print(found: Diagnosis, before: Comparison | None, missing: TorqueResidual | None) -> None:
    print(found.sentence)
    for text in found.reasons:
        print(f"  {text}")
    if before is not None and before.where and not before.adequate:
        verdict = before.verdict.replace(": ", ", ", 1)
        print(f"Without an added effect: {verdict[0].lower()}{verdict[1:]}")
    if found.ranking:
        print()
        print_table(found.table())
    if found.model is not None:
        print()
        is_named = found.verdict == "missing_effect"
        print_parameters(found.model, found.cost_per_dof_after if is_named else found.cost_per_dof)
    print()
    for text in found.notes[len(found.reasons) :]:
        print(text)
    if found.next_experiment:
        print(found.next_experiment)
    if missing is not None:
        print(f"\n{missing.sentence}")


def _print_ladder(steps: Ladder) -> None:
    print_ladder(steps)
    idle = [rung.effect for rung in steps.rungs if not rung.falls]
    if idle:
        named = " and ".join(idle)
        fall = f"The error on {steps.judged_on} DOES NOT FALL significantly"
        print(f"{fall} with {named}: the data do not confirm it.")
    if any(rung.judged_on == "search_records" for rung in steps.rungs):
        print("The search used these records too. Only new records show how well the model predicts.")


def _suggest(
    found: Diagnosis,
    records: Sequence[str],
    model_path: str | None,
    curve: str | None,
    output: str | None,
) -> None:
    """Suggest the next command. Only a new record can judge the effect, since these records selected it."""
    linear = model_path or "LINEAR.json"
    given, judge = ["--model", linear], ["--held-out", "NEW.csv"]
    by_command = ["reference"] if found.by_command else []
    if found.verdict == "missing_effect" and not model_path:
        written = output or "FOUND.json"
        typed = command_line("compare", "--model", written, records=["NEW.csv"])
        suggest(f"{typed} judges on a new record the model that -o {written} writes")
    elif found.effects and not found.adequate:
        typed = command_line(
            "add", found.effects[0], *given, *judge, records=records, output="M2.json", without=by_command
        )
        which = "a new record, which the search has not used" if model_path else "a new record"
        rest = "" if model_path else f"; `gsid start REC... -o {linear}` writes the linear model"
        suggest(f"{typed} judges it on {which}{rest}")
    if found.verdict == "nearest_effect" and found.cost_per_dof_after > MUCH_LEFT:
        further = command_line("diagnose", "--model", "M2.json", records=records)
        suggest(f"more than one effect may be missing: then {further} searches beside {found.effects[0]}")
    if found.verdict != "unknown_effect":
        return
    if found.linear is None:
        return
    if not curve:
        suggest("--curve CURVE.csv saves the missing torque as a law")
    elif model_path:
        as_law = command_line("add", "--table", curve, *given, *judge, records=records, output="M2.json")
        suggest(f"{as_law} adds it as a law and judges it on a new record")
