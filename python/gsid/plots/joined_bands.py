"""Draw bands that were measured apart, and their difference at the common lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gsid.models.confidence import complex_bound
from gsid.plots.style import (
    EVEN,
    EXCESS,
    MEASURED,
    MODEL,
    NOISE,
    db,
    db_label,
    draw_error,
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

    from gsid.response.join import Joined

COLOURS = (MEASURED, MODEL, EVEN, EXCESS)


@styled
def joined(result: Joined) -> Figure:
    """Responses of the bands, the joined response, and the difference against its 95 % bound.

    Parameters
    ----------
    result : Joined

    Returns
    -------
    Figure
    """
    figure = new_figure(7.2)
    gain_ax, phase_ax, error_ax = figure.subplots(3, 1, height_ratios=[3, 2, 2])
    use = line_mask(result.response)
    f, g = result.response.f_hz[use], result.response.g[use]
    for i, part in enumerate(result.parts):
        own, colour = line_mask(part), COLOURS[i % len(COLOURS)]
        label = plain_text(part.name or f"band {i + 1}")
        draw_points(gain_ax, part.f_hz[own], db(part.g[own]), colour, label, markersize=3.6, alpha=0.6)
        phase = np.degrees(np.angle(part.g[own]))
        draw_points(phase_ax, part.f_hz[own], phase, colour, None, markersize=3.6, alpha=0.6)
    gain_ax.plot(f, db(g), color=NOISE, linewidth=0.9, label="joined")
    bound = complex_bound(np.sqrt(result.response.var_g[use]), n_dof=_known(result.response.dof[use]))
    error_ax.plot(f, db(bound), color=NOISE, linewidth=0.9, label="95 % bound of the joined response")
    for one in result.overlaps:
        if len(one.f_hz):
            difference = complex_bound(one.sigma, n_dof=_known(one.dof))
            draw_error(error_ax, one.f_hz, np.abs(one.difference), difference, "|difference|")
    limits_db(gain_ax, db(g))
    gain_ax.set_ylabel(db_label("|G|", plain_text(per_unit(result.response.y_unit, result.response.u_unit))))
    error_ax.set_ylabel("difference [dB]")
    phase_axis(phase_ax)
    for ax in (gain_ax, phase_ax):
        frequency_axis(ax, f, label=False)
    frequency_axis(error_ax, f)
    legend_below(figure, [gain_ax, error_ax])
    return figure


def _known(dof: np.ndarray) -> np.ndarray:
    """Degrees of freedom that `complex_bound` can calculate with; those of known variances are infinite."""
    return np.minimum(dof, 1e9)
