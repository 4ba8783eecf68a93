"""Pictures of a linear structure: the response and what each element contributes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from gsid.models.confidence import unwrapped_phase_deg
from gsid.plots.style import (
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
    new_figure,
    per_unit,
    phase_axis,
    plain_text,
    styled,
)

if TYPE_CHECKING:
    from gsid.structure.start import Start


@styled
def start(found: Start) -> Figure:
    """Best linear approximation with its total standard deviation, the model, and the model's error.

    Parameters
    ----------
    found : Start

    Returns
    -------
    Figure
    """
    measured = found.measured
    f, g = measured.f_hz, measured.g
    model = found.response(f)
    figure = new_figure(6.0)
    gain_ax, phase_ax = figure.subplots(2, 1, height_ratios=[3, 2])
    draw_points(gain_ax, f, db(g), MEASURED, f"measured, {len(f)} lines", markersize=3.6, alpha=0.55)
    draw_points(gain_ax, f, db(g - model), EXCESS, "error of the model", markersize=2.0)
    gain_ax.plot(f, db(model), color=MODEL, label=found.summary())
    total = f"standard deviation, from {measured.largest_source.replace('_', ' ')}"
    gain_ax.plot(f, db(np.sqrt(measured.var_total)), color=NOISE, linewidth=1.0, label=total)
    noise = db(np.sqrt(measured.var_noise))
    gain_ax.plot(f, noise, color=NOISE, linewidth=0.8, linestyle=":", label="of the noise alone")
    limits_db(gain_ax, db(g), noise)
    gain_ax.set_ylabel(db_label("|G|", plain_text(per_unit(measured.y_unit, measured.u_unit))))
    phase = unwrapped_phase_deg(f, model)
    draw_points(
        phase_ax, f, phase + np.degrees(np.angle(g / model)), MEASURED, None, markersize=3.6, alpha=0.55
    )
    phase_ax.plot(f, phase, color=MODEL)
    frequency_axis(gain_ax, f, label=False)
    frequency_axis(phase_ax, f)
    phase_axis(phase_ax)
    legend_below(figure, [gain_ax])  # inside, it would cover the line of the noise
    return figure
