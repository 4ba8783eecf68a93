"""Picture of a diagnosis: the cost with each candidate effect."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from gsid.plots.style import EXCESS, NOISE, SIGNAL, legend_below, new_figure, styled

if TYPE_CHECKING:
    from gsid.diagnosis.diagnose import Diagnosis


@styled
def diagnosis(diagnosis: Diagnosis) -> Figure:
    """Cost per degree of freedom with each group of effects, and its probability, for each round.

    Parameters
    ----------
    diagnosis : Diagnosis
        A diagnosis in which at least one effect was fitted.

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        No effect was fitted, because none is missing.
    """
    rounds = [one for one in diagnosis.rounds if one.before is not None]
    if not rounds:
        raise ValueError("no candidate effect was fitted, so there is nothing to draw")
    rows = [(one, one.before, group) for one in rounds for group in one.ranking]
    figure = new_figure(1.6 + 0.42 * len(rows))
    ax = figure.subplots()
    for at, (one, before, group) in enumerate(rows):
        after = group.candidates[0].fit.cost_per_dof
        colour = EXCESS if one.taken and group is one.ranking[0] else SIGNAL
        ax.barh(at, before - after, left=after, height=0.6, color=colour, alpha=0.85)
        ax.annotate(
            f"{before:.3g} → {after:.3g}, probability {group.probability:.1%}",
            (max(before, after), at),
            (5, 0),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
        )
    ax.axvline(1.0, color=NOISE, linestyle="--", linewidth=1.2, label="noise alone")
    names = [f"{one.name}: " + " or\n".join(group.effects) for one, _, group in rows]
    ax.set_yticks(range(len(rows)), names)
    ax.invert_yaxis()
    ax.set_xscale("log")
    most = max(max(before, group.candidates[0].fit.cost_per_dof) for _, before, group in rows)
    ax.set_xlim(0.7, most * (most / 0.7) ** 0.8)  # room for the annotations
    ax.set_xlabel("cost per degree of freedom, without the effect → with it")
    ax.set_title(diagnosis.sentence.partition(" (")[0])  # the figure shows the numbers
    ax.grid(False, axis="y")
    legend_below(figure, [ax])
    return figure
