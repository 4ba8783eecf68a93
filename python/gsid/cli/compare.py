"""gsid compare"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.common import EXIT_CRITERION
from gsid.cli.compare_matrix import compare_matrix
from gsid.cli.files_in_use import INPUT
from gsid.cli.options import (
    alpha_option,
    band_option,
    experiment_options,
    json_option,
    options_as_arguments,
    picture_option,
    reference_option,
)
from gsid.cli.output import answered, draw, note_assumed_hold, print_table, working

if TYPE_CHECKING:
    from gsid.comparison import Comparison
    from gsid.models.rational import RationalModel
    from gsid.plant.model import PlantModel
    from gsid.records.mimo import MimoRecord
    from gsid.records.record import Record


@click.command(short_help="Compare a model with records.")
@experiment_options
@reference_option
@click.option(
    "--model",
    "model_path",
    metavar="M.json",
    type=INPUT,
    required=True,
    help="Model to compare: a fitted transfer function or a stack of effects.",
)
@band_option("Lines from LO to HI [Hz] only.")
@alpha_option(0.05)
@click.option(
    "--fitted",
    is_flag=True,
    help="The model was fitted to these records: allow for the number of its parameters instead of their "
    "covariance.",
)
@click.option("--check", is_flag=True, help="Exit with code 1 if the model is not adequate.")
@picture_option
@json_option
@click.pass_context
def compare(
    ctx: click.Context,
    *,
    records: list[Record] | list[MimoRecord],
    reference: str | None,
    model_path: str,
    band: tuple[float, float] | None,
    alpha: float,
    fitted: bool,
    check: bool,
    picture: str | None,
    as_json: bool,
) -> None:
    """Compare the model's output with the measured mean at each line, in units of the noise.

    A fitted model is uncertain, since the records of its fit were noisy. The test allows for the covariance
    in its file. Use --fitted if the records are those of the fit. Lines that were not excited count too:
    power there is distortion. The exit code is 0 for either verdict; with --check it is 1 if the model is not
    adequate.

    With --r a stack of effects is simulated with the reference as its input. If it has no controller, the one
    that reference, output and command show is put around it. A transfer function is compared at the lines of
    the reference.

    With several inputs or outputs (--u u1,u2 --y y1,y2) each REC is one experiment. All outputs are tested
    together, since their noise may be correlated, and each alone.
    """
    from gsid.comparison import compare as compare_model
    from gsid.models.load import load_single
    from gsid.records.mimo import MimoRecord

    if isinstance(records[0], MimoRecord):
        how = {"band": band, "alpha": alpha, "fitted": fitted, "check": check, "as_json": as_json}
        compare_matrix(records, model_path, **how)
        return
    model = load_single(model_path)
    with working("comparing"), options_as_arguments():
        if reference is not None:
            from gsid.diagnosis.closed_loop import in_closed_loop

            model, measured = in_closed_loop(model, records, reference)
        else:
            measured = records
        result = compare_model(model, measured, band=band, alpha=alpha, fitted=fitted)
    note_assumed_hold(result.hold_assumed, result.hold, result.other_delay_s)
    draw(result.plot, picture)
    if not answered(as_json, result.to_dict):
        _print(result, records[0].y_unit, _cost_means(model))
    if check and not result.adequate:
        ctx.exit(EXIT_CRITERION)


def _cost_means(model: RationalModel | PlantModel) -> str:
    """Meaning of a cost, by the method of the fit."""
    from gsid.greybox.fit import COST_MEANS
    from gsid.plant.model import PlantModel

    method = (
        (model.fit or {}).get("method") if isinstance(model, PlantModel) else getattr(model, "method", None)
    )
    return COST_MEANS.get(method, COST_MEANS["ml"])


def _uncertainty(result: Comparison, rms: str) -> str:
    """Whether and how the test allows for the model's uncertainty."""
    match result.model_uncertainty:
        case "included":
            return f"{result.model_uncertainty_rms:.4g} {rms}, included in the test"
        case "fitted":
            return "not added: the model was fitted to these records"
    return "left out: the model has no covariance and is judged as if known exactly"


def _print(result: Comparison, unit: str, cost_means: str) -> None:
    verdict = "adequate" if result.adequate else "not adequate"
    print(f"The model is {verdict}: p = {result.p_value:.3g} at a level of {result.alpha:g}.")
    print(f"Cost per degree of freedom {result.cost_per_dof:.4g} ({cost_means}).")
    rms = f"{unit} rms".strip()
    print(f"Error {result.rms_error:.4g} {rms}, noise floor {result.noise_floor_rms:.4g} {rms}.")
    print(f"Model uncertainty {_uncertainty(result, rms)}.")
    if not result.where:
        if not result.adequate:
            print("The excess is spread over the whole band.")
        return
    print_table(
        Table(
            ["f from [Hz]", "to [Hz]", "lines", "share of the excess", "p", "error over response [dB]"],
            [
                [
                    f"{band['f_lo_hz']:.4g}",
                    f"{band['f_hi_hz']:.4g}",
                    band["lines"],
                    f"{band['share']:.1%}",
                    f"{band['p_value']:.2g}",
                    f"{band['db']:.1f}",
                ]
                for band in result.where
            ],
            left=["lines"],
        )
    )
