"""Pictures of frequency responses: measured, fitted, and the difference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gsid.models.confidence import (
    NORMAL_95,
    complex_bound,
    excess_bands,
    gain_phase_band,
    gain_phase_std,
    unwrapped_phase_deg,
)
from gsid.plots.style import (
    EVEN,
    MEASURED,
    MODEL,
    NOISE,
    SIGNAL,
    above_text,
    band_text,
    db,
    db_label,
    degrees_of_freedom,
    delay_text,
    draw_error,
    draw_error_bars,
    draw_points,
    frequency_axis,
    legend_below,
    limits_db,
    line_mask,
    new_figure,
    order_text,
    per_unit,
    phase_axis,
    plain_text,
    shade_band,
    styled,
)

if TYPE_CHECKING:
    from gsid.models.piecewise import PiecewiseModel
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf


@styled
def frf(frf: Frf) -> Figure:
    """Measured frequency response, with the noise's standard deviation in the same dB axis.

    Parameters
    ----------
    frf : Frf

    Returns
    -------
    Figure
    """
    use = line_mask(frf)
    f, g, sigma = frf.f_hz[use], frf.g[use], np.sqrt(frf.var_g[use])
    figure = new_figure(5.2)
    gain_ax, phase_ax = figure.subplots(2, 1, height_ratios=[3, 2])
    draw_points(gain_ax, f, db(g), SIGNAL, f"|G| measured, {len(f)} lines")
    known = np.isfinite(sigma) & (sigma > 0.0)
    if known.any():
        draw_points(
            gain_ax,
            f[known],
            db(sigma[known]),
            NOISE,
            f"σ of the noise on G, {_averaged(frf)}",
            markersize=2.0,
        )
    frequency_axis(gain_ax, f, label=False)
    limits_db(gain_ax, db(g), db(sigma[known]))
    gain_ax.set_ylabel(db_label("|G|, σ", plain_text(per_unit(frf.y_unit, frf.u_unit))))
    gain_ax.legend(loc="best")
    draw_points(phase_ax, f, unwrapped_phase_deg(f, g, np.where(known, sigma, 0.0)), SIGNAL, None)
    frequency_axis(phase_ax, f)
    phase_axis(phase_ax)
    return figure


def _averaged(frf: Frf) -> str:
    """Text on the averaging of a response, with the method if it is not the mean over periods."""
    piece = "window" if frf.method == "windows" else "period"
    words = f"mean of {frf.n_periods} {piece}{'s' * (frf.n_periods != 1)}"
    if frf.n_realisations > 1:
        words += f" of {frf.n_realisations} realisations"
    how = {"lpm": ", transient by local polynomials", "windows": ", H1 from the coherence"}
    return words + how.get(frf.method, "")


def _dense(f, *roots) -> np.ndarray:
    """Frequencies at which a model is drawn: even in log f, plus the lines, and dense at sharp resonances."""
    grid = [np.geomspace(f.min(), f.max(), 600), f]
    for root in np.concatenate([np.atleast_1d(r) for r in roots]) / (2.0 * np.pi):
        width = max(abs(root.real), 1e-4 * abs(root))
        grid.append(abs(root.imag) + width * np.linspace(-4.0, 4.0, 33))
    grid = np.unique(np.concatenate(grid))
    return grid[(grid >= f.min()) & (grid <= f.max())]


@styled
def bode(model: RationalModel, frf: Frf | None = None) -> Figure:
    """Fitted model with 95 % bands of gain and phase, and the measured response if it is given.

    Parameters
    ----------
    model : RationalModel
    frf : Frf, optional

    Returns
    -------
    Figure
    """
    f = _band_of(model) if frf is None else frf.f_hz[line_mask(frf)]
    fine = _dense(f, model.poles, model.zeros) if model.domain == "s" else _dense(f, [])
    g_model = model.response(fine)
    phase_model = unwrapped_phase_deg(fine, g_model)
    figure = new_figure(6.0)
    gain_ax, phase_ax = figure.subplots(2, 1, height_ratios=[3, 2])
    if frf is not None:
        _draw_measured(gain_ax, phase_ax, frf, model.response(f), np.interp(f, fine, phase_model))
    _draw_model(gain_ax, phase_ax, fine, g_model, phase_model, model)
    limits_db(gain_ax, db(g_model), *([] if frf is None else [db(frf.g[line_mask(frf)])]))
    gain_ax.set_ylabel(db_label("|G|", plain_text(per_unit(model.y_unit, model.u_unit))))
    frequency_axis(gain_ax, f, label=False)
    frequency_axis(phase_ax, f)
    phase_axis(phase_ax)
    legend_below(figure, [gain_ax])
    return figure


@styled
def piecewise(model: PiecewiseModel, frf: Frf | None = None) -> Figure:
    """Models of adjoining bands, each in its band, over the measured response if it is given.

    Parameters
    ----------
    model : PiecewiseModel
    frf : Frf, optional

    Returns
    -------
    Figure
    """
    f = _band_of(model) if frf is None else frf.f_hz[line_mask(frf)]
    fine = _dense(f, *([piece.poles for piece in model.pieces] if model.pieces[0].domain == "s" else [[]]))
    g = model.response(fine)
    std = model.response_std(fine)
    phase = unwrapped_phase_deg(fine, g)
    figure = new_figure(6.0)
    gain_ax, phase_ax = figure.subplots(2, 1, height_ratios=[3, 2])
    if frf is not None:
        _draw_measured(gain_ax, phase_ax, frf, model.response(f), np.interp(f, fine, phase))
    for i, piece in enumerate(model.pieces):
        use = model.piece_at(fine) == i
        colour = MODEL if i % 2 == 0 else EVEN
        low, high, half = gain_phase_band(g[use], std[use])
        gain_ax.fill_between(fine[use], low, high, color=colour, alpha=0.25, linewidth=0.0)
        phase_ax.fill_between(
            fine[use], phase[use] - half, phase[use] + half, color=colour, alpha=0.25, linewidth=0.0
        )
        label = f"model {order_text(piece)} with its 95 % band, {band_text(*piece.band_hz)}"
        gain_ax.plot(fine[use], db(g[use]), color=colour, label=label if piece.band_hz else None)
        phase_ax.plot(fine[use], phase[use], color=colour)
    for ax in (gain_ax, phase_ax):
        for at in model.breaks_hz:
            ax.axvline(at, color=NOISE, linewidth=0.8, linestyle="--")
    limits_db(gain_ax, db(g), *([] if frf is None else [db(frf.g[line_mask(frf)])]))
    gain_ax.set_ylabel(db_label("|G|", plain_text(per_unit(model.y_unit, model.u_unit))))
    frequency_axis(gain_ax, f, label=False)
    frequency_axis(phase_ax, f)
    phase_axis(phase_ax)
    legend_below(figure, [gain_ax])
    return figure


def _band_of(model: RationalModel | PiecewiseModel) -> np.ndarray:
    """Band in which a model is drawn without data: the band of its fit, or around its roots; below fs/2."""
    band = model.band_hz
    if band is None:
        roots = np.abs(np.concatenate([model.poles, model.zeros])) / (2.0 * np.pi)
        roots = roots[roots > 0.0] if model.domain == "s" else roots[:0]
        top = 0.499 * model.fs_hz if model.fs_hz else 100.0
        band = (0.1 * roots.min(), 10.0 * roots.max()) if len(roots) else (1e-3 * top, top)
    high = min(band[1], 0.499 * model.fs_hz) if model.fs_hz else band[1]
    return np.geomspace(max(band[0], 1e-4 * high), high, 200)


@styled
def bode_of_plant(frf: Frf, g_model) -> Figure:
    """Measured response with 95 % intervals, and the simulated output of a plant over its input.

    Parameters
    ----------
    frf : Frf
    g_model : (F,) complex array_like
        The plant's output over its input at the lines of `frf`.

    Returns
    -------
    Figure
    """
    use = line_mask(frf)
    f, g_model = frf.f_hz[use], np.asarray(g_model)[use]
    phase_model = unwrapped_phase_deg(f, g_model)
    figure = new_figure(6.0)
    gain_ax, phase_ax = figure.subplots(2, 1, height_ratios=[3, 2])
    _draw_measured(gain_ax, phase_ax, frf, g_model, phase_model)
    gain_ax.plot(f, db(g_model), color=MODEL, label="model, output over input at the excited lines")
    phase_ax.plot(f, phase_model, color=MODEL)
    limits_db(gain_ax, db(g_model), db(frf.g[use]))
    gain_ax.set_ylabel(db_label("|G|", plain_text(per_unit(frf.y_unit, frf.u_unit))))
    frequency_axis(gain_ax, f, label=False)
    frequency_axis(phase_ax, f)
    phase_axis(phase_ax)
    legend_below(figure, [gain_ax])
    return figure


def _draw_measured(gain_ax: Axes, phase_ax: Axes, frf: Frf, g_model, phase_model) -> None:
    """Unwrap the measured phase with the phase of the model, which is robust to noise."""
    use = line_mask(frf)
    f, g = frf.f_hz[use], frf.g[use]
    phase = phase_model + np.degrees(np.angle(g * np.conj(g_model)))
    if np.any(frf.var_g[use] > 0.0):
        low, high, half = gain_phase_band(g, np.sqrt(frf.var_g[use]))
        draw_error_bars(gain_ax, f, low, high, "95 % interval, measured")
        draw_error_bars(phase_ax, f, phase - half, phase + half, None)
    draw_points(gain_ax, f, db(g), MEASURED, "measured", markersize=3.6, alpha=0.55)
    draw_points(phase_ax, f, phase, MEASURED, None, markersize=3.6, alpha=0.55)


def _draw_model(gain_ax: Axes, phase_ax: Axes, f, g, phase, model: RationalModel) -> None:
    if model.cov is not None:
        std_gain, std_phase = gain_phase_std(model, f)
        half_db = NORMAL_95 * 20.0 / np.log(10.0) * std_gain
        half_deg = np.minimum(
            NORMAL_95 * np.degrees(std_phase), 180.0
        )  # beyond, it is unknown: at a deep zero
        band = {"color": MODEL, "alpha": 0.25, "linewidth": 0.0}
        gain_ax.fill_between(f, db(g) - half_db, db(g) + half_db, label="95 % band, model", **band)
        phase_ax.fill_between(f, phase - half_deg, phase + half_deg, **band)
    delay = delay_text(model.delay_s, model.fs_hz, model.std_delay_s)
    gain_ax.plot(f, db(g), color=MODEL, label=f"model {order_text(model)}, delay {delay}")
    phase_ax.plot(f, phase, color=MODEL)


@styled
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
    return _residual(frf, model.response(frf.f_hz[line_mask(frf)]))


@styled
def residual_of_plant(frf: Frf, g_model) -> Figure:
    """As `residual`, for the output of a plant over its input.

    Parameters
    ----------
    frf : Frf
    g_model : (F,) complex array_like
        At the lines of `frf`.

    Returns
    -------
    Figure
    """
    return _residual(frf, np.asarray(g_model)[line_mask(frf)])


def _residual(frf: Frf, g_model) -> Figure:
    use = line_mask(frf)
    f, g = frf.f_hz[use], frf.g[use]
    error = np.abs(g - g_model)
    bound = complex_bound(np.sqrt(frf.var_g[use]), n_dof=degrees_of_freedom(frf))
    figure = new_figure(3.9)
    ax = figure.subplots()
    ax.plot(f, db(g), color=NOISE, linewidth=0.9, label="|G measured|")
    draw_error(ax, f, error, bound, "|G measured − model|")
    for low, high in excess_bands(f, error > bound):
        shade_band(ax, low, high, "more than chance explains")
    frequency_axis(ax, f)
    limits_db(ax, db(g), db(bound), db(error))
    ax.set_ylabel(db_label("magnitude", plain_text(per_unit(frf.y_unit, frf.u_unit))))
    ax.set_title(f"Complex residual: {above_text(error, bound)}")
    legend_below(figure, [ax])
    return figure
