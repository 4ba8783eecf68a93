"""gsid design orthogonal"""

from __future__ import annotations

import click

from gsid.base.tables import Table
from gsid.cli.experiments import Numbers, files_in, folder_option
from gsid.cli.option_types import Band
from gsid.cli.options import SEED, json_option, options_as_arguments, period_option, rate_option
from gsid.cli.output import answered, print_message, print_table


@click.command(short_help="Orthogonal multisines for several inputs.")
@rate_option(required=True)
@period_option(required=True)
@click.option("--band", type=Band(), required=True, help="Lines from LO to HI [Hz] only.")
@click.option(
    "--amplitudes",
    metavar=Numbers.name,
    type=Numbers(),
    required=True,
    help="Amplitude of each line, one number for each input.",
)
@click.option(
    "--realisations",
    metavar="M",
    type=click.IntRange(1),
    default=1,
    help="Realisations of the random phases; distortion needs at least 2. [default: 1]",
)
@click.option(
    "--lines",
    type=click.Choice(["full", "odd", "odd-random", "quasi-log"]),
    default="full",
    show_default=True,
    help="Lines to excite: every line, odd lines, odd lines with random gaps, or odd lines spaced evenly"
    " in log f.",
)
@click.option("--seed", metavar="N", type=SEED, default=0, help="Random seed of the phases. [default: 0]")
@folder_option
@json_option
def orthogonal(
    *,
    fs_hz: float,
    period: int,
    band: tuple[float, float],
    amplitudes: tuple[float, ...],
    realisations: int,
    lines: str,
    seed: int,
    folder: str,
    as_json: bool,
) -> None:
    """Design random-phase multisines that excite several inputs at once and are orthogonal at every line.

    A realisation is one experiment for each input. DIR receives one period of each experiment, with columns
    u1, u2, ...; the experiments of a realisation follow each other.
    """
    from gsid.excitation.orthogonal import orthogonal_multisines

    with options_as_arguments():
        how = {"n_realisations": realisations, "grid": lines, "seed": seed}
        design = orthogonal_multisines(fs_hz, period, band, amplitudes, **how)
    paths = files_in(folder, len(design.periods))
    design.write(paths)
    print_message(f"wrote {len(paths)} experiments to {folder}")
    figures = {
        "n_experiments": len(paths),
        "n_lines": len(design.line),
        "period_samples": design.period_samples,
        "peak": design.peak,
        "rms": design.rms,
    }
    if not answered(as_json, lambda: figures):
        rows = [
            [f"u{i + 1}", f"{peak:.4g}", f"{rms:.4g}", f"{peak / rms:.3g}"]
            for i, (peak, rms) in enumerate(zip(design.peak, design.rms, strict=True))
        ]
        print_table(Table(["input", "peak", "rms", "crest factor"], rows, left=["input"]))
