"""gsid design"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gsid.cli.common import (
    Band,
    json_option,
    options_as_arguments,
    print_json,
    print_table,
    say,
    version,
)

if TYPE_CHECKING:
    from gsid.excitation import Multisine

NUMBERS_PER_LINE = 6  # of the C table


@click.group(short_help="Periodic excitation.")
def design() -> None:
    """Make a periodic excitation."""


@design.command(short_help="Sum of sines on a grid of lines.")
@click.option("--fs", "fs_hz", metavar="HZ", type=float, required=True, help="Sample rate.")
@click.option("--period", metavar="N", type=int, required=True, help="Samples in a period.")
@click.option("--band", type=Band(), required=True, help="First and last frequency allowed [Hz].")
@click.option(
    "--lines",
    type=click.Choice(["full", "odd"]),
    default="full",
    show_default=True,
    help="Every line, or odd ones.",
)
@click.option(
    "--shape",
    metavar="DB_PER_DECADE",
    type=float,
    default=0.0,
    help="Slope of the amplitude over frequency: 0 flat, -10 falls as 1/sqrt(f). [default: 0]",
)
@click.option("--amplitude", metavar="A", type=float, help="Amplitude of the first line. [default: 1]")
@click.option(
    "--peak", metavar="A", type=float, help="Largest magnitude of the samples, instead of --amplitude."
)
@click.option(
    "--phases",
    type=click.Choice(["schroeder", "random"]),
    default="schroeder",
    show_default=True,
    help="Low crest factor, or a realisation of its own for each seed.",
)
@click.option(
    "--seed", metavar="N", type=click.IntRange(0), default=0, show_default=True, help="Of random phases."
)
@click.option(
    "-o", "--output", metavar="FILE", type=click.Path(), help="Write .csv, .npz, .mat or .h (C table)."
)
@json_option
def multisine(
    fs_hz: float,
    period: int,
    band: tuple[float, float],
    lines: str,
    shape: float,
    amplitude: float | None,
    peak: float | None,
    phases: str,
    seed: int,
    output: str | None,
    as_json: bool,
) -> None:
    """Design a multisine with lines k fs/N in a band.

    The crest factor is that of the samples; crest_factor_fine looks between them, on a grid 8 times finer.
    Odd lines leave the even ones free, to show even distortion.
    """
    from gsid.excitation import Multisine

    with options_as_arguments():
        signal = Multisine.design(
            fs_hz,
            period,
            band,
            grid=lines,
            phases=phases,
            seed=seed,
            shape_db_per_decade=shape,
            amplitude=amplitude,
            peak=peak,
        )
    if output:
        _write(Path(output), signal)
        say(f"wrote {output}")
    figures = {
        "crest_factor": signal.crest_factor,
        "crest_factor_fine": signal.crest_factor_fine,
        "p_int_over_p_tot": signal.p_int_over_p_tot,
        "period_samples": signal.period_samples,
        "n_lines": len(signal.line),
        "peak": signal.peak,
        "rms": signal.rms,
        "travel_deg": None,  # needs a model of the axis
    }
    if as_json:
        print_json(figures)
    else:
        rows = [[name, f"{value:.6g}"] for name, value in figures.items() if value is not None]
        print_table(["figure", "value"], rows, left=["figure"])


def _write(path: Path, signal: Multisine) -> None:
    import numpy as np

    from gsid.io import write_atomically

    arrays = {
        "u": signal.table(),
        "fs_hz": signal.fs_hz,
        "period_samples": signal.period_samples,
        "hold": "zoh",
        "line": signal.line,
        "amplitude": signal.amplitude,
        "phase_rad": signal.phase_rad,
    }

    def write_mat(part: Path) -> None:
        from scipy.io import savemat

        savemat(part, arrays, oned_as="column")

    writers = {
        ".csv": signal.write_table,
        ".npz": lambda part: np.savez(part, **arrays),
        ".mat": write_mat,
        ".h": lambda part: part.write_text(_c_table(path.stem, signal), encoding="utf-8"),
    }
    if path.suffix.lower() not in writers:
        raise click.UsageError(
            f"cannot write {path.name}: .csv, .npz, .mat or .h", click.get_current_context()
        )
    write_atomically(path, writers[path.suffix.lower()])


def _c_table(stem: str, signal: Multisine) -> str:
    """One period as a C99 header; single precision, which is what a drive takes."""
    name = re.sub(r"\W", "_", stem)
    name = f"u_{name}" if name[:1].isdigit() else name
    # rounded to float first: nine digits of the double would be rounded twice
    numbers = [f"{value:.9g}" for value in signal.table().astype("float32")]
    numbers = [f"{number}{'' if re.search('[.e]', number) else '.0'}f" for number in numbers]
    starts = range(0, len(numbers), NUMBERS_PER_LINE)
    rows = ",\n".join("    " + ", ".join(numbers[i : i + NUMBERS_PER_LINE]) for i in starts)
    guard = f"{name.upper()}_H"
    return (
        f"/* gsid {version()}: {signal!r} */\n"
        f"#ifndef {guard}\n#define {guard}\n\n"
        f"#define {name.upper()}_N_PERIOD {signal.period_samples}\n"
        f"#define {name.upper()}_FS_HZ {signal.fs_hz!r}\n\n"
        f"static const float {name}[{name.upper()}_N_PERIOD] = {{\n{rows}\n}};\n\n#endif\n"
    )
