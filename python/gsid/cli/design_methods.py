"""gsid design compare-methods"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.files_in_use import INPUT, RECORD
from gsid.cli.option_types import Band
from gsid.cli.options import (
    LIMIT,
    json_option,
    limit_command_option,
    limit_travel_option,
    options_as_arguments,
    period_option,
    picture_option,
    rate_option,
)
from gsid.cli.output import answered, draw, print_message, print_table, working

if TYPE_CHECKING:
    import numpy as np

    from gsid.excitation.methods import Method, MethodComparison


@click.command("compare-methods", short_help="Uncertainty that excitations leave in the same time.")
@rate_option(required=True)
@period_option(required=True)
@click.option("--band", type=Band(), required=True, help="Lines from LO to HI [Hz] only.")
@click.option("--duration", "time_s", metavar="S", type=LIMIT, required=True, help="Measurement time [s].")
@click.option("--noise-rms", "noise_rms", metavar="RMS", type=LIMIT, help="White noise of the output.")
@click.option(
    "--noise-record",
    metavar="REC",
    type=RECORD,
    help="Record that shows the noise.",
)
@click.option("--wait", "wait_s", metavar="S", type=LIMIT, help="Waiting time [s]. [default: one period]")
@click.option(
    "--lines",
    type=click.Choice(["full", "odd", "odd-random", "quasi-log"]),
    default="quasi-log",
    show_default=True,
    help="Lines to excite: every line, odd lines, odd lines with random gaps, or odd lines spaced evenly"
    " in log f.",
)
@limit_command_option
@limit_travel_option
@click.option(
    "--model", "model_path", metavar="M.json", type=INPUT, help="Model for gain, travel and simulation."
)
@click.option(
    "--sigma",
    "wanted",
    metavar="S",
    type=float,
    default=0.01,
    help="Required sigma over gain at every line. [default: 0.01]",
)
@click.option(
    "--simulations",
    metavar="R",
    type=click.IntRange(0, 10000),
    help="Simulated measurements of each method. [default: 20 with a model]",
)
@picture_option
@json_option
def compare_methods(
    *,
    fs_hz: float,
    period: int,
    band: tuple[float, float],
    time_s: float,
    noise_rms: float | None,
    noise_record: str | None,
    wait_s: float | None,
    lines: str,
    limit_command: float | None,
    limit_travel_deg: float | None,
    model_path: str | None,
    wanted: float,
    simulations: int | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Compare multisine, stepped sine, sweep and binary sequence for the same time and limits.

    sigma is the expected standard deviation of the response, by formula and by simulation. "time" is the
    measurement time that brings every line to --sigma. A stepped sine waits before each sine.
    """
    from gsid.excitation import methods
    from gsid.excitation.periodic import Limits
    from gsid.models.load import load_single
    from gsid.plots import excitation_methods

    if (noise_rms is None) == (noise_record is None):
        raise click.UsageError("give --noise-rms or --noise-record", click.get_current_context())
    model = load_single(model_path) if model_path else None
    density = noise_rms if noise_rms is not None else _density(str(noise_record))
    repeats = (20 if model else 0) if simulations is None else simulations
    with working("comparing excitations"), options_as_arguments():
        found = methods.compare_methods(
            fs_hz,
            period,
            band,
            time_s,
            density,
            Limits(limit_command, limit_travel_deg),
            model=model,
            wait_s=wait_s,
            grid=lines,
            wanted=wanted,
            n_simulated=repeats,
        )
    for name, why in found.skipped.items():
        print_message(f"note: without {name}: {why}")
    draw(lambda: excitation_methods(found), picture)
    if answered(as_json, lambda: _values(found)):
        return
    print(found.sentence)
    print()
    print_table(_table(found))


def _density(path: str) -> Callable[[np.ndarray], np.ndarray]:
    """Density of the noise of a record, interpolated."""
    import numpy as np

    from gsid.records.files import read_record
    from gsid.spectrum.noise import noise

    measured = noise(read_record(path, zero_input=True))
    return lambda f_hz: np.interp(f_hz, measured.f_hz, measured.psd)


def _values(found: MethodComparison) -> dict:
    keys = ("name", "n_periods", "least_s", "f_hz", "snr_db", "sigma", "sigma_simulated", "time_for_wanted_s")
    each = [
        {key: getattr(one, key) for key in keys}
        | {"peak": one.signal.peak, "crest_factor": one.signal.crest_factor}
        for one in found.methods
    ]
    facts = {"time_s": found.time_s, "wait_s": found.wait_s, "wanted": found.wanted}
    return facts | {"methods": each, "skipped": found.skipped, "sentence": found.sentence}


def _table(found: MethodComparison) -> Table:
    head = ["method", "peak", "periods", "sigma", "worst", "simulated", "time [s]"]
    return Table(head, [_row(one) for one in found.methods], left=["method"])


def _row(one: Method) -> list[str]:
    import numpy as np

    simulated = "" if one.sigma_simulated is None else f"{np.median(one.sigma_simulated):.3g}"
    needed = f"{one.time_for_wanted_s:.4g}" if np.isfinite(one.time_for_wanted_s) else ""
    if not one.n_periods:
        return [one.name, f"{one.signal.peak:.3g}", "0", f"needs {one.least_s:g} s", "", "", needed]
    median, worst = (f"{value:.3g}" for value in (np.median(one.sigma), np.max(one.sigma)))
    return [one.name, f"{one.signal.peak:.3g}", f"{one.n_periods}", median, worst, simulated, needed]
