"""Warn of a response at lines above half of the rate at which the sensor is refreshed.

A sensor that is refreshed R times a second shows a line at f also at R - f, 2 R - f, ... Where these are
lines of the excitation, the image counts as response. It repeats with the period, so that the variance over
the periods does not contain it. Other excitations are not affected in this way: of a stepped sine there is
one line at a time, and the images of a random input are noise to it.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from gsid.base.errors import InputError
from gsid.records.record import Record
from gsid.records.refresh import refresh_rate_hz
from gsid.response.closed_loop import driven_by
from gsid.response.frf import Frf
from gsid.spectrum.realisation import realisations
from gsid.spectrum.spectra import Spectra

_log = logging.getLogger(__name__)


def warn_of_images(
    response: Frf,
    records: Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
    reference: str | None = None,
) -> None:
    """Log a warning if lines of a response contain images of lines above half of the sensor's refresh rate.

    Parameters
    ----------
    response : Frf
        Estimated from the records.
    records : sequence of Record or Spectra
        Spectra have no samples, so that the refreshes are unknown.
    period, settle : int, optional
        As those of `gsid.frf`.
    reference : str, optional
        Column of the reference, of records measured in a closed loop.
    """
    if response.method == "windows":
        return
    for record in records:
        rate_hz = refresh_rate_hz(record) if isinstance(record, Record) else None
        if rate_hz is None:
            continue
        driven = record if reference is None else driven_by(record, reference)
        text = _images(response, _highest_hz(driven, period, settle) or response.f_hz[-1], rate_hz)
        if text:
            _log.warning("%s: y is refreshed at %.5g Hz %s", record.name or "record", rate_hz, text)
            return  # the sensor is the same in all records


def _highest_hz(record: Record, period: int | None, settle: int | None) -> float | None:
    """Highest excited line, within the band of the response or not; None of a single period."""
    try:
        (part,) = realisations(record, period=period, settle=settle)
    except InputError:
        return None
    return float(part.f_hz[part.excited][-1])


def _images(response: Frf, highest_hz: float, rate_hz: float) -> str:
    """The lines with images, and what to do; empty if there is none."""
    f_hz, half_line = response.f_hz, 0.5 * response.fs_hz / response.period_samples
    half_hz, lowest_hz = rate_hz / 2, rate_hz - highest_hz - half_line
    shown = f_hz[f_hz >= lowest_hz]
    if highest_hz <= half_hz or not len(shown):
        return ""
    above = int(np.count_nonzero(shown > half_hz))
    clean = f_hz[f_hz < lowest_hz]
    band = f"leave them out with the band {clean[0]:.5g}:{clean[-1]:.5g}, or " if len(clean) else ""
    lines = "1 line at" if len(shown) == 1 else f"{len(shown)} lines from {shown[0]:.5g} to"
    return (
        f"and the input has lines up to {highest_hz:.5g} Hz, above half of that: {lines} "
        f"{shown[-1]:.5g} Hz ({above} of them above {half_hz:.5g} Hz) with images of other lines, which "
        f"sigma does not include; {band}excite below {half_hz:.5g} Hz only"
    )
