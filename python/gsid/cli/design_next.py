"""gsid design next"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gsid.base.errors import InputError
from gsid.base.tables import Table
from gsid.cli.files_in_use import INPUT, OUTPUT
from gsid.cli.options import (
    json_option,
    limit_command_option,
    limit_travel_option,
    options_as_arguments,
    picture_option,
    plant_option,
    record_options,
)
from gsid.cli.output import answered, draw, print_message, print_table, working

if TYPE_CHECKING:
    from gsid.diagnosis.next_experiment import Experiment
    from gsid.plant.model import PlantModel
    from gsid.records.record import Record
    from gsid.spectrum.spectra import Spectra


@click.command("next", short_help="Excitation that distinguishes two models.")
@record_options
@plant_option("One of the models, a stack of effects.")
@click.option("--rival", "rival_path", metavar="M.json", type=INPUT, required=True, help="The other model.")
@limit_command_option
@limit_travel_option
@click.option("-o", "--output", metavar="FILE.csv", type=OUTPUT, help="Write one period of the best command.")
@picture_option
@json_option
def design_next(
    *,
    records: list[Record],
    model_path: str,
    rival_path: str,
    limit_command: float | None,
    limit_travel_deg: float | None,
    output: str | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Choose the next experiment: the one in which two models differ most.

    Both models are simulated with variations of the excitation of REC, of several that with the largest
    input. The experiments are ranked by the expected difference of the costs if one of the models is the
    axis, without the part that the free values of the other can imitate; of both cases the clearer one.
    Check the command and the travel against the rig.
    """
    limits = {"limit_command": limit_command, "limit_travel_deg": limit_travel_deg}
    distinguishing(records, model_path, rival_path, output=output, picture=picture, as_json=as_json, **limits)


def distinguishing(
    records: list[Record],
    model_path: str,
    rival_path: str,
    *,
    limit_command: float | None,
    limit_travel_deg: float | None,
    output: str | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Rank experiments by how well they distinguish two models; print, write and draw the best."""
    from gsid.diagnosis.next_experiment import ENOUGH
    from gsid.models.load import load_plant
    from gsid.plots import next_experiments
    from gsid.spectrum.realisation import spectra_of

    models = load_plant(model_path), load_plant(rival_path)
    names = Path(model_path).name, Path(rival_path).name
    _require_same_output(models, names)
    with working("simulating both models"), options_as_arguments():
        measured = max(spectra_of(records), key=lambda one: float(abs(one.u).max()))
        ranked, is_swapped = _clearer_order(models, measured, limit_command or math.inf, limit_travel_deg)
    names = names[::-1] if is_swapped else names
    best = ranked[0] if ranked and ranked[0].separation >= ENOUGH else None
    if output and best:
        best.save(output)
        print_message(f"wrote {output}")
    elif output:
        print_message(f"{output} was not written: no experiment distinguishes the models")
    if ranked:
        draw(lambda: next_experiments(ranked, names, models[0], measured.u_unit), picture)
    sentence = _sentence(best, names, models[0], measured)
    rows = [
        {"words": one.words, "separation": one.separation, "peak": one.peak, "travel": one.travel}
        for one in ranked
    ]
    chosen = {
        "amplitude": best and best.peak,
        "n_periods": measured.n_periods,
        "n_realisations": 1,
        "time_s": measured.n_periods * measured.period_samples / measured.fs_hz,
        "expected_std": None,
        "reason": sentence,
    }
    if answered(as_json, lambda: chosen | {"sentence": sentence, "experiments": rows, "enough": ENOUGH}):
        return
    print(sentence)
    print()
    _print(ranked, models[0], measured.u_unit)


def _clearer_order(
    models: tuple[PlantModel, PlantModel], measured: Spectra, limit: float, limit_travel_deg: float | None
) -> tuple[list[Experiment], bool]:
    """The ranking of the order in which the best experiment separates more, and whether it is swapped.

    Each of the models may be the axis: one with more effects imitates the other, but not vice versa.
    """
    from gsid.diagnosis.next_experiment import next_experiment

    both = [next_experiment(*each, measured, limit=limit) for each in (models, models[::-1])]
    given, swapped = (
        _within(_with_travel_of_both(one, other), models[0], limit_travel_deg)
        for one, other in (both, both[::-1])
    )
    is_swapped = _separation(swapped) > _separation(given)
    return (swapped if is_swapped else given), is_swapped


def _separation(ranked: Sequence[Experiment]) -> float:
    """That of the best experiment; 0 if there is none."""
    return ranked[0].separation if ranked else 0.0


def _require_same_output(models: Sequence[PlantModel], names: Sequence[str]) -> None:
    """Outputs in different units cannot be compared."""
    first, second = ({"output": one.output, "unit of the angle": one.angle_unit} for one in models)
    for what, value in first.items():
        if second[what] != value:
            hint = f"{names[0]} has {value}; both models have to be of the same output"
            raise InputError(f"the models differ in their {what}", names[1], second[what], hint)


def _with_travel_of_both(ranked: Sequence[Experiment], other: Sequence[Experiment]) -> list[Experiment]:
    """The larger travel of either model: the axis may be each of them."""
    travel = {one.words: one.travel for one in other}
    return [replace(one, travel=max(one.travel, travel.get(one.words, 0.0))) for one in ranked]


def _within(ranked: Sequence[Experiment], model: PlantModel, limit_deg: float | None) -> list[Experiment]:
    """Those whose travel to each side is allowed."""
    from gsid.plant.units import RADIANS

    if limit_deg is None:
        return list(ranked)
    if model.angle_unit == "m":
        raise click.UsageError("--limit-travel-deg is for an axis that turns", click.get_current_context())
    limit = limit_deg * RADIANS["deg"] / RADIANS[model.angle_unit]
    return [one for one in ranked if one.travel / 2 <= limit]


def _sentence(best: Experiment | None, names: tuple[str, str], model: PlantModel, measured: Spectra) -> str:
    if best is None:
        return f"No experiment of the menu distinguishes {names[0]} from {names[1]} at this noise level."
    peak = f"{best.peak:.3g} {measured.u_unit}".rstrip()
    return (
        f"To distinguish {names[0]} from {names[1]}: {best.words}, with a command up to {peak} and a travel "
        f"of {best.travel:.3g} {model.angle_unit}. The expected difference in cost is {best.separation:.3g} "
        f"over {measured.n_periods} periods."
    )


def _print(ranked: Sequence[Experiment], model: PlantModel, u_unit: str) -> None:
    command = f"largest command [{u_unit}]" if u_unit else "largest command"
    head = ["experiment", "difference in cost", command, f"travel [{model.angle_unit}]"]
    rows = [[one.words, f"{one.separation:.4g}", f"{one.peak:.4g}", f"{one.travel:.4g}"] for one in ranked]
    print_table(Table(head, rows, left=["experiment"]))
