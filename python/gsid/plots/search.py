"""Picture of the search for phases with low peaks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import ScalarFormatter

from gsid.plots.style import EXCESS, MODEL, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.excitation.limits import Search


@styled
def search_course(found: Search, travel_unit: str = "deg") -> Figure:
    """Crest factor and, with a model, travel against the evaluations of the search (thesis, figure 3.13).

    Parameters
    ----------
    found : Search
    travel_unit : str

    Returns
    -------
    Figure
    """
    moves = bool(np.isfinite(found.travel).any())
    figure = new_figure(4.6 if moves else 3.2)
    axes = np.atleast_1d(figure.subplots(2 if moves else 1, 1, sharex=True))
    shown = [("crest factor, 8x finer grid", found.crest_factor, MODEL)]
    if moves:
        shown.append((f"travel to each side [{travel_unit}]", found.travel, EXCESS))
    for ax, (label, values, colour) in zip(axes, shown, strict=True):
        ax.plot(found.evaluations, values, color=colour, marker="o", markersize=3.6, linewidth=0.9)
        ax.set_ylabel(label)
        ax.set_xscale("symlog", linthresh=5)
        ax.set_ylim(0.95 * values.min(), 1.05 * values.max())
    axes[-1].xaxis.set_major_formatter(ScalarFormatter())
    axes[-1].set_xlabel("evaluations of the cost (0: starting phases)")
    first, last = found.crest_factor[[0, -1]]
    axes[0].set_title(f"Search for phases: crest factor from {first:.3f} to {last:.3f}")
    return figure
