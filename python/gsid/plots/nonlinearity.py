"""Pictures of distortion: the response with its uncertainties, and the output at the lines of each kind."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gsid.models.confidence import complex_bound
from gsid.plots.style import (
    EVEN,
    EXCESS,
    NOISE,
    SIGNAL,
    db,
    db_label,
    draw_points,
    frequency_axis,
    limits_db,
    new_figure,
    per_unit,
    plain_text,
    styled,
)

if TYPE_CHECKING:
    from gsid.response.distortion import Distortion
    from gsid.response.superposition import Superposition


@styled
def distortion(d: Distortion) -> Figure:
    """Best linear approximation with its uncertainties; below it, the output at the lines of each kind.

    Parameters
    ----------
    d : Distortion

    Returns
    -------
    Figure
    """
    has_free = bool(np.any(d.free_order > 0))
    figure = new_figure(7.2 if has_free else 4.2)
    axes = np.atleast_1d(figure.subplots(2 if has_free else 1, 1))
    _draw_response(axes[0], d)
    if has_free:
        _draw_output(axes[1], d)
        for ax in axes:
            frequency_axis(ax, np.concatenate([d.f_hz, d.free_f_hz]))
    return figure


def _draw_response(ax: Axes, d: Distortion) -> None:
    noise, total = np.sqrt(d.var_noise), np.sqrt(d.var_total)
    averaged = f"{d.n_periods} periods"
    draw_points(ax, d.f_hz, db(d.bla), SIGNAL, "|G|, best linear approximation")
    known = np.isfinite(total)
    if known.any():
        label = f"σ by noise and distortion, mean of {d.n_realisations} realisations"
        draw_points(ax, d.f_hz[known], db(total[known]), EXCESS, label, markersize=2.0)
    elif np.any(d.std_nonlinear > 0):
        total, known = d.std_nonlinear, d.std_nonlinear > 0
        label = "σ by distortion, from the odd lines left free"
        draw_points(ax, d.f_hz[known], db(total[known]), EXCESS, label, markersize=2.0)
    positive = noise > 0
    draw_points(
        ax, d.f_hz[positive], db(noise[positive]), NOISE, f"σ by noise, mean of {averaged}", markersize=2.0
    )
    frequency_axis(ax, d.f_hz)
    limits_db(ax, db(d.bla), db(noise[positive]), db(total[known]))
    ax.set_ylabel(db_label("|G|, σ", plain_text(per_unit(d.y_unit, d.u_unit))))
    ax.set_title(_wrapped(plain_text(d.verdict)))
    ax.legend(loc="best")


def _wrapped(text: str, width: int = 95) -> str:
    return "\n".join(textwrap.wrap(text, width))


def _draw_output(ax: Axes, d: Distortion) -> None:
    draw_points(ax, d.f_hz, db(np.abs(d.bla) * d.u), SIGNAL, "excited lines")
    shown = [np.abs(d.bla) * d.u]
    kinds = [("odd", d.odd, EXCESS, "o"), ("even", d.even, EVEN, "s")]
    if not d.orders_apart:
        kinds = [("free", d.free_order > 0, EXCESS, "o")]
    for name, chosen, colour, marker in kinds:
        if chosen.any():
            draw_points(
                ax,
                d.free_f_hz[chosen],
                db(d.level[chosen]),
                colour,
                f"{name} lines, not excited",
                marker=marker,
            )
            shown.append(d.level[chosen])
    f_hz = np.concatenate([d.f_hz, d.free_f_hz])
    excited_noise = np.sqrt(d.var_noise * d.n_realisations) * d.u
    noise = np.concatenate([excited_noise, d.level_noise])
    use = np.argsort(f_hz)
    use = use[noise[use] > 0]
    label = f"noise, σ of the mean of {d.n_periods / d.n_realisations:g} periods"
    ax.plot(f_hz[use], db(noise[use]), color=NOISE, linewidth=0.8, label=label)
    limits_db(ax, *map(db, shown), db(noise[use]))
    ax.set_ylabel(db_label("|Y|", plain_text(d.y_unit)))
    ax.set_title(f"Output, rms of {d.n_realisations} realisation{'s' * (d.n_realisations != 1)}")
    ax.legend(loc="best")


@styled
def superposition(s: Superposition) -> Figure:
    """Responses at two input levels, and their difference with its 95 % bound.

    Parameters
    ----------
    s : Superposition

    Returns
    -------
    Figure
    """
    figure = new_figure(6.0)
    gain_ax, change_ax = figure.subplots(2, 1, height_ratios=[3, 2])
    levels = ((s.first, SIGNAL, "first level"), (s.second, EXCESS, f"{s.level_ratio:.3g} times that"))
    for d, colour, label in levels:
        draw_points(gain_ax, d.f_hz, db(d.bla), colour, label)
    limits_db(gain_ax, db(s.first.bla), db(s.second.bla))
    gain_ax.set_ylabel(db_label("|G|", plain_text(per_unit(s.first.y_unit, s.first.u_unit))))
    gain_ax.set_title(_wrapped(plain_text(s.sentence)))
    gain_ax.legend(loc="best")
    bound = complex_bound(s.std, n_dof=s.n_dof)
    above = np.abs(s.change) > bound
    draw_points(change_ax, s.f_hz[~above], db(s.change[~above]), SIGNAL, "|change|")
    draw_points(change_ax, s.f_hz[above], db(s.change[above]), EXCESS, "above the bound")
    change_ax.plot(
        s.f_hz, db(bound), color=NOISE, linewidth=0.8, label="95 % bound of the scatter, each line"
    )
    limits_db(change_ax, db(s.change), db(bound))
    change_ax.set_ylabel(db_label("|ΔG|", plain_text(per_unit(s.first.y_unit, s.first.u_unit))))
    change_ax.legend(loc="best")
    for ax in (gain_ax, change_ax):
        frequency_axis(ax, s.f_hz)
    return figure
