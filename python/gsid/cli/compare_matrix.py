"""gsid compare with several inputs or outputs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsid.base.errors import InputError
from gsid.base.tables import Table
from gsid.cli.common import EXIT_CRITERION
from gsid.cli.frf_matrix import refuse_options
from gsid.cli.options import options_as_arguments
from gsid.cli.output import answered, note_assumed_hold, print_table, working

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gsid.comparison_mimo import MimoComparison
    from gsid.records.mimo import MimoRecord

SINGLE_ONLY = {"reference": "--r", "picture": "--plot"}


def compare_matrix(
    records: Sequence[MimoRecord],
    model_path: str,
    *,
    band: tuple[float, float] | None,
    alpha: float,
    fitted: bool,
    check: bool,
    as_json: bool,
) -> None:
    """Compare a model of several inputs and outputs with experiments and print the result."""
    from gsid.comparison_mimo import compare_mimo
    from gsid.models.load import load_model
    from gsid.models.mimo import MimoModel

    refuse_options(SINGLE_ONLY)
    model = load_model(model_path)
    if not isinstance(model, MimoModel):
        hint = "fit one with the same --u and --y, or name one input and one output"
        raise InputError("not a model of several inputs and outputs", model_path, None, hint)
    with working("comparing"), options_as_arguments():
        result = compare_mimo(model, records, band=band, alpha=alpha, fitted=fitted)
    note_assumed_hold(result.hold_assumed, result.hold)
    if not answered(as_json, result.to_dict):
        _print(result)
    if check and not result.adequate:
        click.get_current_context().exit(EXIT_CRITERION)


def _print(result: MimoComparison) -> None:
    verdict = "adequate" if result.adequate else "not adequate"
    print(f"The model is {verdict}: p = {result.p_value:.3g} at a level of {result.alpha:g}.")
    print(f"Cost per degree of freedom {result.cost_per_dof:.4g} (1 for a correct model).")
    uncertainty = {
        "included": "Its uncertainty is included in the test.",
        "fitted": "It was fitted to these records: the number of its parameters is allowed for.",
        "none": "It has no covariance and is judged as if known exactly.",
    }
    print(uncertainty[result.model_uncertainty])
    rows = []
    for one in result.outputs:
        name = f"{one.name} [{one.unit}]" if one.unit else one.name
        sizes = one.rms_error, one.noise_floor_rms, one.model_uncertainty_rms
        rows.append([name, f"{one.p_value:.2g}", *(f"{x:.4g}" for x in sizes)])
    print_table(Table(["output", "p", "error rms", "noise", "model's uncertainty"], rows, left=["output"]))
    if result.where:
        bands = []
        for band in result.where:
            limits = f"{band['f_lo_hz']:.4g}", f"{band['f_hi_hz']:.4g}"
            share = f"{band['share']:.1%}", f"{band['p_value']:.2g}"
            bands.append([band["output"], *limits, band["lines"], *share])
        header = ["output", "f from [Hz]", "to [Hz]", "lines", "share of the excess", "p"]
        print_table(Table(header, bands, left=["output", "lines"]))
