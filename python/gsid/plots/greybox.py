"""Picture of a fitted plant: measured and simulated output over input, and the error over its noise."""

from __future__ import annotations

from collections.abc import Sequence
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
    from gsid.spectrum.spectra import Spectra


@styled
def plant_fit(fit: PlantFit, measured: Sequence[Spectra]) -> Figure:
    """Output over input of every record, measured and simulated, and the error over the noise of each line.

    Parameters
    ----------
    fit : PlantFit
    measured : sequence of Spectra
        Records of the fit, in the same order.

    Returns
    -------
    Figure
        Above, gain and phase at the excited lines of the band; below, the error of the output over the
        noise of its mean, at excited and other lines.

    Raises
    ------
    ValueError
        The number of records is not that of the fit.
    """
    if len(measured) != len(fit.records):
        raise ValueError(f"the fit has {len(fit.records)} records, {len(measured)} were given")
    figure = new_figure(8.0)
    gain_ax, phase_ax, error_ax = figure.subplots(3, 1, sharex=True, height_ratios=[3, 2, 3])
    gains = [
        _draw_response(gain_ax, phase_ax, one, record)
        for one, record in zip(fit.records, measured, strict=True)
    ]
    f = np.concatenate([_frequencies(one, s)[1] for one, s in zip(fit.records, measured, strict=True)])
    for ax in (gain_ax, phase_ax, error_ax):
        frequency_axis(ax, f, label=ax is error_ax)
    limits_db(gain_ax, *gains)
    gain_ax.set_ylabel(db_label("|G|", plain_text(per_unit(measured[0].y_unit, measured[0].u_unit))))
    several = f" of {len(measured)} records" if len(measured) > 1 else ""
    gain_ax.set_title(f"Output over input{several} at the excited lines")
    phase_axis(phase_ax)
    _draw_errors(error_ax, fit, measured)
    legend_below(figure, [gain_ax, error_ax])
    return figure


def _frequencies(one: RecordFit, measured: Spectra) -> tuple[np.ndarray, np.ndarray]:
    """Lines of the band above 0 Hz, as indices into `one.line`, and their frequencies [Hz]."""
    index = np.flatnonzero(one.line > 0)
    return index, measured.f_hz[one.line[index]]


def _draw_response(gain_ax: Axes, phase_ax: Axes, one: RecordFit, measured: Spectra) -> np.ndarray:
    """Draw one record; returns the gains drawn [dB]."""
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


def _draw_errors(ax: Axes, fit: PlantFit, measured: Sequence[Spectra]) -> None:
    """Draw |Y measured - model| over the standard deviation of the mean, in dB, of all records together."""
    f, error, excited = [], [], []
    for one, record in zip(fit.records, measured, strict=True):
        index, at = _frequencies(one, record)
        re, im = one.residual.reshape(2, -1)[:, index]
        f.append(at)
        error.append(np.hypot(re, im) / np.sqrt(2))  # a residual has variance 1 in each part
        excited.append(record.excited[one.line[index]])
    f, error, excited = np.concatenate(f), np.concatenate(error), np.concatenate(excited)
    bound = complex_bound(np.ones(len(f)), n_dof=fit.variance_dof)
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
