"""gsid design"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.design_methods import compare_methods
from gsid.cli.design_next import design_next
from gsid.cli.design_orthogonal import orthogonal
from gsid.cli.files_in_use import FILE_OUTPUT, INPUT, OUTPUT
from gsid.cli.option_types import Band
from gsid.cli.options import (
    LIMIT,
    SEED,
    add_options,
    amplitude_option,
    band_option,
    is_given,
    json_option,
    limit_command_option,
    limit_travel_option,
    multisine_options,
    options_as_arguments,
    period_option,
    periods_option,
    rate_option,
    record_options,
)
from gsid.cli.output import answered, draw, print_message, print_table, working

if TYPE_CHECKING:
    from gsid.excitation.limits import Model
    from gsid.excitation.multisine import Multisine
    from gsid.excitation.periodic import Limits, Periodic
    from gsid.records.record import Record

NUMBERS_PER_LINE = 6  # of the C table


@click.group(short_help="Periodic excitation.")
def design() -> None:
    """Make a periodic excitation within the limits of the rig."""


design.add_command(design_next)
design.add_command(compare_methods)
design.add_command(orthogonal)

BASIC = (
    rate_option(required=True),
    period_option(required=True),
    click.option("--band", type=Band(), required=True, help="Lines from LO to HI [Hz] only."),
)
AMPLITUDE = amplitude_option("1, or the largest within the limits")
LIMITS = (
    limit_command_option,
    limit_travel_option,
    click.option(
        "--limit-slew", metavar="S", type=LIMIT, help="Limit of the change of the command per second."
    ),
    click.option(
        "--model", "model_path", metavar="M.json", type=INPUT, help="Model that predicts the travel."
    ),
    click.option(
        "-o", "--output", metavar="FILE", type=OUTPUT, help="Write .csv, .npz, .mat or .h (C table)."
    ),
)


def _finished(command: Callable) -> Callable:
    """Add the options of every kind of excitation. It returns the signal.

    It is called with `limits`, None when none was given, and `model`.
    """

    @functools.wraps(command)
    def with_limits(
        limit_command: float | None,
        limit_travel_deg: float | None,
        limit_slew: float | None,
        model_path: str | None,
        output: str | None,
        as_json: bool,
        **kwargs: object,
    ) -> None:
        from gsid.excitation.limits import fit_to_limits, travel
        from gsid.excitation.periodic import Limits
        from gsid.models.load import load_single

        context = click.get_current_context()
        if limit_travel_deg is not None and model_path is None:
            raise click.UsageError("--limit-travel-deg needs --model, which predicts the travel", context)
        model = load_single(model_path) if model_path else None
        with options_as_arguments():
            limits = Limits(limit_command, limit_travel_deg, limit_slew)
            some = limits if limits != Limits() else None
            if some and any(kwargs.get(name) is not None for name in ("amplitude", "peak")):
                raise click.UsageError("limits set the amplitude: leave out --amplitude and --peak", context)
            signal = command(limits=some, model=model, **kwargs)
            if some:
                signal = fit_to_limits(signal, some, model)
            travel_deg = travel(signal, model) if model else None
        if output:
            _write(output, signal)
            print_message(f"wrote {output}")
        _show(signal, travel_deg, as_json)

    return json_option(add_options(LIMITS)(with_limits))


@design.command(short_help="Sum of sines on a grid of lines.")
@add_options(BASIC)
@multisine_options
@AMPLITUDE
@click.option(
    "--peak", metavar="A", type=float, help="Largest magnitude of the samples, instead of --amplitude."
)
@click.option(
    "--optimise",
    is_flag=True,
    help="Search phases with low peaks of the command, and of the travel if it is limited.",
)
@click.option(
    "--plot-search",
    "search_picture",
    metavar="FILE",
    type=FILE_OUTPUT,
    help="With --optimise: draw crest factor and travel against the evaluations of the search to .png, .svg"
    " or .pdf.",
)
@_finished
def multisine(
    *,
    fs_hz: float,
    period: int,
    band: tuple[float, float],
    shape: dict,
    amplitude: float | None,
    peak: float | None,
    optimise: bool,
    search_picture: str | None,
    limits: Limits | None,
    model: Model | None,
) -> Periodic:
    """Design a multisine with lines k fs/N in a band.

    crest_factor is that of the samples; crest_factor_fine is taken on a time grid 8 times finer. Odd lines
    leave the even lines free to show even distortion. odd-random also leaves out one odd line in four to show
    odd distortion. With limits the amplitude is the largest that they allow.
    """
    from gsid.excitation.multisine import Multisine

    signal = Multisine.design(fs_hz, period, band, **shape, amplitude=amplitude, peak=peak)
    if search_picture and not optimise:
        raise click.UsageError("--plot-search needs --optimise", click.get_current_context())
    if search_picture and Path(search_picture).suffix.lower() not in (".png", ".svg", ".pdf"):
        text = f"cannot draw {Path(search_picture).name}: .png, .svg or .pdf"
        raise click.UsageError(text, click.get_current_context())
    if optimise:
        with working("searching phases"):
            signal = _searched(signal, limits, model, search_picture)
        signal = signal if peak is None else signal.scaled(peak / signal.peak)
    return signal


def _searched(
    signal: Multisine, limits: Limits | None, model: Model | None, picture: str | None
) -> Multisine:
    from gsid.excitation.limits import optimise, search_course, travel_unit

    if picture is None:
        return optimise(signal, limits, model)
    from gsid.plots.search import search_course as figure

    found = search_course(signal, limits, model)
    draw(lambda: figure(found, travel_unit(model) if model else ""), picture)
    return found.best


@design.command(short_help="Pseudorandom binary sequence.")
@add_options(BASIC)
@click.option(
    "--kind",
    type=click.Choice(["quadratic-residue", "maximum-length"]),
    default="quadratic-residue",
    show_default=True,
    help="Lengths that are primes, or 2^m - 1.",
)
@AMPLITUDE
@_finished
def prbs(
    fs_hz: float,
    period: int,
    band: tuple[float, float],
    kind: str,
    amplitude: float | None,
    limits: Limits | None,
    model: Model | None,
) -> Periodic:
    """Design a binary sequence whose clock is 2.5 times the upper edge of the band, or a little faster.

    Sequences exist for some periods only; an error names the nearest valid period.
    """
    from gsid.excitation.generators import Prbs

    return Prbs.design(fs_hz, period, band, kind=kind, amplitude=1.0 if amplitude is None else amplitude)


@design.command(short_help="Sine that sweeps the band once in a period.")
@add_options(BASIC)
@click.option(
    "--kind",
    type=click.Choice(["linear", "log"]),
    default="linear",
    show_default=True,
    help="Frequency as a function of time.",
)
@click.option("--phase-deg", metavar="DEG", type=float, default=0.0, help="Phase at the start. [default: 0]")
@click.option(
    "--phase-of",
    type=click.Choice(["sine", "cosine"]),
    default="sine",
    show_default=True,
    help="What the phase refers to; the thesis has a cosine at 45 degrees.",
)
@click.option("--no-mean", is_flag=True, help="Subtract the mean of the period.")
@click.option("--jump", is_flag=True, help="Keep the requested band, with a phase jump after each period.")
@AMPLITUDE
@_finished
def sweep(
    *,
    fs_hz: float,
    period: int,
    band: tuple[float, float],
    kind: str,
    phase_deg: float,
    phase_of: str,
    no_mean: bool,
    jump: bool,
    amplitude: float | None,
    limits: Limits | None,
    model: Model | None,
) -> Periodic:
    """Design a swept sine.

    The upper frequency is lowered slightly so that a period has a whole number of cycles.
    """
    import math

    from gsid.excitation.generators import Sweep

    size, phase_rad = 1.0 if amplitude is None else amplitude, math.radians(phase_deg)
    return Sweep.design(
        fs_hz,
        period,
        band,
        kind=kind,
        amplitude=size,
        phase_rad=phase_rad,
        phase_of=phase_of,
        has_mean=not no_mean,
        continuous=not jump,
    )


@design.command(short_help="Random burst, impulse, pulse or doublets, then zero input.")
@add_options(BASIC)
@click.option(
    "--kind",
    type=click.Choice(["random-burst", "impulse", "pulse", "3-2-1-1"]),
    default="random-burst",
    show_default=True,
    help="Noise; one sample; a rectangle; steps of alternating sign with lengths 3, 2, 1 and 1.",
)
@click.option(
    "--length",
    "length_s",
    metavar="SECONDS",
    type=LIMIT,
    help="Duration of the signal. [default: of a burst half the period; of a pulse and of the shortest step"
    " half a cycle of HI]",
)
@click.option("--seed", metavar="N", type=SEED, default=0, help="Random seed of the burst. [default: 0]")
@AMPLITUDE
@_finished
def transient(
    *,
    fs_hz: float,
    period: int,
    band: tuple[float, float],
    kind: str,
    length_s: float | None,
    seed: int,
    amplitude: float | None,
    limits: Limits | None,
    model: Model | None,
) -> Periodic:
    """Design a signal at the start of the period, with zero input after it.

    The response must have decayed at the end of the period. Such a signal has power outside the band, which
    p_int_over_p_tot shows; a multisine of the same peak measures with less noise.
    """
    from gsid.excitation.transient import Transient

    context = click.get_current_context()
    if kind != "random-burst" and is_given(context, "seed"):
        raise click.UsageError(f"--seed is for a random burst, not for {kind}", context)
    size = 1.0 if amplitude is None else amplitude
    return Transient.design(fs_hz, period, band, kind=kind, length_s=length_s, amplitude=size, seed=seed)


@design.command("stepped-sine", short_help="One sine after another.")
@add_options(BASIC)
@click.option(
    "--lines",
    type=click.Choice(["full", "odd", "odd-random", "quasi-log"]),
    default="quasi-log",
    show_default=True,
    help="Lines to excite: every line, odd lines, odd lines with random gaps, or odd lines spaced evenly"
    " in log f.",
)
@click.option(
    "--settle",
    metavar="N",
    type=click.IntRange(0),
    help="Samples to discard before each sine. [default: one period]",
)
@periods_option(2)
@AMPLITUDE
@_finished
def stepped_sine(
    *,
    fs_hz: float,
    period: int,
    band: tuple[float, float],
    lines: str,
    settle: int | None,
    periods: int,
    amplitude: float | None,
    limits: Limits | None,
    model: Model | None,
) -> Periodic:
    """Design a stepped sine: each sine settles, then is measured for --periods.

    period_samples is the length of the whole sequence.
    """
    from gsid.excitation.generators import SteppedSine

    return SteppedSine.design(
        fs_hz,
        period,
        band,
        grid=lines,
        settle_samples=settle,
        n_periods=periods,
        amplitude=1.0 if amplitude is None else amplitude,
    )


@design.command(short_help="Measurement time for a required uncertainty.")
@record_options
@band_option("Lines from LO to HI [Hz] only.")
@click.option(
    "--sigma",
    metavar="S",
    type=float,
    default=0.01,
    help="Required sigma over gain at every line. [default: 0.01]",
)
@json_option
def budget(records: list[Record], band: tuple[float, float] | None, sigma: float, as_json: bool) -> None:
    """Plan the measurement time from a short record REC with the planned excitation.

    amplitude_factor is the factor on the amplitude that would give the same uncertainty without measuring
    longer. Both reduce the effect of noise, but not distortion: see `gsid distortion`.
    """
    from gsid.excitation.limits import plan_budget
    from gsid.response.estimate import frf

    response = frf(records, band=band)
    with options_as_arguments():
        plan = asdict(plan_budget(response, sigma))
    if not answered(as_json, lambda: plan):
        print_table(
            Table(["figure", "value"], [[name, f"{x:.6g}"] for name, x in plan.items()], left=["figure"])
        )


def _show(signal: Periodic, travel_deg: float | None, as_json: bool) -> None:
    figures = {
        "crest_factor": signal.crest_factor,
        "crest_factor_fine": signal.crest_factor_fine,
        "p_int_over_p_tot": signal.p_int_over_p_tot,
        "period_samples": signal.period_samples,
        "n_lines": len(signal.line),
        "peak": signal.peak,
        "rms": signal.rms,
        "mean": float(signal.table().mean()),
        "slew": signal.slew,
        "travel_deg": travel_deg,
    }
    if not answered(as_json, lambda: figures):
        rows = [[name, f"{value:.6g}"] for name, value in figures.items() if value is not None]
        print_table(Table(["figure", "value"], rows, left=["figure"]))


def _write(path: str, signal: Periodic) -> None:
    import numpy as np

    from gsid.base.files import kind_of, write_atomically

    arrays = {
        "u": signal.table(),
        "fs_hz": signal.fs_hz,
        "period_samples": signal.period_samples,
        "hold": "zoh",
        "line": signal.line,
        "amplitude": signal.amplitude,
    }
    if hasattr(signal, "phase_rad"):
        arrays["phase_rad"] = signal.phase_rad

    def write_mat(part: Path) -> None:
        from scipy.io import savemat

        savemat(part, arrays, oned_as="column")

    writers = {
        ".npz": lambda part: np.savez(part, **arrays),
        ".mat": write_mat,
        ".h": lambda part: part.write_text(_c_table(Path(path).stem, signal), encoding="utf-8"),
    }
    kind = kind_of(path, stream=".csv")
    if kind == ".csv":
        signal.write_table(path)
    elif kind in writers:
        write_atomically(path, writers[kind])
    else:
        raise click.UsageError(
            f"cannot write {Path(path).name}: .csv, .npz, .mat or .h", click.get_current_context()
        )


def _c_table(stem: str, signal: Periodic) -> str:
    """One period as a C99 header; single precision, which is what a drive takes."""
    from gsid._lib import version
    from gsid.base.c_text import literal, refused_name

    name = re.sub(r"[^A-Za-z0-9]+", "_", stem)
    name = f"u_{name}" if refused_name(name) else name
    numbers = [literal(value) for value in signal.table()]
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
