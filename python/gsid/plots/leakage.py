"""Spectrum of the input over a whole number of periods, and over a part of one more."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gsid.base.errors import InputError
from gsid.plots.style import (
    EXCESS,
    MEASURED,
    db,
    db_label,
    draw_points,
    frequency_axis,
    new_figure,
    plain_text,
    styled,
)
from gsid.spectrum.realisation import spectra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.records.record import Record


def amplitudes(u: np.ndarray, fs_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude of each line of a transform, without that at 0 Hz.

    Parameters
    ----------
    u : (n,) float
    fs_hz : float

    Returns
    -------
    f_hz, amplitude : (K,) float64
    """
    spectrum = np.abs(np.fft.rfft(u)) * 2 / len(u)
    return np.fft.rfftfreq(len(u), 1 / fs_hz)[1:], spectrum[1:]


@styled
def leakage(
    record: Record, periods: float, *, period: int | None = None, settle: int | None = None
) -> Figure:
    """Spectra of the input over one period and over another number of them (thesis, figure 3.1).

    Parameters
    ----------
    record : Record
        With a periodic input.
    periods : float
        1.2 in the thesis.
    period, settle : int, optional
        Samples; default: what the record states, else found from the data.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        The record is shorter.
    """
    one = spectra(record, period=period, settle=settle)
    n, first = one.period_samples, one.settle_samples
    length = round(periods * n)
    if not (length >= 2 and first + length <= len(record)):
        most = (len(record) - first) / n
        raise InputError(
            "the record does not have so many periods",
            record.name,
            f"{periods:g}, it has {most:.4g}",
            "give fewer periods, at least two samples",
        )
    figure = new_figure(3.9)
    axes = figure.subplots(1, 2, sharey=True)
    for ax, count, n_samples, colour in ((axes[0], 1.0, n, MEASURED), (axes[1], periods, length, EXCESS)):
        f, size = amplitudes(record.u[first : first + n_samples], record.fs_hz)
        draw_points(ax, f, db(np.maximum(size, 1e-12 * size.max())), colour, None, markersize=2.0)
        frequency_axis(ax, f)
        ax.set_title(f"{count:g} period{'s' * (count != 1)} of {n / record.fs_hz:g} s")
    top = float(db(amplitudes(record.u[first : first + n], record.fs_hz)[1].max()))
    axes[0].set_ylim(top - 100, top + 10)
    axes[0].set_ylabel(db_label("|U|", plain_text(record.u_unit)))
    return figure
