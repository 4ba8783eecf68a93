"""Pictures: one function each, objects in, a matplotlib Figure out (no pyplot, no global state).

Confidence throughout is 95 %, point by point; the bands are those of gsid.confidence.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, MultipleLocator, NullFormatter

from gsid.confidence import (
    NORMAL_95,
    complex_bound,
    confidence_ellipse,
    excess_bands,
    gain_phase_band,
    gain_phase_std,
    unwrapped_phase_deg,
)

if TYPE_CHECKING:
    from gsid.compare import Comparison
    from gsid.excitation import Multisine
    from gsid.frf import Frf, Spectra
    from gsid.ladder import Ladder
    from gsid.model import RationalModel
    from gsid.record import Record
    from gsid.torque import Curve, TorqueResidual

# Okabe and Ito's colours, which stay apart for the colour-blind; one meaning each in all pictures.
MEASURED = "#333333"
MODEL = "#0072B2"
NOISE = "#8A8A8A"
EXCESS = "#D55E00"
SIGNAL = "#0072B2"
KINDS = ("excited", "odd", "even")

STYLE = {
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.labelcolor": "#333333",
    "axes.edgecolor": "#888888",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.6,
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "lines.linewidth": 1.3,
    "lines.markersize": 2.4,
    "legend.fontsize": 8.5,
    "legend.frameon": True,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "legend.borderpad": 0.3,
    "svg.fonttype": "path",
    "svg.hashsalt": "gsid",
}
GRID_LINE = {"color": "#D0D0D0", "linewidth": 0.7, "zorder": 0.6}  # of the pole-zero map
GRID_TEXT = {"color": "#666666", "fontsize": 7.5, "zorder": 0.7}
WIDTH_IN = 9.0
RASTER_DPI = 160
_MANY_POINTS = 1200  # more than that are drawn as a bitmap inside the vector picture


# --- drawing helpers --------------------------------------------------------------------------------------


def _styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    @functools.wraps(draw)
    def styled(*args, **kwargs) -> Figure:
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return styled


def _figure(height_in: float) -> Figure:
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=RASTER_DPI)
    FigureCanvasAgg(figure)
    return figure


def _db(x) -> np.ndarray:
    return 20.0 * np.log10(np.maximum(np.abs(x), np.finfo(float).tiny))


def _plain(value: float, _position: int | None = None) -> str:
    return f"{value:g}"


def _frequency_axis(ax: Axes, f_hz, *, label: bool = True) -> None:
    f_hz = np.asarray(f_hz, dtype=float)
    f_hz = f_hz[f_hz > 0.0]
    low, high = (f_hz.min(), f_hz.max()) if len(f_hz) else (1.0, 10.0)
    margin = max((high / low) ** 0.02, 1.01)
    ax.set_xscale("log")
    ax.set_xlim(low / margin, high * margin)
    fine = (
        (1.0, 2.0, 5.0) if high / low > 8.0 else tuple(np.arange(1.0, 10.0, 0.5 if high / low < 2.0 else 1.0))
    )
    ax.xaxis.set_major_locator(LogLocator(subs=fine, numticks=50))
    ax.xaxis.set_major_formatter(FuncFormatter(_plain))
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.tick_params(axis="x", which="minor", length=0)
    if label:
        ax.set_xlabel("frequency [Hz]")
    else:
        ax.tick_params(axis="x", labelbottom=False)


def _phase_axis(ax: Axes) -> None:
    low, high = ax.get_ylim()
    step = next(s for s in (15, 30, 45, 90, 180, 360, 720, 1440, 1e9) if (high - low) / s <= 8)
    ax.yaxis.set_major_locator(MultipleLocator(step))
    ax.set_ylabel("phase [deg]")


def _per(y_unit: str, u_unit: str) -> str:
    """Unit of y/u as one writes it: (deg/s)/A."""
    if not y_unit and not u_unit:
        return ""
    top = f"({y_unit})" if "/" in y_unit else y_unit or "1"
    return f"{top}/({u_unit})" if "/" in u_unit else f"{top}/{u_unit or '1'}"


def _db_label(what: str, unit: str) -> str:
    return f"{what} [dB re 1 {unit}]" if unit else f"{what} [dB]"


def _with_unit(what: str, unit: str) -> str:
    return f"{what} [{unit}]" if unit else what


def _text(value: str) -> str:
    """Names and units come from files: a dollar sign in them is no mathematics."""
    return str(value).replace("$", r"\$")


def _points(ax: Axes, x, y, colour: str, label: str | None, **style) -> None:
    style = {"marker": "o", "markersize": 2.4, "markeredgewidth": 0.0} | style
    ax.plot(x, y, linestyle="none", color=colour, label=label, rasterized=len(x) > _MANY_POINTS, **style)


def _error_bars(ax: Axes, x, low, high, label: str | None) -> None:
    """All bars as one broken line: a tenth of the size of separate ones in an SVG."""
    gap = np.full(len(x), np.nan)
    bars = np.column_stack([low, high, gap]).ravel()
    ax.plot(np.repeat(x, 3), bars, color=MEASURED, alpha=0.35, linewidth=0.8, label=label)


def _shade(ax: Axes, f_lo: float, f_hi: float, label: str | None = None, colour: str = EXCESS) -> None:
    """At least a hair wide, so that a band of one line is seen on a log axis."""
    ax.axvspan(f_lo / 1.006, f_hi * 1.006, color=colour, alpha=0.13, linewidth=0.0, label=label, zorder=0.5)


def _limits_db(ax: Axes, *curves, room: float = 4.0) -> None:
    """Limits from the curves that matter; isolated deep nulls do not squeeze the rest."""
    values = np.concatenate([np.atleast_1d(np.asarray(c, dtype=float)) for c in curves])
    values = values[np.isfinite(values)]
    if len(values):
        low, high = np.percentile(values, 0.5), values.max()
        room = max(room, 0.06 * (high - low))
        ax.set_ylim(low - room, high + room)


def _dof(frf: Frf) -> int | None:
    """Degrees of freedom of the variance; None (taken as exact) where it did not come from periods."""
    return frf.n_periods - frf.n_realisations if frf.n_periods > frf.n_realisations else None


def _line_mask(frf: Frf) -> np.ndarray:
    return np.asarray(frf.f_hz) > 0.0


def delay_text(delay_s: float, fs_hz: float | None, std_s: float | None = None) -> str:
    """Delay in ms and in samples, for example "5.4000 ± 0.0040 ms (16.20 samples)"."""
    samples = f" ({delay_s * fs_hz:.2f} samples)" if fs_hz else ""
    return f"{with_interval(delay_s * 1e3, std_s * 1e3 if std_s else None)} ms{samples}"


def with_interval(value: float, std: float | None) -> str:
    """A value and half its 95 % interval, to two digits of the latter, for example "5.4003 ± 0.0016"."""
    if std is None or not np.isfinite(std) or std <= 0.0:
        return f"{value:.5g}".replace("-", "−")
    half = NORMAL_95 * std
    decimals = 1 - int(np.floor(np.log10(half)))
    if not -4 <= decimals <= 9:
        return f"{value:.6g} ± {half:.2g}".replace("-", "−")
    value, half, decimals = round(value, decimals), round(half, decimals), max(decimals, 0)
    return f"{value:.{decimals}f} ± {half:.{decimals}f}".replace("-", "−")


def order_text(model: RationalModel) -> str:
    """Order as the command line takes it: poles/zeros."""
    return f"{len(model.den) - 1}/{len(model.num) - 1}"


# --- excitation and periods -------------------------------------------------------------------------------


def _one_period(source: Multisine | Spectra) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Samples of one period; amplitudes of all lines; the excited lines; designed (or else measured)."""
    n = source.period_samples
    if hasattr(source, "table"):
        u = np.asarray(source.table(), dtype=float)
        spectrum = 2.0 * np.abs(np.fft.rfft(u)) / n
        return u, spectrum, np.asarray(source.line, dtype=int), True
    lines = np.zeros(n // 2 + 1, dtype=complex)
    lines[np.asarray(source.line, dtype=int)] = source.u
    full = 0.5 * n * lines  # |U| is the sine's amplitude; line 0 and line N/2 have no mirror image
    full[0] *= 2.0
    if n % 2 == 0:
        full[-1] *= 2.0
    return np.fft.irfft(full, n), np.abs(lines), np.asarray(source.line)[np.asarray(source.excited)], False


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
    n = len(u)
    rms = np.sqrt(np.mean(u**2))
    if rms == 0.0:
        return np.nan, np.nan
    fine = 8.0 * np.fft.irfft(np.fft.rfft(u), 8 * n)
    return float(np.max(np.abs(u)) / rms), float(np.max(np.abs(fine)) / rms)


@_styled
def excitation(source: Multisine | Spectra, u_unit: str | None = None) -> Figure:
    """One period of the excitation and its line spectrum.

    Parameters
    ----------
    source : Multisine (as designed) or Spectra (as applied: the mean period of the record)
    u_unit : str, optional
        Unit of the input; default: that of the source.

    Returns
    -------
    Figure
    """
    u, amplitude, excited, designed = _one_period(source)
    unit = _text(getattr(source, "u_unit", "") if u_unit is None else u_unit)
    fs, n = source.fs_hz, len(u)
    on_samples, between = (source.crest_factor, source.crest_factor_fine) if designed else crest_factors(u)

    figure = _figure(4.6)
    time_ax, line_ax = figure.subplots(2, 1)
    time_ax.plot(np.arange(n) / fs, u, color=SIGNAL, linewidth=0.7, rasterized=n > 20000)
    rms = float(np.sqrt(np.mean(u**2)))
    for sign, name in ((-1.0, "−rms"), (1.0, "+rms")):
        time_ax.axhline(sign * rms, color=NOISE, linewidth=0.8, linestyle="--")
        time_ax.annotate(
            name,
            (1.0, sign * rms),
            (4, 0),
            xycoords=("axes fraction", "data"),
            fontsize=8.0,
            textcoords="offset points",
            va="center",
            color="#555555",
        )
    time_ax.set_xlim(0.0, n / fs)
    time_ax.set_xlabel("time in one period [s]")
    time_ax.set_ylabel(_with_unit("input u", unit))
    time_ax.set_title(
        f"{'Designed' if designed else 'Applied'} excitation, one period of {n} samples "
        f"({n / fs:g} s): crest factor {on_samples:.2f} on samples, {between:.2f} between them"
    )

    f_hz = np.arange(len(amplitude)) * fs / n
    is_excited = np.zeros(len(amplitude), dtype=bool)
    is_excited[excited] = True
    rest = ~is_excited & (f_hz > 0.0) & (amplitude > 1e-9 * amplitude.max())
    if rest.any():
        _points(
            line_ax, f_hz[rest], _db(amplitude[rest]), NOISE, f"other lines ({rest.sum()})", markersize=1.8
        )
    if len(excited):
        _points(
            line_ax,
            f_hz[excited],
            _db(amplitude[excited]),
            SIGNAL,
            f"excited lines ({len(excited)}, {f_hz[excited].min():g} to {f_hz[excited].max():g} Hz)",
            markersize=3.0,
        )
    _frequency_axis(line_ax, f_hz[(f_hz > 0.0) & (is_excited | rest)])
    _limits_db(line_ax, _db(amplitude[excited]), _db(amplitude[rest]))
    line_ax.set_ylabel(_db_label("|U|", unit))
    line_ax.legend(loc="best")
    return figure


@_styled
def periods(record: Record, spectra: Spectra) -> Figure:
    """Periods of the output overlaid, their difference from the mean, and how the transient dies out.

    Parameters
    ----------
    record : Record, all samples, lost ones marked in ``valid``
    spectra : Spectra of the same record (its period and settling)

    Returns
    -------
    Figure
    """
    n, settle, fs = spectra.period_samples, spectra.settle_samples, record.fs_hz
    unit = _text(record.y_unit)
    y = np.where(record.valid, record.y, np.nan)
    n_whole = (len(y) - settle) // n
    stack = y[settle : settle + n_whole * n].reshape(n_whole, n)
    stack = stack[np.isfinite(stack).all(axis=1)]
    mean = stack.mean(axis=0)
    difference = y - mean[(np.arange(len(y)) - settle) % n]

    figure = _figure(6.4)
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
    over_ax.set_ylabel(_with_unit("output y", unit))
    over_ax.set_title(f"{len(stack)} good period{'s' * (len(stack) != 1)} laid over each other")
    over_ax.legend(loc="upper right")
    noise = _noise_rms(stack - mean)
    diff_ax.set_ylabel(_with_unit("y − mean", unit))
    diff_ax.set_title(
        "Difference of each period from the mean"
        + (f": {noise:.3g} {unit} rms" if np.isfinite(noise) else " (one period: none)")
    )
    _draw_decay(decay_ax, difference, settle, n, noise, unit)
    return figure


def _noise_rms(difference: np.ndarray) -> float:
    """Of one period's noise: a difference from the mean of P periods has (1 - 1/P) of its variance."""
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
        ax.axvspan(0.0, settle / n, color=NOISE, alpha=0.15, linewidth=0.0, label="thrown away to settle")
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
        ax.yaxis.set_major_formatter(FuncFormatter(_plain))
    ax.set_xlabel("time [periods since the first sample]")
    ax.set_ylabel(_with_unit("y − mean", unit))
    ax.set_title("Decay of the transient: rms difference from the mean period")
    ax.legend(loc="upper right", ncols=2)


# --- frequency responses ----------------------------------------------------------------------------------


@_styled
def frf(frf: Frf) -> Figure:
    """Measured frequency response, with the noise's standard deviation in the same dB axis.

    Parameters
    ----------
    frf : Frf

    Returns
    -------
    Figure
    """
    use = _line_mask(frf)
    f, g, sigma = frf.f_hz[use], frf.g[use], np.sqrt(frf.var_g[use])
    figure = _figure(5.2)
    gain_ax, phase_ax = figure.subplots(2, 1, height_ratios=[3, 2])
    averaged = f"{frf.n_periods} period{'s' * (frf.n_periods != 1)}"
    if frf.n_realisations > 1:
        averaged += f" of {frf.n_realisations} realisations"
    _points(gain_ax, f, _db(g), SIGNAL, f"|G| measured, {len(f)} lines")
    known = np.isfinite(sigma) & (sigma > 0.0)
    if known.any():
        _points(
            gain_ax,
            f[known],
            _db(sigma[known]),
            NOISE,
            f"σ of the noise on G, mean of {averaged}",
            markersize=2.0,
        )
    _frequency_axis(gain_ax, f, label=False)
    _limits_db(gain_ax, _db(g), _db(sigma[known]))
    gain_ax.set_ylabel(_db_label("|G|, σ", _text(_per(frf.y_unit, frf.u_unit))))
    gain_ax.legend(loc="best")
    _points(phase_ax, f, unwrapped_phase_deg(f, g, np.where(known, sigma, 0.0)), SIGNAL, None)
    _frequency_axis(phase_ax, f)
    _phase_axis(phase_ax)
    return figure


def _dense(f, *roots) -> np.ndarray:
    """Frequencies to draw a model on: even in log f, the lines, and close together at sharp resonances."""
    grid = [np.geomspace(f.min(), f.max(), 600), f]
    for root in np.concatenate([np.atleast_1d(r) for r in roots]) / (2.0 * np.pi):
        width = max(abs(root.real), 1e-4 * abs(root))
        grid.append(abs(root.imag) + width * np.linspace(-4.0, 4.0, 33))
    grid = np.unique(np.concatenate(grid))
    return grid[(grid >= f.min()) & (grid <= f.max())]


@_styled
def bode(model: RationalModel, frf: Frf | None = None) -> Figure:
    """Fitted model and, when given, the measured response, with 95 % bands on gain and phase of both.

    Parameters
    ----------
    model : RationalModel
    frf : Frf, optional

    Returns
    -------
    Figure
    """
    f = _band_of(model) if frf is None else frf.f_hz[_line_mask(frf)]
    fine = _dense(f, model.poles, model.zeros) if model.domain == "s" else _dense(f, [])
    g_model = model.response(fine)
    phase_model = unwrapped_phase_deg(fine, g_model)
    figure = _figure(6.0)
    gain_ax, phase_ax = figure.subplots(2, 1, height_ratios=[3, 2])
    if frf is not None:
        _draw_measured(gain_ax, phase_ax, frf, model.response(f), np.interp(f, fine, phase_model))
    _draw_model(gain_ax, phase_ax, fine, g_model, phase_model, model)
    _limits_db(gain_ax, _db(g_model), *([] if frf is None else [_db(frf.g[_line_mask(frf)])]))
    gain_ax.set_ylabel(_db_label("|G|", _text(_per(model.y_unit, model.u_unit))))
    gain_ax.legend(loc="best")
    _frequency_axis(gain_ax, f, label=False)
    _frequency_axis(phase_ax, f)
    _phase_axis(phase_ax)
    return figure


def _band_of(model: RationalModel) -> np.ndarray:
    """Band to draw a model in by itself: that of its fit, else around its roots; below fs/2."""
    band = model.band_hz
    if band is None:
        roots = np.abs(np.concatenate([model.poles, model.zeros])) / (2.0 * np.pi)
        roots = roots[roots > 0.0] if model.domain == "s" else roots[:0]
        top = 0.499 * model.fs_hz if model.fs_hz else 100.0
        band = (0.1 * roots.min(), 10.0 * roots.max()) if len(roots) else (1e-3 * top, top)
    high = min(band[1], 0.499 * model.fs_hz) if model.fs_hz else band[1]
    return np.geomspace(max(band[0], 1e-4 * high), high, 200)


@_styled
def bode_of_plant(frf: Frf, g_model) -> Figure:
    """Measured response with 95 % intervals, and output over input of a plant, which has no one response.

    Parameters
    ----------
    frf : Frf
    g_model : (F,) complex array_like
        The plant's output over its input at the lines of `frf`.

    Returns
    -------
    Figure
    """
    use = _line_mask(frf)
    f, g_model = frf.f_hz[use], np.asarray(g_model)[use]
    phase_model = unwrapped_phase_deg(f, g_model)
    figure = _figure(6.0)
    gain_ax, phase_ax = figure.subplots(2, 1, height_ratios=[3, 2])
    _draw_measured(gain_ax, phase_ax, frf, g_model, phase_model)
    gain_ax.plot(f, _db(g_model), color=MODEL, label="model, output over input at the excited lines")
    phase_ax.plot(f, phase_model, color=MODEL)
    _limits_db(gain_ax, _db(g_model), _db(frf.g[use]))
    gain_ax.set_ylabel(_db_label("|G|", _text(_per(frf.y_unit, frf.u_unit))))
    gain_ax.legend(loc="best")
    _frequency_axis(gain_ax, f, label=False)
    _frequency_axis(phase_ax, f)
    _phase_axis(phase_ax)
    return figure


def _draw_measured(gain_ax: Axes, phase_ax: Axes, frf: Frf, g_model, phase_model) -> None:
    """The model tells on which branch the measured phase is: noise needs no unwrapping."""
    use = _line_mask(frf)
    f, g = frf.f_hz[use], frf.g[use]
    phase = phase_model + np.degrees(np.angle(g * np.conj(g_model)))
    if np.any(frf.var_g[use] > 0.0):
        low, high, half = gain_phase_band(g, np.sqrt(frf.var_g[use]))
        _error_bars(gain_ax, f, low, high, "95 % interval, measured")
        _error_bars(phase_ax, f, phase - half, phase + half, None)
    _points(gain_ax, f, _db(g), MEASURED, "measured", markersize=3.6, alpha=0.55)
    _points(phase_ax, f, phase, MEASURED, None, markersize=3.6, alpha=0.55)


def _draw_model(gain_ax: Axes, phase_ax: Axes, f, g, phase, model: RationalModel) -> None:
    if model.cov is not None:
        std_gain, std_phase = gain_phase_std(model, f)
        half_db = NORMAL_95 * 20.0 / np.log(10.0) * std_gain
        half_deg = NORMAL_95 * np.degrees(std_phase)
        band = {"color": MODEL, "alpha": 0.25, "linewidth": 0.0}
        gain_ax.fill_between(f, _db(g) - half_db, _db(g) + half_db, label="95 % band, model", **band)
        phase_ax.fill_between(f, phase - half_deg, phase + half_deg, **band)
    delay = delay_text(model.delay_s, model.fs_hz, model.std_delay_s)
    gain_ax.plot(f, _db(g), color=MODEL, label=f"model {order_text(model)}, delay {delay}")
    phase_ax.plot(f, phase, color=MODEL)


@_styled
def residual(model: RationalModel, frf: Frf) -> Figure:
    """Complex residual of every line against its 95 % noise bound; bands with an excess are shaded.

    Parameters
    ----------
    model : RationalModel
    frf : Frf

    Returns
    -------
    Figure
    """
    return _residual(frf, model.response(frf.f_hz[_line_mask(frf)]))


@_styled
def residual_of_plant(frf: Frf, g_model) -> Figure:
    """As `residual`, of a plant's output over its input.

    Parameters
    ----------
    frf : Frf
    g_model : (F,) complex array_like
        At the lines of `frf`.

    Returns
    -------
    Figure
    """
    return _residual(frf, np.asarray(g_model)[_line_mask(frf)])


def _residual(frf: Frf, g_model) -> Figure:
    use = _line_mask(frf)
    f, g = frf.f_hz[use], frf.g[use]
    error = np.abs(g - g_model)
    bound = complex_bound(np.sqrt(frf.var_g[use]), n_dof=_dof(frf))
    figure = _figure(3.9)
    ax = figure.subplots()
    ax.plot(f, _db(g), color=NOISE, linewidth=0.9, label="|G measured|")
    _draw_error(ax, f, error, bound, "|G measured − model|")
    for low, high in excess_bands(f, error > bound):
        _shade(ax, low, high, "more than chance explains")
    _frequency_axis(ax, f)
    _limits_db(ax, _db(g), _db(bound), _db(error))
    ax.set_ylabel(_db_label("magnitude", _text(_per(frf.y_unit, frf.u_unit))))
    ax.set_title(f"Complex residual: {_above_text(error, bound)}")
    _legend_below(figure, [ax])
    return figure


def _draw_error(ax: Axes, f, error, bound, label: str) -> None:
    """Error of every line, those above the bound in another colour."""
    above = error > bound
    ax.plot(f, _db(bound), color=EXCESS, linewidth=1.0, label="95 % noise bound")
    _points(ax, f[~above], _db(error[~above]), MODEL, label)
    if above.any():
        _points(ax, f[above], _db(error[above]), EXCESS, "above the bound", markersize=3.2)


def _above_text(error, bound) -> str:
    if not np.any(np.isfinite(bound)):
        return "the noise is not known"
    above = error > bound
    share = 100.0 * np.mean(above)
    return f"{np.sum(above)} of {len(above)} lines above the bound ({share:.3g} %; noise alone: 5 %)"


def _legend_below(figure: FigureBase, axes: Sequence[Axes]) -> None:
    """One legend for all axes, outside them, each entry once."""
    entries = {
        label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        entries.values(),
        entries.keys(),
        loc="outside lower center",
        ncols=min(len(entries), 5),
        fontsize=8.0,
        columnspacing=1.4,
        handletextpad=0.5,
    )


# --- comparison -------------------------------------------------------------------------------------------


def band_text(f_lo_hz: float, f_hi_hz: float) -> str:
    """A band in Hz, for example "0.5 to 6 Hz"; one frequency when both ends are the same."""
    low, high = f"{f_lo_hz:.3g}", f"{f_hi_hz:.3g}"
    return f"{low} Hz" if low == high else f"{low} to {high} Hz"


@_styled
def comparison(comparison: Comparison) -> Figure:
    """Error at the output against the noise: excited, odd and even lines apart, failing bands shaded.

    Parameters
    ----------
    comparison : Comparison

    Returns
    -------
    Figure
    """
    kind, f = np.asarray(comparison.kind), np.asarray(comparison.f_hz)
    error, sigma, y = (np.abs(np.asarray(a)) for a in (comparison.error, comparison.sigma, comparison.y))
    n_dof = (
        comparison.n_periods // comparison.n_records - 1
    )  # each line's variance is over one record's periods
    kinds = [k for k in KINDS if np.any((kind == k) & (f > 0.0))] or ["excited"]
    figure = _figure(1.0 + 2.1 * len(kinds))
    axes = np.atleast_1d(figure.subplots(len(kinds), 1, sharex=True, sharey=True))
    for ax, name in zip(axes, kinds, strict=True):
        use = (kind == name) & (f > 0.0)
        if name == "excited":
            ax.plot(f[use], _db(y[use]), color=NOISE, linewidth=0.9, label="|Y measured|")
        bound = complex_bound(sigma[use], n_dof=n_dof)
        _draw_error(ax, f[use], error[use], bound, "|Y measured − model|")
        for band in comparison.where:
            if band["lines"] == name and band["f_hi_hz"] > 0.0:  # a log axis has no place for an offset
                _draw_failing_band(ax, band)
        ax.set_title(
            f"{name.capitalize()} lines: {_above_text(error[use], bound)}" if use.any() else "No lines"
        )
        ax.set_ylabel(_db_label("|Y|", _text(comparison.y_unit)))
        _frequency_axis(ax, f[f > 0.0], label=ax is axes[-1])
    shown = f > 0.0
    _limits_db(axes[0], _db(y[shown & (kind == "excited")]), _db(error[shown]), _db(sigma[shown]), room=6.0)
    axes[0].set_ylim(top=axes[0].get_ylim()[1] + 10.0)  # for the shares
    _legend_below(figure, axes)
    return figure


def _draw_failing_band(ax: Axes, band: dict) -> None:
    low, high, share = band["f_lo_hz"], band["f_hi_hz"], band["share"]
    _shade(ax, low, high, "model fails, share of the excess")
    if share >= 0.005:
        ax.text(
            np.sqrt(low * high) if low > 0.0 else high,
            0.97,
            f"{100.0 * share:.0f} %",
            va="top",
            ha="center",
            transform=ax.get_xaxis_transform(),
            fontsize=8.5,
            color=EXCESS,
            clip_on=True,
        )


# --- the ladder -------------------------------------------------------------------------------------------


@_styled
def ladder(ladder: Ladder) -> Figure:
    """Error after each step, on the data fitted and on those kept out, against the noise floor.

    Parameters
    ----------
    ladder : Ladder
        With one step at least.

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        The ladder has no step.
    """
    rungs = ladder.rungs
    if not rungs:
        raise ValueError("the ladder has no step")
    levels = [rungs[0].before, *(rung.after for rung in rungs)]
    fitted = np.array([level["rms_error"] for level in levels])
    kept = np.array([rungs[0].held_out["before"], *(rung.held_out["after"] for rung in rungs)])
    floor = np.array([rungs[0].noise_floor_rms, *(rung.noise_floor_rms for rung in rungs)])
    figure = _figure(4.2)
    ax = figure.subplots()
    edges = np.arange(len(levels) + 1) - 0.5
    ax.stairs(floor, edges, baseline=None, color=NOISE, linewidth=1.2, linestyle="--", label="noise alone")
    ax.stairs(kept, edges, baseline=None, color=EXCESS, linewidth=2.4, label="on the data kept out")
    ax.stairs(fitted, edges, baseline=None, color=SIGNAL, linewidth=1.2, label="on the data fitted")
    for i, (error, noise) in enumerate(zip(kept, floor, strict=True)):
        ax.annotate(
            f"{error:.3g}, {error / noise:.3g} × noise",
            (i, error),
            (0, 5),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=8.5,
            color=EXCESS,
        )
    ax.set_yscale("log")
    everything = np.concatenate([fitted, kept, floor])
    ax.set_ylim(0.75 * everything.min(), 1.6 * everything.max())
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=50))
    ax.yaxis.set_major_formatter(FuncFormatter(_plain))
    ax.yaxis.set_minor_formatter(NullFormatter())
    names = ["as it was", *(f"+ {rung.effect}" for rung in rungs)]
    if len(names) > 4:
        names = [name.replace("_", "_\n", 1) for name in names]
    costs = [f"cost per d.o.f. {level['cost_per_dof']:.4g}" for level in levels]
    ax.set_xticks(range(len(levels)), [f"{name}\n{cost}" for name, cost in zip(names, costs, strict=True)])
    ax.set_xlim(-0.55, len(levels) - 0.45)
    ax.grid(False, axis="x")
    ax.set_ylabel(_with_unit("rms error", _text(rungs[0].y_unit)))
    ax.set_title(f"Error after each step, judged on {_text(rungs[-1].kept_out)}")
    _legend_below(figure, [ax])
    return figure


