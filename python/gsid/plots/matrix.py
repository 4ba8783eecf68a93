"""Picture of a matrix of frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from gsid.models.confidence import NORMAL_95
from gsid.plots.style import (
    MEASURED,
    MODEL,
    db,
    db_label,
    draw_error_bars,
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
    from gsid.models.mimo import MimoModel
    from gsid.response.mimo import MimoFrf


@styled
def bode_matrix(model: MimoModel, frf: MimoFrf | None = None) -> Figure:
    """A Bode diagram for each pair of output (row) and input (column), with 95 % bands.

    Parameters
    ----------
    model : MimoModel
    frf : MimoFrf, optional
        The measured responses, drawn behind those of the model.

    Returns
    -------
    Figure
    """
    f = _frequencies(model, frf)
    g, std = model.response(f), model.response_std(f)
    figure = new_figure(1.4 + 3.2 * model.n_y)
    gain_axes = np.empty((model.n_y, model.n_u), dtype=object)
    axes = figure.subplots(
        2 * model.n_y, model.n_u, squeeze=False, sharex=True, height_ratios=[3, 2] * model.n_y
    )
    for i, j in np.ndindex(model.n_y, model.n_u):
        gain, phase = axes[2 * i, j], axes[2 * i + 1, j]
        gain_axes[i, j] = gain
        if frf is not None:
            _draw_measured(gain, phase, frf, i, j)
        _draw_model(gain, phase, f, g[:, i, j], std[:, i, j])
        gain.set_title(plain_text(f"{model.inputs[j]} → {model.outputs[i]}"), fontsize="small")
        frequency_axis(gain, f, label=False)
        frequency_axis(phase, f, label=i == model.n_y - 1)
        phase.set_ylim(-190, 190)
        phase_axis(phase)
        phase.set_ylabel("phase [deg]" if j == 0 else "", fontsize="small")
        if j == 0 or len(set(model.u_units)) > 1:
            unit = plain_text(per_unit(model.y_units[i], model.u_units[j]))
            gain.set_ylabel(db_label("|G|", unit), fontsize="small")
        for ax in (gain, phase):
            ax.tick_params(labelsize="x-small")
            if model.n_u > 2:  # no room for 2 and 5
                ax.xaxis.set_major_locator(LogLocator(numticks=9))
    for row in gain_axes:  # one scale for each row, because outputs may differ in size
        low, high = np.array([ax.get_ylim() for ax in row]).T
        for ax in row:
            ax.set_ylim(low.min(), high.max())
    legend_below(figure, [gain_axes[0, 0]])
    return figure


def _frequencies(model: MimoModel, frf: MimoFrf | None) -> np.ndarray:
    """The measured lines, or a grid over the band of the fit: even in log f and dense at the poles."""
    if frf is not None:
        return frf.f_hz[frf.f_hz > 0]
    low, high = model.band_hz or (0.1, 0.499 * model.fs_hz if model.fs_hz else 100.0)
    low = max(low, 1e-4 * high)
    grid = [np.geomspace(low, high, 400)]
    if model.domain == "s":
        for pole in model.poles[model.poles.imag > 0] / (2 * np.pi):
            grid.append(pole.imag + max(-pole.real, 1e-4 * abs(pole)) * np.linspace(-4, 4, 33))
    f = np.unique(np.concatenate(grid))
    return f[(f >= low) & (f <= high)]


def _draw_measured(gain: Axes, phase: Axes, frf: MimoFrf, i: int, j: int) -> None:
    use = frf.f_hz > 0
    f, g, std = frf.f_hz[use], frf.g[use, i, j], np.sqrt(frf.var_g[use, i, j])
    half = NORMAL_95 * std / np.sqrt(2)  # of the real part, or of that along G
    small = np.minimum(half / np.abs(g), 0.99)
    draw_error_bars(gain, f, db(g) + db(1 - small), db(g) + db(1 + small), "95 % interval, measured")
    draw_points(gain, f, db(g), MEASURED, "measured", markersize=2.0, alpha=0.5)
    draw_points(phase, f, np.degrees(np.angle(g)), MEASURED, None, markersize=2.0, alpha=0.5)
    limits_db(gain, db(g))


def _draw_model(gain: Axes, phase: Axes, f: np.ndarray, g: np.ndarray, std: np.ndarray) -> None:
    half = NORMAL_95 * std / np.sqrt(2)
    small = np.minimum(half / np.abs(g), 0.99)
    band = {"color": MODEL, "alpha": 0.3, "linewidth": 0.0}
    gain.fill_between(f, db(g) + db(1 - small), db(g) + db(1 + small), label="95 % band, model", **band)
    gain.plot(f, db(g), color=MODEL, linewidth=1.0, label="model")
    angle = np.degrees(np.angle(g))
    angle[1:][np.abs(np.diff(angle)) > 180] = np.nan  # no line across the jump by 360 degrees
    phase.plot(f, angle, color=MODEL, linewidth=1.0)
    if not gain.get_autoscaley_on():
        return
    limits_db(gain, db(g))
