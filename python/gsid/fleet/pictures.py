"""Pictures of a fleet: missing effects, and the units against the fleet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gsid.fleet.findings import Findings, Flag
from gsid.fleet.statistics import Tested
from gsid.plots.style import EXCESS, MEASURED, MODEL, draw_points, new_figure, plain_text, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LABELS_MOST = 10  # units that are named in a picture
ROWS_MOST = 15  # parameters and effects in a picture


@styled
def missing_effects(found: Findings) -> Figure:
    """Number of measurements by missing effect or verdict."""
    names = list(found.n_missing)[:ROWS_MOST][::-1]
    figure = new_figure(1.0 + 0.28 * len(names))
    ax = figure.subplots()
    ax.barh(range(len(names)), [found.n_missing[name] for name in names], color=MODEL, height=0.6)
    ax.set_yticks(range(len(names)), [plain_text(name) for name in names])
    ax.set_xlabel("measurements")
    ax.grid(visible=False, axis="y")
    return figure


def deviations(found: Findings) -> Figure:
    """Deviation of each unit from the fleet."""
    return _strips(found, [one.population.outlier for one in found.parameters], found.outliers, "deviation")


def drifts(found: Findings) -> Figure:
    """Change of each unit from its first to its last measurement."""
    return _strips(found, [one.population.drift for one in found.parameters], found.drifted, "change")


@styled
def _strips(found: Findings, tested: Sequence[Tested], flags: Sequence[Flag], what: str) -> Figure:
    """One row for each parameter, one point for each unit, in standard deviations of the test."""
    rows = [(one, test) for one, test in zip(found.parameters, tested, strict=True) if _has_points(test)]
    rows = rows[:ROWS_MOST][::-1]
    figure = new_figure(1.2 + 0.32 * len(rows))
    ax = figure.subplots()
    number = {name: i for i, name in enumerate(found.units)}
    for height, (parameter, test) in enumerate(rows):
        score = test.estimate / test.std
        draw_points(ax, score, np.full(len(score), height), MEASURED, None, markersize=3, alpha=0.4)
        marked = [flag for flag in flags if flag.parameter == parameter.label]
        _mark(ax, height, [(flag, score[number[flag.unit]]) for flag in marked])
    ax.set_yticks(range(len(rows)), [plain_text(one.label) for one, _ in rows])
    ax.set_ylim(-0.6, len(rows) - 0.3)
    ax.axvline(0, color=MEASURED, linewidth=0.7)
    ax.set_xlabel(f"{what} / its standard deviation")
    return figure


def _has_points(test: Tested) -> bool:
    return bool(np.any(np.isfinite(test.estimate / test.std)))


def _mark(ax: Axes, height: int, marked: Sequence[tuple[Flag, float]]) -> None:
    for _, score in marked:
        draw_points(ax, [score], [height], EXCESS, None, markersize=5)
    for flag, score in marked[:LABELS_MOST]:
        text = plain_text(flag.unit)
        ax.annotate(text, (score, height), (0, 4), textcoords="offset points", ha="center", fontsize=8)