# --- the torque that is missing ---------------------------------------------------------------------------


@_styled
def torque_residual(residual: TorqueResidual) -> Figure:
    """Missing torque against rate, angle, command and time, with bars of two standard deviations.

    Parameters
    ----------
    residual : TorqueResidual

    Returns
    -------
    Figure
    """
    figure = _figure(5.8)
    best = max(residual.curves[:3], key=lambda curve: curve.explained)
    best = best if best.explained > 0.1 else None  # noise gives every curve a little
    for ax, curve in zip(figure.subplots(2, 2).ravel(), residual.curves, strict=True):
        colour = EXCESS if curve is best else MODEL
        low, high = curve.torque - 2 * curve.std, curve.torque + 2 * curve.std
        ax.axhline(0.0, color="#999999", linewidth=0.8, zorder=0.8)
        ax.fill_between(curve.at, low, high, color=colour, alpha=0.25, linewidth=0.0)
        ax.plot(curve.at, curve.torque, color=colour, marker="o", linewidth=1.0)
        _draw_occupancy(ax, curve)
        share = f": {100 * curve.explained:.0f} % of its mean square"
        ax.set_title(f"against {curve.name}{', in the first record' if curve is residual.time else share}")
        ax.set_xlabel(_with_unit(curve.name, _text(curve.unit)))
        ax.set_ylabel(_with_unit("torque / inertia", _text(residual.unit)))
    figure.suptitle(
        f"Torque that is missing ({residual.rms:.3g} {_text(residual.unit)} rms), ±2 σ: where to look, "
        "not a verdict. Grey: how often the axis is there.",
        fontsize=9.5,
    )
    return figure


