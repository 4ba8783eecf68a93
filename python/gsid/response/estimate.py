"""Estimate a frequency response: from periods, windows, local polynomials or a closed loop."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gsid.base.errors import InputError, NotPeriodicError
from gsid.records.record import Record
from gsid.response.frf import Frf, check_response, merged, response_of
from gsid.response.images import warn_of_images
from gsid.response.stepped import are_stepped, stepped_frf
from gsid.spectrum.lines import covariance, sample_variance
from gsid.spectrum.realisation import Realisation, common_lines, listed, realisations, rejected_lines
from gsid.spectrum.spectra import Spectra

if TYPE_CHECKING:
    from gsid.response.local_polynomial import Unsettled
    from gsid.spectrum.tones import Tone

_log = logging.getLogger(__name__)

SHORTEST_WINDOW = 4  # samples: shorter windows have no line between 0 Hz and half of the sample rate


def frf(
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
    band: tuple[float, float] | None = None,
    remove_periodic: bool = False,
    reference: str | None = None,
    lpm: bool = False,
    window: int | None = None,
    merge: bool = False,
    min_input: float = 0.0,
) -> Frf:
    """Estimate the frequency response at the lines excited in every realisation.

    A record whose input is not periodic is divided into windows, with a warning: see `window`. Records of a
    stepped sine, whose layout is in their keys, are evaluated sine by sine (`gsid.response.stepped`). If the
    sensor is refreshed less often than it is read, lines with images of others are reported
    (`gsid.response.images`).

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
        One per realisation.
    period, settle : int, optional
        Period and settling [samples]. Default: the values of each record, else found from its data. Not used
        for Spectra.
    band : (lo, hi), optional
        Use only lines within this band [Hz].
    remove_periodic : bool
        Subtract periodic disturbances from the output first (`gsid.noise`). A disturbance at a line of the
        period cannot be separated from the response, and remains.
    reference : str, optional
        Column of the reference, for records measured in a closed loop (`gsid.response.closed_loop`).
    lpm : bool
        Remove the transient by the local polynomial method instead of discarding it. One period is enough.
    window : int, optional
        Length of the Hann windows to average over (H1, WIN-1) [samples]. Windows are also used if the input
        is not periodic. Their default length is the largest power of two that fits 8 times into the record.
    merge : bool
        The records are parts of one realisation: combine their periods (FRF-4) instead of averaging their
        responses.
    min_input : float
        Omit lines whose input amplitude is smaller, unit of u.

    Returns
    -------
    Frf
        FRF-1, FRF-2 (thesis, eqs. 4.10, 4.11, 7.29; 5.14 over realisations); LPM-1, LPM-2 with `lpm`.

    Raises
    ------
    InputError
        As `spectra`; or the realisations differ in period, sample rate, hold or units; they have no common
        line in the band; or the inputs of parts to merge differ.
    NotPeriodicError
        The input is not periodic and windows are not possible: the record is too short, `merge` is requested,
        or some of the records are Spectra.
    ValueError
        The sequence is empty; the options need samples and Spectra are given; the window has fewer than 4
        samples; the options exclude each other; or the band is reversed.
    TypeError
        An item is not a record, for example samples or a file name; or the band is not two numbers.
    """
    if window is not None and window < SHORTEST_WINDOW:
        raise ValueError(f"a window has at least {SHORTEST_WINDOW} samples, not {window}")
    options = {"remove_periodic": remove_periodic, "lpm": lpm, "window": window, "merge": merge}
    options = [name for name, value in (options | {"min_input": min_input > 0}).items() if value]
    if reference is not None:
        if options:
            raise ValueError(f"{options[0]} cannot be used with a reference: it is for open loops only")
        from gsid.response.closed_loop import closed_loop_frf

        result = closed_loop_frf(records, reference, period=period, settle=settle, band=band)
        _report_rejected(result)
        warn_of_images(result, listed(records), period=period, settle=settle, reference=reference)
        return result
    if lpm + merge + (window is not None) > 1:
        raise ValueError("lpm, window and merge exclude each other")
    records = listed(records)
    if not options and are_stepped(records):
        result = stepped_frf(records, band=band, min_input=min_input)
        _report_rejected(result)
        return result
    has_samples = not any(isinstance(record, Spectra) for record in records)
    if not has_samples and (remove_periodic or lpm or window):
        raise ValueError(f"{options[0]} needs the samples: give records, not their spectra")
    removed: list[Tone] = []
    measured = records
    if remove_periodic:
        records = [_without_tones(record, removed, period, settle) for record in records]
    parts, window = _parts(records, period, settle, lpm, window, merge)
    if window:
        from gsid.response.windows import windowed_frf

        result = windowed_frf(records, window, settle=settle, band=band, min_input=min_input)
    else:
        result = _at_lines(parts, band, merge, min_input)
    _report_rejected(result)
    warn_of_images(result, measured, period=period, settle=settle)
    return replace(result, removed=tuple(removed))


def as_response(measured: Frf | Record | Spectra | Sequence[Record | Spectra]) -> Frf:
    """Return a response unchanged, or estimate it from records with the defaults of :func:`frf`.

    Parameters
    ----------
    measured : Frf, Record or Spectra, or a sequence of records or spectra

    Returns
    -------
    Frf

    Raises
    ------
    TypeError
        The argument is neither a response nor records.
    InputError, ValueError
        As :func:`frf`.
    """
    several = measured if isinstance(measured, list | tuple) else [measured]
    if all(isinstance(one, Record | Spectra) for one in several):
        return frf(measured)
    check_response(measured)
    return measured


def _report_rejected(result: Frf) -> None:
    f_hz = result.rejected_hz
    if len(f_hz):
        first = ", ".join(f"{f:g}" for f in f_hz[:8]) + ", ..." * (len(f_hz) > 8)
        why = "too weak" if result.n_realisations == 1 else "too weak, or not in every record"
        _log.warning("lines left out because their input is %s: %d (%s Hz)", why, len(f_hz), first)


def _parts(
    records: list[Record | Spectra],
    period: int | None,
    settle: int | None,
    lpm: bool,
    window: int | None,
    merge: bool,
) -> tuple[list[Realisation] | list[Unsettled], int | None]:
    """Realisations to estimate from; or none, and the length of the windows to use instead."""
    if window is not None:
        return [], window
    if lpm:
        from gsid.response.local_polynomial import unsettled

        return unsettled(records, period=period, settle=settle), None
    try:
        return realisations(records, period=period, settle=settle), None
    except NotPeriodicError:
        # windows replace neither periods to merge nor spectra
        if merge or any(isinstance(record, Spectra) for record in records):
            raise
        from gsid.response.windows import default_window

        window = default_window(records)
        if window is None:
            raise
        return [], window


def _at_lines(
    parts: list[Realisation] | list[Unsettled],
    band: tuple[float, float] | None,
    merge: bool,
    min_input: float,
) -> Frf:
    """Estimate at the lines that every part excites with `min_input`, and record the rejected lines."""
    line = common_lines(parts, band)
    each = [
        single_response(part, line) if isinstance(part, Realisation) else part.frf(line) for part in parts
    ]
    if min_input > 0:
        strong = np.min([np.abs(one.u) for one in each], axis=0) >= min_input
        if not strong.any():
            largest = max(np.abs(one.u).max() for one in each)
            hint = f"the largest is {largest:.4g}"
            raise InputError(
                "no line reaches the minimum input amplitude", each[0].name, f"{min_input:g}", hint
            )
        line, each = line[strong], [one.at(strong) for one in each]
    rejected = parts[0].f_hz[rejected_lines(parts, line, band)]
    average = merged if merge else _mean_over_realisations
    return replace(each[0] if len(each) == 1 else average(each), rejected_hz=rejected)


def _without_tones(record: Record, removed: list[Tone], period: int | None, settle: int | None) -> Record:
    """The record without its periodic disturbances, which are logged and added to `removed`."""
    from gsid.spectrum.noise import without_tones

    cleaned, tones = without_tones(record, period=period, settle=settle)
    unit = f" {record.y_unit}" if record.y_unit else ""
    found = ", ".join(f"{tone.name} of {tone.amplitude:.3g}{unit}" for tone in tones) or "none"
    _log.info("%s: periodic disturbances removed: %s", record.name or "record", found)
    removed += tones
    return cleaned


def single_response(part: Realisation, line: np.ndarray) -> Frf:
    """Frequency response of one realisation at these lines."""
    U, Y = part.input(line), part.output(line)
    u, y = U.mean(axis=0), Y.mean(axis=0)
    var_y, var_u, cov_yu = sample_variance(Y), np.zeros(len(line)), np.zeros(len(line), complex)
    if not part.u_repeats:
        var_u, cov_yu = sample_variance(U), covariance(Y, U)
    return Frf(
        line=line,
        f_hz=part.f_hz[line],
        **response_of(u, y, var_u, var_y, cov_yu, part.n_periods),
        n_periods=part.n_periods,
        n_realisations=1,
        n_spoiled=part.n_spoiled,
        settle_samples=part.settle_samples,
        period_samples=part.period_samples,
        fs_hz=part.fs_hz,
        hold=part.hold,
        u_unit=part.u_unit,
        y_unit=part.y_unit,
        name=part.name,
    )


def _mean_over_realisations(each: list[Frf]) -> Frf:
    """Mean of the responses and of their levels (thesis, eq. 5.14)."""
    first, m = each[0], len(each)
    phase_factor = [np.exp(-1j * np.angle(one.u)) for one in each]
    return Frf(
        line=first.line,
        f_hz=first.f_hz,
        g=sum(one.g for one in each) / m,
        var_g=sum(one.var_g for one in each) / m**2,
        u=sum(one.u * factor for one, factor in zip(each, phase_factor, strict=True)) / m,
        y=sum(one.y * factor for one, factor in zip(each, phase_factor, strict=True)) / m,
        var_u=sum(one.var_u for one in each) / m,
        var_y=sum(one.var_y for one in each) / m,
        cov_yu=sum(one.cov_yu for one in each) / m,
        n_periods=sum(one.n_periods for one in each),
        n_realisations=m,
        n_spoiled=sum(one.n_spoiled for one in each),
        settle_samples=first.settle_samples,
        period_samples=first.period_samples,
        fs_hz=first.fs_hz,
        hold=first.hold,
        u_unit=first.u_unit,
        y_unit=first.y_unit,
        name=", ".join(one.name for one in each if one.name),
        n_dof=sum(one.n_dof for one in each),
        method=first.method,
    )
