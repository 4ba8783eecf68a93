"""Picture of records as they were measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from gsid.base.errors import InputError
from gsid.plots.style import (
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
from gsid.spectrum.realisation import spectra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.records.record import Record
    from gsid.spectrum.spectra import Spectra


@styled
def records(seen: Sequence[tuple[Record, Spectra | None]]) -> Figure:
    """Input and output of records over time, and the lines of their mean period.

    Parameters
    ----------
    seen : sequence of (Record, Spectra or None)
        None if the record has no period.

    Returns
    -------
    Figure
        Two rows for each record, and one more for its lines. What is discarded as settling is grey, lost
        samples are gaps.
    """
    rows = sum(2 if found is None else 3 for _, found in seen)
    figure = new_figure(1.7 * rows)
    axes = list(np.atleast_1d(figure.subplots(rows, 1)))
    for record, found in seen:
        _draw_signals(axes.pop(0), axes.pop(0), record, found)
        if found is not None:
            _draw_lines(axes.pop(0), found)
    return figure


def one_record(record: Record) -> Figure:
    """Input and output over time and, if the record has a period, the lines of its mean period.

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