def _draw_occupancy(ax: Axes, curve: Curve) -> None:
    """How often each bin is visited, along the bottom."""
    if np.ptp(curve.share) > 0.5 * curve.share.max():
        width = np.min(np.diff(curve.at)) if len(curve.at) > 1 else 1.0
        height = 0.12 * curve.share / curve.share.max()
        ax.bar(curve.at, height, width, color=NOISE, alpha=0.35, transform=ax.get_xaxis_transform())


# --- poles and zeros --------------------------------------------------------------------------------------


@_styled
def pole_zero(model: RationalModel) -> Figure:
    """Pole-zero map of the upper half-plane, and every root close up with its 95 % confidence region.

    Parameters
    ----------
    model : RationalModel

    Returns
    -------
    Figure
        In domain "s" in Hz (s / 2 pi). Where the roots spread over decades the map's radius is logarithmic;
        the angle, and with it the damping, is kept.
    """
    scale = 2.0 * np.pi if model.domain == "s" else 1.0
    roots = [
        (mark, complex(root) / scale, np.asarray(cov) / scale**2)
        for mark, found, covs in (
            ("pole", model.poles, model.pole_cov),
            ("zero", model.zeros, model.zero_cov),
        )
        for root, cov in sorted(zip(found, covs, strict=True), key=lambda pair: abs(pair[0]))
        if root.imag >= -1e-9 * abs(root)
    ]
    close_ups = [r for r in roots if np.all(np.isfinite(r[2])) and np.any(r[2] > 0.0)][:6]
    n_columns = -(-len(close_ups) // 2) if len(close_ups) > 2 else min(len(close_ups), 1)
    figure = _figure(4.6)
    if n_columns:
        left, right = figure.subfigures(1, 2, width_ratios=[2.2, n_columns + 0.4], wspace=0.02)
        small = np.atleast_1d(right.subplots(min(len(close_ups), 2), n_columns)).ravel()
        for ax in small[len(close_ups) :]:
            ax.set_axis_off()
        for ax, (mark, root, cov) in zip(small, close_ups, strict=False):
            _draw_close_up(ax, mark, root, cov, "Hz" if model.domain == "s" else "")
        right.suptitle("Close up, with 95 % confidence regions", fontsize=9.5)
    else:
        left = figure
    ax = left.subplots()
    place = (
        _draw_z_grid(ax, model.fs_hz)
        if model.domain == "z"
        else _draw_s_grid(ax, [r for _, r, cov in roots if not _may_be_zero(r, cov)])
    )
    for _mark, root, cov in roots:
        if np.all(np.isfinite(cov)):
            _draw_region(ax, place(confidence_ellipse(root, cov)), "95 % confidence region")
    for mark, symbol in (("pole", "x"), ("zero", "o")):
        at = place(np.array([r for m, r, _ in roots if m == mark], dtype=complex))
        if len(at):
            _root_marks(ax, at, symbol, f"{mark}s")
    ax.set_title("Poles and zeros, upper half-plane")
    _legend_below(left, [ax])
    return figure


def _may_be_zero(root: complex, cov) -> bool:
    """An integrator, as far as the data tell."""
    std = np.sqrt(np.trace(cov)) if np.all(np.isfinite(cov)) else 0.0
    return abs(root) <= NORMAL_95 * std


def _draw_region(ax: Axes, outline, label: str | None = None) -> None:
    ax.fill(
        outline.real,
        outline.imag,
        facecolor=to_rgba(EXCESS, 0.25),
        edgecolor=EXCESS,
        linewidth=1.0,
        label=label,
    )


def _root_marks(ax: Axes, at, symbol: str, label: str | None) -> None:
    ax.plot(
        at.real,
        at.imag,
        symbol,
        color=MODEL,
        markersize=7.0,
        markeredgewidth=1.6,
        markerfacecolor="none",
        label=label,
        linestyle="none",
        clip_on=False,
        zorder=3,
    )


def _draw_close_up(ax: Axes, mark: str, root: complex, cov, unit: str) -> None:
    outline = confidence_ellipse(root, cov) - root
    _draw_region(ax, outline)
    _root_marks(ax, np.array([0j]), "x" if mark == "pole" else "o", None)
    reach = 1.35 * np.max(np.abs([outline.real, outline.imag]))
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-reach, reach)
    ax.set_aspect("equal")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(3))
        axis.set_major_formatter(FuncFormatter(_plain))
    ax.set_xlabel(_with_unit("Δ real", unit), fontsize=8.0)
    ax.set_ylabel(_with_unit("Δ imag", unit), fontsize=8.0)
    ax.tick_params(labelsize=7.5)
    ax.set_title(f"{root_text(root)} {unit}".rstrip(), fontsize=8.0, loc="center")


