"""Picture of a model's output over time, beside the measured output."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from gsid.models.confidence import NORMAL_95
from gsid.plots.style import (
    EXCESS,
    MEASURED,
    MODEL,
    NOISE,
    draw_signal,
    is_narrow,
    legend_below,
    new_figure,
    plain_text,
    styled,
    with_unit,
)

if TYPE_CHECKING:
    from gsid.prediction import PredictedOutput

CLOSE_UP = 0.06  # of the period
LEAST_CLOSE_UP = 40  # samples
TIME = "time in the period [s]"


@styled
def predicted_output(predicted: PredictedOutput | Sequence[PredictedOutput]) -> Figure:
    """Measured and simulated output over a period, and their difference, whole and as a close-up.

    Parameters
    ----------
    predicted : PredictedOutput or sequence of them
        Two rows of the picture for each.

    Returns
    -------
    Figure
        The measured output is the mean over the periods. The grey band of the residual is the 95 % interval
        of the noise of this mean, from the scatter of the periods. The close-up shows where the residual is
        largest.
    """
    several = list(predicted) if isinstance(predicted, Sequence) else [predicted]
    arrange = _axes_one_above_the_other if is_narrow() else _axes_beside_each_other
    figure, several_axes = arrange(len(several))
    for axes, one in zip(several_axes, several, strict=True):
        _draw(axes, one)
    legend_below(figure, several_axes[0][:, 0])
    return figure


def _axes_beside_each_other(n: int) -> tuple[Figure, list[np.ndarray]]:
    """For each prediction the signals above the residuals, and their close-ups to the right."""
    figure = new_figure(0.6 + (4.2 if n == 1 else 3.2) * n)
    grid = figure.add_gridspec(2 * n, 2, width_ratios=[3, 2], height_ratios=[3, 2] * n)
    cells = [[grid[2 * row + i, column] for column in (0, 1) for i in (0, 1)] for row in range(n)]
    return figure, [_axes_of(figure, four) for four in cells]


def _axes_one_above_the_other(n: int) -> tuple[Figure, list[np.ndarray]]:
    """For each prediction the signals above the residuals, and their close-ups below."""
    figure = new_figure(0.8 + 6.4 * n)
    grid = figure.add_gridspec(4 * n, 1, height_ratios=[3, 2] * (2 * n))
    return figure, [_axes_of(figure, [grid[4 * row + i, 0] for i in range(4)]) for row in range(n)]


def _axes_of(figure: Figure, cells: Sequence[SubplotSpec]) -> np.ndarray:
    """Axes of one prediction: whole period and close-up in columns, signals and residuals in rows."""
    columns = []
    for above, below in (cells[:2], cells[2:]):
        signals = figure.add_subplot(above)
        residual = figure.add_subplot(below, sharex=signals)
        signals.tick_params(labelbottom=False)
        residual.set_xlabel(TIME)
        columns.append([signals, residual])
    return np.array(columns).T


def _draw(axes: np.ndarray, one: PredictedOutput) -> None:
    (whole, near), (whole_error, near_error) = axes
    error = np.mean(one.residual, axis=0)
    low, high = _close_up(error)
    bound = NORMAL_95 * one.rms_noise / np.sqrt(len(one.y))
    unit = plain_text(one.y_unit)
    for signal, residual, part in (
        (whole, whole_error, slice(None)),
        (near, near_error, slice(low, high)),
    ):
        _draw_signals(signal, one, part)
        residual.axhspan(-bound, bound, color=NOISE, alpha=0.3, linewidth=0.0, label="95 % of the noise")
        draw_signal(
            residual, one.t_s[part], error[part], color=EXCESS, linewidth=0.9, label="measured − model"
        )
    whole.set_title(
        f"{plain_text(one.name)}: FIT {one.fit_percent:.4g} %, noise alone {one.fit_percent_of_noise:.4g} %"
    )
    near.set_title("where they differ most")
    whole.set_ylabel(with_unit("output", unit))
    whole_error.set_ylabel(with_unit("difference", unit))
    whole.margins(x=0)
    near.set_xlim(one.t_s[low], one.t_s[high - 1])


def _draw_signals(ax: Axes, one: PredictedOutput, part: slice) -> None:
    draw_signal(
        ax,
        one.t_s[part],
        np.mean(one.y, axis=0)[part],
        color=MEASURED,
        linewidth=1.6,
        alpha=0.6,
        label=f"measured, mean of {len(one.y)} periods",
    )
    draw_signal(ax, one.t_s[part], one.y_model[part], color=MODEL, linewidth=0.9, label="model")


def _close_up(error: np.ndarray) -> tuple[int, int]:
    """Samples around the largest difference."""
    n = len(error)
    width = min(n, max(int(CLOSE_UP * n), LEAST_CLOSE_UP))
    low = int(np.clip(np.argmax(np.abs(error)) - width // 2, 0, n - width))
    return low, low + width
