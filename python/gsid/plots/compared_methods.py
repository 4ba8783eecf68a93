"""Draw the uncertainty that excitations leave in the same time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gsid.plots.style import (
    EVEN,
    EXCESS,
    MEASURED,
    MODEL,
    db,
    draw_points,
    frequency_axis,
    legend_below,
    new_figure,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.excitation.methods import MethodComparison

COLOURS = {"multisine": MODEL, "stepped-sine": EXCESS, "sweep": EVEN, "prbs": MEASURED}


@styled
def excitation_methods(compared: MethodComparison) -> Figure:
    """Standard deviation of the response by formula (lines) and by simulation (points) of each method.

    Parameters
    ----------
    compared : MethodComparison

    Returns
    -------
    Figure
    """
    figure = new_figure(3.9)
    ax = figure.subplots()
    for one in compared.methods:
        if not one.n_periods:
            continue
        ax.plot(one.f_hz, db(one.sigma), color=COLOURS[one.name], label=one.name)
        if one.sigma_simulated is not None:
            draw_points(ax, one.f_hz, db(one.sigma_simulated), COLOURS[one.name], None, markersize=3.6)
    frequency_axis(ax, np.concatenate([one.f_hz for one in compared.methods]))
    ax.set_ylabel("standard deviation [dB]")
    ax.set_title(f"Uncertainty of the response after {compared.time_s:g} s")
    legend_below(figure, [ax])
    return figure