def root_text(root: complex) -> str:
    """A root, or both of a conjugate pair, for example "-0.867 ± 13.1j"."""
    if abs(root.imag) <= 1e-9 * abs(root):
        return f"{root.real:.4g}".replace("-", "−")
    return f"{root.real:.4g} ± {abs(root.imag):.5g}j".replace("-", "−")


def _draw_s_grid(ax: Axes, roots: Sequence[complex]) -> Callable[[np.ndarray], np.ndarray]:
    """Damping rays and frequency circles around roots [Hz] other than 0; returns the map to the drawing.

    On a log radius, what lies inside the innermost circle is drawn at the origin.
    """
    sizes = np.abs(roots) if len(roots) else np.ones(1)
    is_log = sizes.max() / sizes.min() > 12.0
    if is_log:
        inner = 10.0 ** np.floor(np.log10(sizes.min()) - 0.5)

        def place(s):
            s = np.asarray(s, dtype=complex)
            return np.log10(np.maximum(np.abs(s), inner) / inner) * np.exp(1j * np.angle(s))

        rings = 10.0 ** np.arange(np.log10(inner) + 1.0, np.log10(sizes.max()) + 1.0)
        outer = abs(place(1.35 * sizes.max()))
        ticks = [ring for ring in (m * d for d in rings / 10.0 for m in (1.0, 2.0, 5.0)) if inner < ring]
        if len(ticks) > 8:
            ticks = [d for d in rings if d <= 1.35 * sizes.max()]
    else:

        def place(s):
            return np.asarray(s, dtype=complex)

        outer = 1.2 * sizes.max()
        ticks = [t for t in MaxNLocator(4).tick_values(0.0, outer) if t > 0.0]
    right = outer if any(r.real > 0 for r in roots) else 0.12 * outer
    turn = np.linspace(0.0, np.pi, 181)
    for tick in ticks:
        radius = abs(place(tick))
        if 0.0 < radius <= outer:
            ax.plot(radius * np.cos(turn), radius * np.sin(turn), **GRID_LINE)
            ax.text(0.015 * outer, radius, f"{tick:g} Hz", va="bottom", **GRID_TEXT)
    for damping in (0.1, 0.3, 0.5, 0.7, 0.9):
        along = outer * np.exp(1j * (np.pi - np.arccos(damping)))
        for sign in (1.0, -1.0) if right == outer else (1.0,):
            ax.plot([0.0, sign * along.real], [0.0, along.imag], linestyle=":", **GRID_LINE)
        ax.text(1.03 * along.real, 1.03 * along.imag, f"ζ {damping:g}", ha="right", va="center", **GRID_TEXT)
    ax.axhline(0.0, color="#999999", linewidth=0.8, zorder=0.8)
    ax.axvline(0.0, color="#999999", linewidth=0.8, zorder=0.8)
    ax.set_aspect("equal")
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.set_xlim(-1.14 * outer, 1.05 * right)
    ax.set_ylim(-0.06 * outer, 1.08 * outer)
    ax.grid(False)
    ax.set_xlabel("real part [Hz]" + (", log radius" if is_log else ""))
    ax.set_ylabel("imaginary part [Hz]" + (", log radius" if is_log else ""))
    if is_log:
        ax.set_xticks([])
        ax.set_yticks([])
    return place


