"""Picture of records as they were measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from gsid.base.errors import InputError
from gsid.plots.style import (
    EXCESS,
    MEASURED,
    NOISE,
    SIGNAL,
    db,
    db_label,
    draw_points,
    draw_signal,
    frequency_axis,
    limits_db,
    new_figure,
    plain_text,
    styled,
    with_unit,
)
from gsid.records.position import RATE, Position, position
from gsid.spectrum.realisation import spectra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.records.record import Record
    from gsid.spectrum.spectra import Spectra

LEGEND_ROOM = 0.5  # of the height of the position, above it
FAR = 4.0  # largest positions: a limit beyond would flatten the curve


@styled
def records(
    seen: Sequence[tuple[Record, Spectra | None]], *, travel: tuple[float, float] | None = None
) -> Figure:
    """Input, output and position of records over time, and the lines of their mean period.

    Parameters
    ----------
    seen : sequence of (Record, Spectra or None)
        None if the record has no period.
    travel : (lo, hi), optional
        Limits of the position from the first sample [deg], drawn with it; an infinite one is not drawn.

    Returns
    -------
    Figure
        Two rows for each record, and two more if it has a period: the position if its output is a rate (unit
        of y ending in /s), and the lines. What is discarded as settling is grey, lost
        samples are gaps.
    """
    places = [_position(record, found) for record, found in seen]
    counts = (2 + (found is not None) + (at is not None) for (_, found), at in zip(seen, places, strict=True))
    rows = sum(counts)
    figure = new_figure(1.7 * rows)
    axes = list(np.atleast_1d(figure.subplots(rows, 1)))
    for (record, found), place in zip(seen, places, strict=True):
        signals = [axes.pop(0) for _ in range(2 if place is None else 3)]
        _draw_signals(signals[0], signals[1], record, found)
        if place is not None:
            limits = None if travel is None else place.from_deg(travel)
            _draw_position(signals[2], signals[1], place, record.valid, limits)
        if found is not None:
            _draw_lines(axes.pop(0), found)
    return figure


def one_record(record: Record) -> Figure:
    """Input and output over time and, if the record has a period, position and lines of its mean period.

    Parameters
    ----------
    record : Record

    Returns
    -------
    Figure
    """
    try:
        found = spectra(record)
    except InputError:  # shown without its lines
        found = None
    return records([(record, found)])


def _draw_signals(above: Axes, below: Axes, record: Record, found: Spectra | None) -> None:
    below.sharex(above)
    above.set_title(plain_text(record.name or "record"))
    for ax, values, name, unit, colour in (
        (above, record.u, "input", record.u_unit, MEASURED),
        (below, record.y, "output", record.y_unit, SIGNAL),
    ):
        seen = np.where(record.valid, values, np.nan)
        draw_signal(ax, np.arange(len(seen)) / record.fs_hz, seen, color=colour, linewidth=0.8)
        ax.set_ylabel(with_unit(name, plain_text(unit)))
        if found is not None and found.settle_samples:
            ax.axvspan(0, found.settle_samples / record.fs_hz, color=NOISE, alpha=0.2, linewidth=0.0)
    above.tick_params(axis="x", labelbottom=False)
    below.set_xlabel("time [s]")
    above.margins(x=0)


def _position(record: Record, found: Spectra | None) -> Position | None:
    """Where the output is known to be a rate, and its offset can be estimated."""
    if found is None or not record.y_unit.endswith(RATE):
        return None
    return position(record, period=found.period_samples, settle=found.settle_samples)


def _draw_position(
    ax: Axes, above: Axes, place: Position, valid: np.ndarray, travel: tuple[float, float] | None
) -> None:
    ax.sharex(above)
    ax.margins(x=0)  # else all shared axes begin before the record
    above.set_xlabel("")
    above.tick_params(axis="x", labelbottom=False)
    unit = plain_text(place.unit)
    draw_signal(
        ax,
        np.arange(len(place.angle)) / place.fs_hz,
        np.where(valid, place.angle, np.nan),
        color=SIGNAL,
        linewidth=0.8,
        label=f"integral of the output less {place.offset:.3g} ± {place.std_offset:.1g} {unit}/s",
    )
    for limit in (one for one in travel or () if np.isfinite(one)):
        is_near = abs(limit) < FAR * max(-place.lo, place.hi)
        text = f"limit of the travel, {limit:g} {unit}{'' if is_near else ' (outside the picture)'}"
        if is_near:
            ax.axhline(limit, color=EXCESS, linewidth=1.0, label=text)
        else:
            ax.plot([], [], color=EXCESS, linewidth=1.0, label=text)
    ax.set_ylabel(with_unit("position", unit))
    ax.set_xlabel("time [s]")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + LEGEND_ROOM * (high - low))
    ax.legend(loc="upper left", ncols=2)


def _draw_lines(ax: Axes, found: Spectra) -> None:
    above = found.line > 0
    noise = np.sqrt(found.noise_y / found.n_periods)
    ax.plot(
        found.f_hz[above], db(noise[above]), color=NOISE, linewidth=0.9, label="σ of the noise of the mean"
    )
    draw_points(ax, found.f_hz[above], db(found.y[above]), SIGNAL, "|Y|, all lines", markersize=1.6)
    excited = found.excited & above
    draw_points(ax, found.f_hz[excited], db(found.y[excited]), MEASURED, "|Y|, excited lines")
    frequency_axis(ax, found.f_hz[above])
    limits_db(ax, db(found.y[excited]), db(noise[above]))
    ax.set_ylabel(db_label("|Y|", plain_text(found.y_unit)))
    ax.legend(loc="best")
