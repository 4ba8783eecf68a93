"""gsid next"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.design_next import distinguishing
from gsid.cli.files_in_use import INPUT, OUTPUT
from gsid.cli.options import (
    json_option,
    limit_command_option,
    limit_travel_option,
    options_as_arguments,
    picture_option,
    record_options,
)
from gsid.cli.output import answered, draw, print_message, print_table, working

if TYPE_CHECKING:
    from gsid.excitation.redesign import NextExcitation
    from gsid.records.record import Record


@click.command("next", short_help="The next excitation, from what was measured.")
@record_options
@click.option(
    "--sigma",
    metavar="S",
    type=float,
    help="Required sigma over gain at every line. [default: 0.01]",
)
@click.option(
    "--parameter-sigma",
    metavar="S",
    type=float,
    help="Required sigma over value of every free parameter of --model, instead of --sigma.",
)
@click.option("--model", "model_path", metavar="M.json", type=INPUT, help="Model for travel and parameters.")
@click.option(
    "--rival",
    "rival_path",
    metavar="M.json",
    type=INPUT,
    help="The other model.",
)
@limit_command_option
@limit_travel_option
@click.option(
    "--realisation",
    metavar="I",
    type=click.IntRange(1),
    default=1,
    help="Realisation that -o writes. [default: 1]",
)
@click.option("-o", "--output", metavar="FILE.csv", type=OUTPUT, help="Write one period of the command.")
@picture_option
@json_option
def next(
    *,
    records: list[Record],
    sigma: float | None,
    parameter_sigma: float | None,
    model_path: str | None,
    rival_path: str | None,
    limit_command: float | None,
    limit_travel_deg: float | None,
    realisation: int,
    output: str | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Propose the next excitation: amplitude of each line, periods, realisations, time, and why.

    The noise and the distortion of REC give the amplitudes, and the least time in which each line of the
    response reaches --sigma, or each parameter of --model reaches --parameter-sigma. Without --limit-command
    the command stays within the measured peak.

    With --rival, a second stack of effects, the experiments of `gsid design next` are ranked instead.
    """
    import numpy as np

    from gsid.excitation.periodic import Limits
    from gsid.excitation.redesign import next_excitation
    from gsid.models.load import load_single
    from gsid.response.with_distortion import frf_with_distortion

    context = click.get_current_context()
    if rival_path is not None:
        if model_path is None or sigma is not None or parameter_sigma is not None:
            raise click.UsageError("--rival needs --model, without --sigma and --parameter-sigma", context)
        limits = {"limit_command": limit_command, "limit_travel_deg": limit_travel_deg}
        distinguishing(
            records, model_path, rival_path, output=output, picture=picture, as_json=as_json, **limits
        )
        return
    if limit_travel_deg is not None and model_path is None:
        raise click.UsageError("--limit-travel-deg needs --model, which predicts the travel", context)
    model = load_single(model_path) if model_path else None
    command = limit_command or max(float(np.max(np.abs(one.u[one.valid]), initial=0.0)) for one in records)
    with working("choosing an excitation"), options_as_arguments():
        plan = next_excitation(
            frf_with_distortion(records),
            sigma=sigma,
            parameter_sigma=parameter_sigma,
            model=model,
            limits=Limits(command, limit_travel_deg),
        )
    if realisation > plan.n_realisations:
        raise click.UsageError(f"--realisation is at most {plan.n_realisations}", context)
    if output:
        plan.realisations()[realisation - 1].write_table(output)
        print_message(f"wrote {output}, realisation {realisation} of {plan.n_realisations}")
    draw(lambda: plan.excitation.plot(records[0].u_unit, model=model), picture)
    if not answered(as_json, plan.to_dict):
        _print(plan, records[0].u_unit)


def _print(plan: NextExcitation, u_unit: str) -> None:
    print(plan.reason)
    print()
    rows = [
        ["largest command", f"{plan.amplitude:.4g} {u_unit}".rstrip()],
        ["periods of each realisation", f"{plan.n_periods}"],
        ["realisations", f"{plan.n_realisations}"],
        ["time with waiting", f"{plan.time_s:.4g} s"],
        ["expected sigma over value", f"{plan.expected_std:.3g}"],
        ["larger error", plan.limited_by],
    ]
    print_table(Table(["next excitation", "value"], rows, left=["next excitation"]))