def _draw_z_grid(ax: Axes, fs_hz: float) -> Callable[[np.ndarray], np.ndarray]:
    turn = np.linspace(0.0, np.pi, 181)
    ax.plot(np.cos(turn), np.sin(turn), color="#999999", linewidth=0.9, zorder=0.8)
    for damping in (0.1, 0.3, 0.5, 0.7, 0.9):
        angle = turn * np.sqrt(1.0 - damping**2)
        spiral = np.exp(-damping * turn + 1j * angle)
        ax.plot(spiral.real, spiral.imag, linestyle=":", **GRID_LINE)
    for part in (0.1, 0.2, 0.3, 0.4):
        at = np.exp(2j * np.pi * part)
        ax.text(
            1.04 * at.real,
            1.04 * at.imag,
            f"{part * fs_hz:g} Hz",
            ha="left" if at.real > 0 else "right",
            **GRID_TEXT,
        )
    ax.axhline(0.0, color="#999999", linewidth=0.8, zorder=0.8)
    ax.set_aspect("equal")
    ax.set_xlim(-1.35, 1.35)
    ax.set_ylim(-0.08, 1.15)
    ax.grid(False)
    ax.set_xlabel("real part of z")
    ax.set_ylabel("imaginary part of z")
    return lambda z: np.asarray(z, dtype=complex)
