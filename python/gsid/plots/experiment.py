"""Pictures of an experiment: the excitation, and the periods overlaid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from gsid.excitation.limits import travel_path, travel_unit
from gsid.excitation.periodic import between_samples
from gsid.plots.style import (
    EXCESS,
    MEASURED,
    MODEL,
    NOISE,
    SIGNAL,
    db,
    db_label,
    draw_points,
    frequency_axis,
    is_narrow,
    limits_db,
    new_figure,
    plain_number,
    plain_text,
    styled,
    with_unit,
)
from gsid.spectrum.lines import lines_of, period_of

if TYPE_CHECKING:
    from gsid.excitation.multisine import Multisine
    from gsid.excitation.periodic import Limits
    from gsid.models.rational import RationalModel
    from gsid.plant.model import PlantModel
    from gsid.records.record import Record
    from gsid.spectrum.spectra import Spectra


def _one_period(source: Multisine | Spectra) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Samples of one period, amplitudes of all lines, excited lines, and whether the signal is designed."""
    n = source.period_samples
    if hasattr(source, "table"):
        u = np.asarray(source.table(), dtype=float)
        return u, np.abs(lines_of(u)), np.asarray(source.line, dtype=int), True
    lines = np.zeros(n // 2 + 1, dtype=complex)
    lines[np.asarray(source.line, dtype=int)] = source.u
    return period_of(lines, n), np.abs(lines), np.asarray(source.line)[np.asarray(source.excited)], False


def crest_factors(u) -> tuple[float, float]:
    """Peak over rms of one period: on its samples, and between them (8x finer, band-limited interpolation).

    Parameters
    ----------
    u : (N,) one period

    Returns
    -------
    on_samples, between : float
    """
    u = np.asarray(u, dtype=float)
    rms = np.sqrt(np.mean(u**2))
    if rms == 0.0:
        return np.nan, np.nan
    return float(np.max(np.abs(u)) / rms), float(np.max(np.abs(between_samples(u))) / rms)


@styled
def excitation(
    source: Multisine | Spectra,
    u_unit: str | None = None,
    *,
    model: RationalModel | PlantModel | None = None,
    limits: Limits | None = None,
) -> Figure:
    """One period of the excitation, its line spectrum and, with a model, the travel that it predicts.

    Parameters
    ----------
    source : Multisine (as designed) or Spectra (as applied: the mean period of the record)
    u_unit : str, optional
        Unit of the input; default: the unit in `source`.
    model : RationalModel or PlantModel, optional
    limits : Limits, optional
        Limits of command and travel, drawn with them.

    Returns
    -------
    Figure
    """
    u, amplitude, excited, designed = _one_period(source)
    unit = plain_text(getattr(source, "u_unit", "") if u_unit is None else u_unit)
    crest = (source.crest_factor, source.crest_factor_fine) if designed else crest_factors(u)
    figure = new_figure(4.6 if model is None else 6.6)
    time_ax, line_ax, *more = figure.subplots(2 if model is None else 3, 1)
    fs, n = source.fs_hz, len(u)
    _draw_period(time_ax, u, fs, unit, None if limits is None else limits.command)
    time_ax.set_title(
        f"{'Designed' if designed else 'Applied'} excitation, one period of {n} samples "
        f"({n / fs:g} s): crest factor {crest[0]:.2f} on samples, {crest[1]:.2f} between them"
    )
    _draw_lines(line_ax, np.arange(len(amplitude)) * fs / n, amplitude, excited, unit)
    if model is not None:
        _draw_travel(more[0], u, fs, model, None if limits is None else limits.travel)
    return figure


def _draw_period(ax: Axes, u: np.ndarray, fs: float, unit: str, limit: float | None) -> None:
    n = len(u)
    ax.plot(np.arange(n) / fs, u, color=SIGNAL, linewidth=0.7, rasterized=n > 20000)
    rms = float(np.sqrt(np.mean(u**2)))
    for sign, name in ((-1.0, "−rms"), (1.0, "+rms")):
        ax.axhline(sign * rms, color=NOISE, linewidth=0.8, linestyle="--")
        ax.annotate(
            name,
            (1.0, sign * rms),
            (4, 0),
            xycoords=("axes fraction", "data"),
            fontsize=8.0,
            textcoords="offset points",
            va="center",
            color="#555555",
        )
    _draw_limit(ax, limit, f"limit of the command, ±{limit or 0:g} {unit}".rstrip())
    ax.set_xlim(0.0, n / fs)
    ax.set_xlabel("time in one period [s]")
    ax.set_ylabel(with_unit("input u", unit))


def _draw_limit(ax: Axes, limit: float | None, label: str) -> None:
    if limit is None:
        return
    for sign in (-1.0, 1.0):
        ax.axhline(sign * limit, color=EXCESS, linewidth=1.0, label=label if sign > 0 else None)
    ax.legend(loc="best")


def _draw_lines(ax: Axes, f_hz: np.ndarray, amplitude: np.ndarray, excited: np.ndarray, unit: str) -> None:
    is_excited = np.zeros(len(amplitude), dtype=bool)
    is_excited[excited] = True
    rest = ~is_excited & (f_hz > 0.0) & (amplitude > 1e-9 * amplitude.max())
    if rest.any():
        draw_points(ax, f_hz[rest], db(amplitude[rest]), NOISE, f"other lines ({rest.sum()})", markersize=1.8)
    if len(excited):
        draw_points(
            ax,
            f_hz[excited],
            db(amplitude[excited]),
            SIGNAL,
            f"excited lines ({len(excited)}, {f_hz[excited].min():g} to {f_hz[excited].max():g} Hz)",
            markersize=3.0,
        )
    frequency_axis(ax, f_hz[(f_hz > 0.0) & (is_excited | rest)])
    limits_db(ax, db(amplitude[excited]), db(amplitude[rest]))
    ax.set_ylabel(db_label("|U|", unit))
    ax.legend(loc="best")


def _draw_travel(
    ax: Axes, u: np.ndarray, fs: float, model: RationalModel | PlantModel, limit: float | None
) -> None:
    angle, unit = travel_path(u, fs, model), plain_text(travel_unit(model))
    n, most = len(u), float(np.abs(angle).max())
    ax.plot(np.arange(n) / fs, angle, color=MODEL, linewidth=0.9, rasterized=n > 20000)
    _draw_limit(ax, limit, f"limit of the travel, ±{limit or 0:g} {unit}")
    ax.set_xlim(0.0, n / fs)
    ax.set_xlabel("time in one period [s]")
    ax.set_ylabel(with_unit("travel", unit))
    share = f", {most / limit:.0%} of the limit".replace("%", " %") if limit else ""
    ax.set_title(f"Predicted travel about its middle, in steady state: ±{most:.3g} {unit}{share}")


@styled
def periods(record: Record, spectra: Spectra) -> Figure:
    """Periods of the output overlaid, their difference from the mean, and the decay of the transient.

    Parameters
    ----------
    record : Record, all samples, lost ones marked in ``valid``
    spectra : Spectra of the same record (its period and settling)

    Returns
    -------
    Figure
    """
    n, settle, fs = spectra.period_samples, spectra.settle_samples, record.fs_hz
    unit = plain_text(record.y_unit)
    y = np.where(record.valid, record.y, np.nan)
    n_whole = (len(y) - settle) // n
    stack = y[settle : settle + n_whole * n].reshape(n_whole, n)
    stack = stack[np.isfinite(stack).all(axis=1)]
    mean = stack.mean(axis=0)
    difference = y - mean[(np.arange(len(y)) - settle) % n]

    figure = new_figure(6.4)
    over_ax, diff_ax, decay_ax = figure.subplots(3, 1)
    t = np.arange(n) / fs
    for ax, curves in ((over_ax, stack), (diff_ax, stack - mean)):
        ax.plot(
            t,
            curves.T,
            color=SIGNAL,
            alpha=max(0.08, min(0.6, 3.0 / len(stack))),
            linewidth=0.6,
            rasterized=True,
        )
        ax.set_xlim(0.0, n / fs)
        ax.set_xlabel("time in the period [s]")
    over_ax.plot(t, mean, color=MEASURED, linewidth=0.7, label=f"mean of {len(stack)}", rasterized=n > 20000)
    over_ax.set_ylabel(with_unit("output y", unit))
    over_ax.set_title(f"{len(stack)} good period{'s' * (len(stack) != 1)} overlaid")
    over_ax.legend(loc="upper right")
    noise = _noise_rms(stack - mean)
    diff_ax.set_ylabel(with_unit("y − mean", unit))
    diff_ax.set_title(
        "Difference of each period from the mean"
        + (f": {f'{noise:.3g} {unit}'.rstrip()} rms" if np.isfinite(noise) else " (only one period)")
    )
    _draw_decay(decay_ax, difference, settle, n, noise, unit)
    return figure


def _noise_rms(difference: np.ndarray) -> float:
    """Rms of the noise of one period. A difference from the mean of P periods has 1 - 1/P of its variance."""
    n_periods = len(difference)
    return float(np.sqrt(np.mean(difference**2) * n_periods / (n_periods - 1))) if n_periods > 1 else np.nan


def _draw_decay(ax: Axes, difference, settle: int, n: int, noise: float, unit: str) -> None:
    """Rms of y - mean in blocks of a tenth of a period, over the whole record, on a log axis."""
    block = max(n // 10, 1)
    n_blocks = len(difference) // block
    rows = difference[: n_blocks * block].reshape(n_blocks, block)
    rms = np.sqrt(np.mean(rows**2, axis=1))  # NaN where a sample was lost: a gap in the curve
    at = (np.arange(n_blocks) + 0.5) * block / n
    ax.plot(
        at,
        np.where(rms > 0.0, rms, np.nan),
        color=MEASURED,
        linewidth=0.9,
        label="rms in a tenth of a period",
    )
    if np.isfinite(noise):
        ax.axhline(noise, color=NOISE, linestyle="--", linewidth=0.9, label="rms over all good periods")
    if settle:
        ax.axvspan(0.0, settle / n, color=NOISE, alpha=0.15, linewidth=0.0, label="discarded while settling")
    lost = np.flatnonzero(~np.isfinite(rms))
    if len(lost):
        ax.plot(
            at[lost],
            np.full(len(lost), 0.03),
            "v",
            color=EXCESS,
            markersize=4.0,
            label="samples lost",
            transform=ax.get_xaxis_transform(),
        )
    ax.set_xlim(0.0, len(difference) / n)
    if np.any(rms > 0.0):
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter(FuncFormatter(plain_number))
    ax.set_xlabel("time [periods since the first sample]")
    ax.set_ylabel(with_unit("y − mean", unit))
    ax.set_title("Decay of the transient: rms difference from the mean period")
    ax.legend(loc="upper right", ncols=1 if is_narrow() else 2)
