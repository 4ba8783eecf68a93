"""Picture of poles and zeros with their confidence regions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import FuncFormatter, MaxNLocator

from gsid.models.confidence import NORMAL_95, confidence_ellipse
from gsid.plots.style import (
    EXCESS,
    GRID_LINE,
    GRID_TEXT,
    MODEL,
    is_narrow,
    legend_below,
    new_figure,
    plain_number,
    styled,
    with_unit,
)

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel


@styled
def pole_zero(model: RationalModel) -> Figure:
    """Pole-zero map of the upper half-plane, and a close-up of each root with its 95 % confidence region.

    Parameters
    ----------
    model : RationalModel

    Returns
    -------
    Figure
        In domain "s" in Hz (s / 2 pi). If the roots spread over decades, the radius of the map is
        logarithmic; the angles, and with them the damping, are preserved.
    """
    scale = 2.0 * np.pi if model.domain == "s" else 1.0
    roots = [
        (mark, complex(root) / scale, np.asarray(cov) / scale**2)
        for mark, found, covs in (
            ("pole", model.poles, model.pole_cov),
            ("zero", model.zeros, model.zero_cov),
        )
        for root, cov in sorted(zip(found, covs, strict=True), key=lambda pair: abs(pair[0]))
        if root.imag >= -1e-9 * abs(root)
    ]
    known = [abs(root) for _, root, cov in roots if not _may_be_zero(root, cov)]
    # Roots of an undetermined position.
    lost = [r for r in roots if known and _may_be_zero(*r[1:]) and abs(r[1]) > max(known)]
    roots = [r for r in roots if not any(r is one for one in lost)]
    close_ups = [r for r in roots if np.all(np.isfinite(r[2])) and np.any(r[2] > 0.0)][:6]
    figure, left, small = _arranged(len(close_ups))
    for ax, (mark, root, cov) in zip(small, close_ups, strict=True):
        _draw_close_up(ax, mark, root, cov, "Hz" if model.domain == "s" else "")
    ax = left.subplots()
    place = (
        _draw_z_grid(ax, model.fs_hz)
        if model.domain == "z"
        else _draw_s_grid(ax, [r for _, r, cov in roots if not _may_be_zero(r, cov)])
    )
    for _mark, root, cov in roots:
        if np.all(np.isfinite(cov)):
            _draw_region(ax, place(confidence_ellipse(root, cov)), "95 % confidence region")
    for mark, symbol in (("pole", "x"), ("zero", "o")):
        at = place(np.array([r for m, r, _ in roots if m == mark], dtype=complex))
        if len(at):
            _root_marks(ax, at, symbol, f"{mark}s")
    left_out = f"; left out: {len(lost)} not determined" if lost else ""
    ax.set_title(f"Poles and zeros, upper half-plane{left_out}")
    legend_below(left, [ax])
    return figure


def _arranged(n: int) -> tuple[Figure, FigureBase, list[Axes]]:
    """A figure, its part for the map, and the axes of n close-ups to the right of it or below."""
    if n == 0:
        figure = new_figure(4.6)
        return figure, figure, []
    if is_narrow():
        rows, columns = -(-n // 2), 2
        figure = new_figure(4.2 + 2.3 * rows)
        figure.set_layout_engine("constrained", h_pad=0.1)  # else axes of equal scales reach the edge
        of_map, of_small = figure.subfigures(2, 1, height_ratios=[4.2, 2.3 * rows])
    else:
        rows, columns = (2, -(-n // 2)) if n > 2 else (n, 1)
        figure = new_figure(4.6)
        of_map, of_small = figure.subfigures(1, 2, width_ratios=[2.2, columns + 0.4], wspace=0.02)
    small = list(np.atleast_1d(of_small.subplots(rows, columns)).ravel())
    for ax in small[n:]:
        ax.set_axis_off()
    of_small.suptitle("Close up, with 95 % confidence regions", fontsize=9.5)
    return figure, of_map, small[:n]


def _may_be_zero(root: complex, cov) -> bool:
    """Whether the root may be an integrator within its confidence region."""
    std = np.sqrt(np.trace(cov)) if np.all(np.isfinite(cov)) else 0.0
    return abs(root) <= NORMAL_95 * std


def _draw_region(ax: Axes, outline, label: str | None = None) -> None:
    ax.fill(
        outline.real,
        outline.imag,
        facecolor=to_rgba(EXCESS, 0.25),
        edgecolor=EXCESS,
        linewidth=1.0,
        label=label,
    )


def _root_marks(ax: Axes, at, symbol: str, label: str | None) -> None:
    ax.plot(
        at.real,
        at.imag,
        symbol,
        color=MODEL,
        markersize=7.0,
        markeredgewidth=1.6,
        markerfacecolor="none",
        label=label,
        linestyle="none",
        clip_on=False,
        zorder=3,
    )


def _draw_close_up(ax: Axes, mark: str, root: complex, cov, unit: str) -> None:
    outline = confidence_ellipse(root, cov) - root
    _draw_region(ax, outline)
    _root_marks(ax, np.array([0j]), "x" if mark == "pole" else "o", None)
    reach = 1.35 * np.max(np.abs([outline.real, outline.imag]))
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-reach, reach)
    ax.set_aspect("equal")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(3))
        axis.set_major_formatter(FuncFormatter(plain_number))
    ax.set_xlabel(with_unit("Δ real", unit), fontsize=8.0)
    ax.set_ylabel(with_unit("Δ imag", unit), fontsize=8.0)
    ax.tick_params(labelsize=7.5)
    value = root_text(root).replace(" ±", "\n±")  # on one line it is wider than the axes, and is cut
    ax.set_title(f"{value} {unit}".rstrip(), fontsize=8.0, loc="center")


def root_text(root: complex) -> str:
    """A root, or both of a conjugate pair, for example "-0.867 ± 13.1j"."""
    if abs(root.imag) <= 1e-9 * abs(root):
        return f"{root.real:.4g}".replace("-", "−")
    return f"{root.real:.4g} ± {abs(root.imag):.5g}j".replace("-", "−")


def _draw_s_grid(ax: Axes, roots: Sequence[complex]) -> Callable[[np.ndarray], np.ndarray]:
    """Damping rays and frequency circles around roots [Hz] other than 0; returns the map to the drawing.

    With a log radius, roots inside the innermost circle are drawn at the origin.
    """
    sizes = np.abs(roots) if len(roots) else np.ones(1)
    is_log = sizes.max() / sizes.min() > 12.0
    if is_log:
        inner = 10.0 ** np.floor(np.log10(sizes.min()) - 0.5)

        def place(s):
            s = np.asarray(s, dtype=complex)
            return np.log10(np.maximum(np.abs(s), inner) / inner) * np.exp(1j * np.angle(s))

        rings = 10.0 ** np.arange(np.log10(inner) + 1.0, np.log10(sizes.max()) + 1.0)
        outer = abs(place(1.35 * sizes.max()))
        ticks = [ring for ring in (m * d for d in rings / 10.0 for m in (1.0, 2.0, 5.0)) if inner < ring]
        if len(ticks) > 8:
            ticks = [d for d in rings if d <= 1.35 * sizes.max()]
    else:

        def place(s):
            return np.asarray(s, dtype=complex)

        outer = 1.2 * sizes.max()
        ticks = [t for t in MaxNLocator(4).tick_values(0.0, outer) if t > 0.0]
    right = outer if any(r.real > 0 for r in roots) else 0.12 * outer
    turn = np.linspace(0.0, np.pi, 181)
    for tick in ticks:
        radius = abs(place(tick))
        if 0.0 < radius <= outer:
            ax.plot(radius * np.cos(turn), radius * np.sin(turn), **GRID_LINE)
            ax.text(0.015 * outer, radius, f"{tick:g} Hz", va="bottom", **GRID_TEXT)
    for damping in (0.1, 0.3, 0.5, 0.7, 0.9):
        along = outer * np.exp(1j * (np.pi - np.arccos(damping)))
        for sign in (1.0, -1.0) if right == outer else (1.0,):
            ax.plot([0.0, sign * along.real], [0.0, along.imag], linestyle=":", **GRID_LINE)
        ax.text(1.03 * along.real, 1.03 * along.imag, f"ζ {damping:g}", ha="right", va="center", **GRID_TEXT)
    ax.axhline(0.0, color="#999999", linewidth=0.8, zorder=0.8)
    ax.axvline(0.0, color="#999999", linewidth=0.8, zorder=0.8)
    ax.set_aspect("equal")
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.set_xlim(-1.14 * outer, 1.05 * right)
    ax.set_ylim(-0.06 * outer, 1.08 * outer)
    ax.grid(False)
    ax.set_xlabel("real part [Hz]" + (", log radius" if is_log else ""))
    ax.set_ylabel("imaginary part [Hz]" + (", log radius" if is_log else ""))
    if is_log:
        ax.set_xticks([])
        ax.set_yticks([])
    return place


def _draw_z_grid(ax: Axes, fs_hz: float) -> Callable[[np.ndarray], np.ndarray]:
    turn = np.linspace(0.0, np.pi, 181)
    ax.plot(np.cos(turn), np.sin(turn), color="#999999", linewidth=0.9, zorder=0.8)
    for damping in (0.1, 0.3, 0.5, 0.7, 0.9):
        angle = turn * np.sqrt(1.0 - damping**2)
        spiral = np.exp(-damping * turn + 1j * angle)
        ax.plot(spiral.real, spiral.imag, linestyle=":", **GRID_LINE)
    for part in (0.1, 0.2, 0.3, 0.4):
        at = np.exp(2j * np.pi * part)
        ax.text(
            1.04 * at.real,
            1.04 * at.imag,
            f"{part * fs_hz:g} Hz",
            ha="left" if at.real > 0 else "right",
            **GRID_TEXT,
        )
    ax.axhline(0.0, color="#999999", linewidth=0.8, zorder=0.8)
    ax.set_aspect("equal")
    ax.set_xlim(-1.35, 1.35)
    ax.set_ylim(-0.08, 1.15)
    ax.grid(False)
    ax.set_xlabel("real part of z")
    ax.set_ylabel("imaginary part of z")
    return lambda z: np.asarray(z, dtype=complex)
