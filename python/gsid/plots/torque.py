"""Picture of the missing torque of a model."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gsid.plots.style import (
    EXCESS,
    MEASURED,
    MODEL,
    NOISE,
    is_narrow,
    new_figure,
    plain_text,
    styled,
    with_unit,
)

if TYPE_CHECKING:
    from gsid.diagnosis.from_records.result import Diagnosis
    from gsid.diagnosis.torque_residual import Curve, TorqueResidual


@styled
def torque_residual(residual: TorqueResidual) -> Figure:
    """Missing torque against rate, angle, command and time, with bars of two standard deviations.

    Parameters
    ----------
    residual : TorqueResidual

    Returns
    -------
    Figure
    """
    rows, columns = (4, 1) if is_narrow() else (2, 2)
    figure = new_figure(2.9 * rows)
    best = residual.best if residual.best.explained > 0.1 else None  # noise alone gives a small share
    for ax, curve in zip(figure.subplots(rows, columns).ravel(), residual.curves, strict=True):
        colour = EXCESS if curve is best else MODEL
        low, high = curve.torque - 2 * curve.std, curve.torque + 2 * curve.std
        ax.axhline(0.0, color="#999999", linewidth=0.8, zorder=0.8)
        ax.fill_between(curve.at, low, high, color=colour, alpha=0.25, linewidth=0.0)
        ax.plot(curve.at, curve.torque, color=colour, marker="o", linewidth=1.0)
        _draw_occupancy(ax, curve)
        share = f": {100 * curve.explained:.0f} % of its mean square"
        ax.set_title(f"against {curve.name}{', in the first record' if curve is residual.time else share}")
        ax.set_xlabel(with_unit(curve.name, plain_text(curve.unit)))
        ax.set_ylabel(with_unit("torque / inertia", plain_text(residual.unit)))
    figure.suptitle(
        f"Missing torque ({residual.rms:.3g} {plain_text(residual.unit)} rms), ±2 σ: an indication, not a "
        "test. Grey: share of the samples.",
        fontsize=9.5,
    )
    return figure


@styled
def missing_torque(found: Diagnosis) -> Figure:
    """Torque missing from the linear part against rate, angle and command, with the law found.

    Parameters
    ----------
    found : Diagnosis

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        No stack of effects represents the data.
    """
    measured, by_law = found.missing_torque()
    rows, columns = (3, 1) if is_narrow() else (1, 3)
    figure = new_figure(0.7 + 2.7 * rows)
    laws = by_law.curves[:3] if by_law else [None] * 3
    names = " and ".join(" or ".join(effects) for effects in found.laws)
    axes = np.ravel(figure.subplots(rows, columns, sharey=True))
    for ax, curve, law in zip(axes, measured.curves[:3], laws, strict=True):
        _draw_curve(ax, curve, EXCESS if curve is measured.best else MEASURED, "measured, ±2 σ")
        if law is not None:
            ax.plot(law.at, law.torque, color=MODEL, linewidth=1.6, label=names)
        ax.set_title(f"against {curve.name}: {100 * curve.explained:.0f} %")
        ax.set_xlabel(with_unit(curve.name, plain_text(curve.unit)))
    for ax in axes[:rows]:
        ax.set_ylabel(with_unit("missing torque / inertia", plain_text(measured.unit)))
    axes[int(np.argmax([curve.explained for curve in measured.curves[:3]]))].legend(loc="best")
    figure.suptitle(re.sub(r" \([^()]*\)", "", found.sentence), fontsize=9.5)
    return figure


def _draw_curve(ax: Axes, curve: Curve, colour: str, label: str) -> None:
    low, high = curve.torque - 2 * curve.std, curve.torque + 2 * curve.std
    ax.axhline(0.0, color="#999999", linewidth=0.8, zorder=0.8)
    ax.fill_between(curve.at, low, high, color=colour, alpha=0.25, linewidth=0.0)
    ax.plot(curve.at, curve.torque, color=colour, marker="o", linewidth=0.0, markersize=3.5, label=label)
    _draw_occupancy(ax, curve)


def _draw_occupancy(ax: Axes, curve: Curve) -> None:
    """Draw the share of samples in each bin along the bottom."""
    if np.ptp(curve.share) > 0.5 * curve.share.max():
        width = np.min(np.diff(curve.at)) if len(curve.at) > 1 else 1.0
        height = 0.12 * curve.share / curve.share.max()
        ax.bar(curve.at, height, width, color=NOISE, alpha=0.35, transform=ax.get_xaxis_transform())
