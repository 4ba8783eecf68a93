"""Picture of the experiment that distinguishes two models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gsid.plots.style import (
    EXCESS,
    MEASURED,
    MODEL,
    SIGNAL,
    draw_signal,
    legend_below,
    new_figure,
    plain_text,
    styled,
    with_unit,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.diagnosis.next_experiment import Experiment
    from gsid.plant.model import PlantModel


@styled
def next_experiments(
    ranked: Sequence[Experiment], names: tuple[str, str], model: PlantModel, u_unit: str = ""
) -> Figure:
    """The best experiment of a menu: its command, both outputs, and their difference.

    Parameters
    ----------
    ranked : sequence of Experiment
        The best first.
    names : (str, str)
        Of both models.
    model : PlantModel
        One of them, for the unit of the output.
    u_unit : str
    """
    best = ranked[0]
    figure = new_figure(6.4)
    drive, outputs, apart = axes = figure.subplots(3, 1, sharex=True, height_ratios=[2, 3, 2])
    t_s = np.arange(len(best.command)) / best.fs_hz
    draw_signal(drive, t_s, best.command, color=SIGNAL, linewidth=0.9, label="command")
    draw_signal(outputs, t_s, best.first, color=MODEL, linewidth=1.2, label=plain_text(names[0]))
    draw_signal(
        outputs, t_s, best.second, color=MEASURED, linewidth=0.9, alpha=0.7, label=plain_text(names[1])
    )
    difference = best.first - best.second
    draw_signal(apart, t_s, difference - np.mean(difference), color=EXCESS, linewidth=0.9, label="difference")
    unit = plain_text(model.y_unit)
    drive.set_ylabel(with_unit("command", plain_text(u_unit)))
    outputs.set_ylabel(with_unit("output", unit))
    apart.set_ylabel(with_unit("difference", unit))
    apart.set_xlabel("time in the period [s]")
    drive.set_title(f"{best.words}: expected difference in cost {best.separation:.3g}")
    drive.margins(x=0)
    legend_below(figure, list(axes))
    return figure
