"""Pictures of a comparison and of the ladder of effects added."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from gsid.models.confidence import complex_bound
from gsid.plots.style import (
    BOUND_OF_NOISE,
    EXCESS,
    KINDS,
    NOISE,
    SIGNAL,
    above_text,
    db,
    db_label,
    draw_error,
    frequency_axis,
    legend_below,
    limits_db,
    new_figure,
    plain_number,
    plain_text,
    shade_band,
    styled,
    with_unit,
)

if TYPE_CHECKING:
    from gsid.comparison import Comparison
    from gsid.diagnosis.ladder import Ladder

# Legend of the validation errors of a ladder, by the heading of their column.
JUDGED = {
    "kept out": "the data kept out",
    "not fitted": "the records not fitted",
    "used before": "records used before",
    "later periods": "the later periods",
    "search records": "records used in the search",
    "judged": "the validation data",
}
BOUND_OF_BOTH = "95 % bound, noise and model"


@styled
def comparison(comparison: Comparison) -> Figure:
    """Error at the output against noise and model uncertainty, for excited, odd and even lines.

    The bands in which the model fails are shaded.

    Parameters
    ----------
    comparison : Comparison

    Returns
    -------
    Figure
    """
    kind, f = np.asarray(comparison.kind), np.asarray(comparison.f_hz)
    error, sigma, y = (np.abs(np.asarray(a)) for a in (comparison.error, comparison.sigma, comparison.y))
    bound = _bound(comparison)
    included = comparison.model_uncertainty == "included"
    label, right = (BOUND_OF_BOTH, "a correct model") if included else (BOUND_OF_NOISE, "noise alone")
    kinds = [k for k in KINDS if np.any((kind == k) & (f > 0.0))] or ["excited"]
    figure = new_figure(1.0 + 2.1 * len(kinds))
    axes = np.atleast_1d(figure.subplots(len(kinds), 1, sharex=True, sharey=True))
    for ax, name in zip(axes, kinds, strict=True):
        use = (kind == name) & (f > 0.0)
        if name == "excited":
            ax.plot(f[use], db(y[use]), color=NOISE, linewidth=0.9, label="|Y measured|")
        draw_error(ax, f[use], error[use], bound[use], "|Y measured − model|", label)
        for band in comparison.where:
            if band["lines"] == name and band["f_hi_hz"] > 0.0:  # a log axis cannot show an offset
                _draw_failing_band(ax, band)
        counted = above_text(error[use], bound[use], right)
        ax.set_title(f"{name.capitalize()} lines: {counted}" if use.any() else "No lines")
        ax.set_ylabel(db_label("|Y|", plain_text(comparison.y_unit)))
        frequency_axis(ax, f[f > 0.0], label=ax is axes[-1])
    shown = f > 0.0
    limits_db(axes[0], db(y[shown & (kind == "excited")]), db(error[shown]), db(sigma[shown]), room=6.0)
    axes[0].set_ylim(top=axes[0].get_ylim()[1] + 10.0)  # for the shares
    legend_below(figure, axes)
    return figure


def _bound(comparison: Comparison) -> np.ndarray:
    """(k,) 95 % bound of the error of each line if the model is correct.

    The sum of an estimated and a known variance has more degrees of freedom than the first (Satterthwaite).
    """
    variance = np.maximum(comparison.sigma**2, np.finfo(float).tiny)
    share_of_noise = np.maximum(1 - comparison.sigma_model**2 / variance, 1e-3)
    return complex_bound(comparison.sigma, n_dof=comparison.n_dof / share_of_noise**2)


def _draw_failing_band(ax: Axes, band: dict) -> None:
    low, high, share = band["f_lo_hz"], band["f_hi_hz"], band["share"]
    shade_band(ax, low, high, "model fails, share of the excess")
    if share >= 0.005:
        ax.text(
            np.sqrt(low * high) if low > 0.0 else high,
            0.97,
            f"{100.0 * share:.0f} %",
            va="top",
            ha="center",
            transform=ax.get_xaxis_transform(),
            fontsize=8.5,
            color=EXCESS,
        )


# --- the ladder -------------------------------------------------------------------------------------------


@styled
def ladder(ladder: Ladder) -> Figure:
    """Error after each step, on fitted and on validation data, against the noise floor.

    Parameters
    ----------
    ladder : Ladder
        With at least one step.

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        The ladder has no step.
    """
    rungs = ladder.rungs
    if not rungs:
        raise ValueError("the ladder has no step")
    names, levels, kept, floor = zip(*ladder.levels(), strict=True)
    fitted, kept, floor = np.array([level["rms_error"] for level in levels]), np.array(kept), np.array(floor)
    figure = new_figure(4.2)
    ax = figure.subplots()
    edges = np.arange(len(levels) + 1) - 0.5
    ax.stairs(floor, edges, baseline=None, color=NOISE, linewidth=1.2, linestyle="--", label="noise alone")
    ax.stairs(kept, edges, baseline=None, color=EXCESS, linewidth=2.4, label=f"on {JUDGED[ladder.judged_on]}")
    ax.stairs(fitted, edges, baseline=None, color=SIGNAL, linewidth=1.2, label="on the data fitted")
    for i, (error, noise) in enumerate(zip(kept, floor, strict=True)):
        ax.annotate(
            f"{error:.3g}, {error / noise:.3g} × noise",
            (i, max(error, fitted[i])),  # above both lines
            (0, 5),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=8.5,
            color=EXCESS,
        )
    ax.set_yscale("log")
    everything = np.concatenate([fitted, kept, floor])
    ax.set_ylim(0.75 * everything.min(), 1.6 * everything.max())
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=50))
    ax.yaxis.set_major_formatter(FuncFormatter(plain_number))
    ax.yaxis.set_minor_locator(NullLocator())
    names = [plain_text(name.replace("_", "_\n", 1) if len(names) > 4 else name) for name in names]
    costs = [f"cost per d.o.f. {level['cost_per_dof']:.4g}" for level in levels]
    ax.set_xticks(range(len(levels)), [f"{name}\n{cost}" for name, cost in zip(names, costs, strict=True)])
    ax.set_xlim(-0.55, len(levels) - 0.45)
    ax.grid(False, axis="x")
    ax.set_ylabel(with_unit("rms error", plain_text(rungs[0].y_unit)))
    judged = rungs[0].kept_out if len(levels) == len(rungs) + 1 else JUDGED[ladder.judged_on]
    ax.set_title(f"Error after each step, validated on {plain_text(judged)}")
    legend_below(figure, [ax])
    return figure
