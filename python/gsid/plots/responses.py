"""Several frequency responses and their uncertainties in one picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gsid.models.confidence import unwrapped_phase_deg
from gsid.plots.style import (
    EVEN,
    EXCESS,
    MEASURED,
    MODEL,
    NOISE,
    db,
    db_label,
    draw_points,
    frequency_axis,
    legend_below,
    limits_db,
    line_mask,
    new_figure,
    per_unit,
    phase_axis,
    plain_text,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.models.piecewise import PiecewiseModel
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf

COLOURS = (MEASURED, MODEL, EXCESS, EVEN, "#CC79A7", "#56B4E9", "#E69F00")


@styled
def responses(shown: Sequence[tuple[str, Frf]]) -> Figure:
    """Gain, phase and standard deviation of several responses (thesis, figures 4.25 and 4.26).

    Parameters
    ----------
    shown : sequence of (str, Frf)
        Each response with its text in the legend.

    Returns
    -------
    Figure
    """
    figure = new_figure(7.6)
    gain_ax, phase_ax, sigma_ax = figure.subplots(3, 1, height_ratios=[3, 2, 3])
    lines, gains, sigmas = [], [], []
    for i, (text, one) in enumerate(shown):
        use, colour = line_mask(one), COLOURS[i % len(COLOURS)]
        f, g, sigma = one.f_hz[use], one.g[use], np.sqrt(one.var_g[use])
        known = np.isfinite(sigma) & (sigma > 0.0)
        lines.append(f)
        gains.append(db(g))
        sigmas.append(db(sigma[known]))
        phase = unwrapped_phase_deg(f, g, np.where(known, sigma, 0.0))
        draw_points(gain_ax, f, gains[-1], colour, plain_text(text), markersize=2.4)
        draw_points(phase_ax, f, phase, colour, None, markersize=2.4)
        sigma_ax.plot(f[known], sigmas[-1], color=colour, linewidth=0.8)
    limits_db(gain_ax, *gains)
    limits_db(sigma_ax, *sigmas)
    unit = plain_text(per_unit(shown[0][1].y_unit, shown[0][1].u_unit))
    gain_ax.set_ylabel(db_label("|G|", unit))
    sigma_ax.set_ylabel(db_label("σ of G", unit))
    phase_axis(phase_ax)
    every = np.sort(np.concatenate(lines))
    for ax in (gain_ax, phase_ax, sigma_ax):
        frequency_axis(ax, every, label=ax is sigma_ax)
    legend_below(figure, [gain_ax])
    return figure


@styled
def model_errors(measured: Frf, models: Sequence[tuple[str, RationalModel | PiecewiseModel]]) -> Figure:
    """Errors of several models beside the measured gain (thesis, figure 7.16).

    Parameters
    ----------
    measured : Frf
    models : sequence of (str, model)
        Each model with its text in the legend, for example by rising order.

    Returns
    -------
    Figure
        An error 26 dB below the gain is one of 5 %.
    """
    use = line_mask(measured)
    f, g, sigma = measured.f_hz[use], measured.g[use], np.sqrt(measured.var_g[use])
    figure = new_figure(4.6)
    ax = figure.subplots()
    known = np.isfinite(sigma) & (sigma > 0.0)
    ax.plot(f[known], db(sigma[known]), color=NOISE, linewidth=0.7, label="σ of the noise on G")
    ax.plot(f, db(g), color=MEASURED, linewidth=1.2, linestyle="--", label="|G measured|")
    for i, (text, model) in enumerate(models):
        error = np.abs(g - model.response(f))
        share = 100 * float(np.sqrt(np.mean(error**2) / np.mean(np.abs(g) ** 2)))
        colour = COLOURS[1 + i % (len(COLOURS) - 1)]
        label = plain_text(f"|error| of {text}: {share:.2g} % rms")
        ax.plot(f, db(error), color=colour, linewidth=0.9, label=label)
    limits_db(ax, db(g), db(sigma[known]))
    frequency_axis(ax, f)
    ax.set_ylabel(db_label("magnitude", plain_text(per_unit(measured.y_unit, measured.u_unit))))
    legend_below(figure, [ax])
    return figure
