"""Picture of a fitted plant: measured and simulated output over input, and the error over its noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from gsid.models.confidence import complex_bound, unwrapped_phase_deg
from gsid.plots.style import (
    BOUND_OF_NOISE,
    EVEN,
    EXCESS,
    MEASURED,
    MODEL,
    SIGNAL,
    above_text,
    db,
    db_label,
    draw_points,
    frequency_axis,
    legend_below,
    limits_db,
    new_figure,
    per_unit,
    phase_axis,
    plain_text,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.greybox.fit import PlantFit, RecordFit


@styled
def plant_fit(fit: PlantFit) -> Figure:
    """Output over input of every record, measured and simulated, and the error over the noise of each line.

    Parameters
    ----------
    fit : PlantFit

    Returns
    -------
    Figure
        Above, gain and phase at the excited lines of the band; below, the error of the output over the
        noise of its mean, at excited and other lines.
    """
    figure = new_figure(8.0)
    gain_ax, phase_ax, error_ax = figure.subplots(3, 1, sharex=True, height_ratios=[3, 2, 3])
    gains = [_draw_response(gain_ax, phase_ax, one) for one in fit.records]
    f = np.concatenate([_frequencies(one)[1] for one in fit.records])
    for ax in (gain_ax, phase_ax, error_ax):
        frequency_axis(ax, f, label=ax is error_ax)
    limits_db(gain_ax, *gains)
    first = fit.records[0].spectra
    gain_ax.set_ylabel(db_label("|G|", plain_text(per_unit(first.y_unit, first.u_unit))))
    several = f" of {len(fit.records)} records" if len(fit.records) > 1 else ""
    gain_ax.set_title(f"Output over input{several} at the excited lines")
    phase_axis(phase_ax)
    _draw_errors(error_ax, fit)
    legend_below(figure, [gain_ax, error_ax])
    return figure


def _frequencies(one: RecordFit) -> tuple[np.ndarray, np.ndarray]:
    """Lines of the band above 0 Hz, as indices into `one.line`, and their frequencies [Hz]."""
    index = np.flatnonzero(one.line > 0)
    return index, one.spectra.f_hz[one.line[index]]


def _draw_response(gain_ax: Axes, phase_ax: Axes, one: RecordFit) -> np.ndarray:
    """Draw one record; returns the gains drawn [dB]."""
    measured = one.spectra
    line = one.line[(one.line > 0) & measured.excited[one.line]]
    f, u = measured.f_hz[line], measured.u[line]
    g, g_model = measured.y[line] / u, one.prediction.Y[line] / u
    phase_model = unwrapped_phase_deg(f, g_model)
    phase = phase_model + np.degrees(np.angle(g * np.conj(g_model)))
    for ax, at_lines, simulated, label in (
        (gain_ax, db(g), db(g_model), True),
        (phase_ax, phase, phase_model, False),
    ):
        draw_points(ax, f, at_lines, MEASURED, "measured" if label else None, markersize=3.6, alpha=0.55)
        ax.plot(f, simulated, color=MODEL, linewidth=1.0, label="model" if label else None)
    return np.concatenate([db(g), db(g_model)])


def _draw_errors(ax: Axes, fit: PlantFit) -> None:
    """Draw |Y measured - model| over the standard deviation of the mean, in dB, of all records together."""
    f, error, excited = [], [], []
    for one in fit.records:
        index, at = _frequencies(one)
        re, im = one.residual.reshape(2, -1)[:, index]
        f.append(at)
        error.append(np.hypot(re, im) / np.sqrt(2))  # a residual has variance 1 in each part
        excited.append(one.spectra.excited[one.line[index]])
    f, error, excited = np.concatenate(f), np.concatenate(error), np.concatenate(excited)
    dof = fit.variance_dof
    sigma = np.sqrt((dof - 1) / dof)  # the residuals have mean square 1 beside a sample variance
    bound = complex_bound(np.full(len(f), sigma), n_dof=dof)
    above = error > bound
    ax.axhline(float(db(bound[0])), color=EXCESS, linewidth=1.0, label=BOUND_OF_NOISE)
    for use, colour, label in (
        (excited, SIGNAL, "error, excited lines"),
        (~excited, EVEN, "error, other lines"),
    ):
        if use.any():
            draw_points(ax, f[use & ~above], db(error[use & ~above]), colour, label)
            draw_points(ax, f[use & above], db(error[use & above]), colour, None, marker="^", markersize=4.0)
    limits_db(ax, db(error), db(bound))
    ax.set_ylabel("|Y measured − model| / σ [dB]")
    ax.set_title(f"Error of the output over its noise: {above_text(error, bound)}")
