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
from gsid.spectrum.lines import covariance, sample_variance
from gsid.spectrum.realisation import Realisation, common_lines, listed, realisations, rejected_lines
from gsid.spectrum.spectra import Spectra

if TYPE_CHECKING:
    from gsid.response.local_polynomial import Unsettled
    from gsid.spectrum.tones import Tone

_log = logging.getLogger(__name__)

SHORTEST_WINDOW = 4  # samples: below, no line is apart from the mean and from half of the sample rate


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
    """Estimate the frequency response at the lines that every realisation excites.

    A record whose input does not repeat is cut into windows, with a warning: see `window`.

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
        One per realisation.
    period, settle : int, optional
        Samples; default: what each record states, else what its data show. Not looked at for Spectra.
    band : (lo, hi), optional
        Only lines within [Hz].
    remove_periodic : bool
        Take periodic disturbances off the output first (`gsid.noise`); one at a line of the period looks like
        the response, and stays.
    reference : str, optional
        Of records measured in a closed loop: the column of its reference (`gsid.response.closed_loop`).
    lpm : bool
        Take the transient out by the local polynomial method instead of waiting for it to die out; one period
        is enough.
    window : int, optional
        Samples of Hann windows to average over, as is done for an input that does not repeat (H1, WIN-1);
        default then the largest power of two of which the record holds 8.
    merge : bool
        The records are parts of one realisation: put their periods together (FRF-4) instead of averaging
        their responses.
    min_input : float
        Leave out lines whose input amplitude is smaller, unit of u.

    Returns
    -------
    Frf
        FRF-1, FRF-2 (thesis, eqs. 4.10, 4.11, 7.29; 5.14 over realisations); LPM-1, LPM-2 with `lpm`.

    Raises
    ------
    InputError
        As `spectra`; realisations of unequal period, sample rate, hold or units; no common line in the band;
        parts of one realisation whose inputs differ.
    NotPeriodicError
        An input that does not repeat, where windows are no way out: the record is short, or `merge` is asked
        for, or there are Spectra beside it.
    ValueError
        No record; Spectra where samples are needed; a window of less than 4 samples; options that exclude
        each other; a band upside down.
    TypeError
        Something else than records, as samples or a file's name; a band that is not two numbers.
    """
    if window is not None and window < SHORTEST_WINDOW:
        raise ValueError(f"a window has {SHORTEST_WINDOW} samples at least, not {window}")
    asked = {"remove_periodic": remove_periodic, "lpm": lpm, "window": window, "merge": merge}
    asked = [name for name, value in (asked | {"min_input": min_input > 0}).items() if value]
    if reference is not None:
        if asked:
            raise ValueError(f"{asked[0]} is for open loops: in a closed one u answers y")
        from gsid.response.closed_loop import closed_loop_frf

        result = closed_loop_frf(records, reference, period=period, settle=settle, band=band)
        _say_rejected(result)
        return result
    if lpm + merge + (window is not None) > 1:
        raise ValueError("lpm, window and merge exclude each other")
    records = listed(records)
    has_samples = not any(isinstance(record, Spectra) for record in records)
    if not has_samples and (remove_periodic or lpm or window):
        raise ValueError(f"{asked[0]} needs the samples: give records, not their spectra")
    removed: list[Tone] = []
    if remove_periodic:
        records = [_without_tones(record, removed, period, settle) for record in records]
    parts, window = _parts(records, period, settle, lpm, window, merge)
    if window:
        from gsid.response.windows import windowed_frf

        result = windowed_frf(records, window, settle=settle, band=band, min_input=min_input)
    else:
        result = _at_lines(parts, band, merge, min_input)
    _say_rejected(result)
    return replace(result, removed=tuple(removed))


def as_response(measured: Frf | Record | Spectra | Sequence[Record | Spectra]) -> Frf:
    """A response as it is, and that of records with the defaults of :func:`frf`.

    Parameters
    ----------
    measured : Frf, Record or Spectra, or a sequence of records or spectra

    Returns
    -------
    Frf

    Raises
    ------
    TypeError
        Something else.
    InputError, ValueError
        As :func:`frf`.
    """
    several = measured if isinstance(measured, list | tuple) else [measured]
    if all(isinstance(one, Record | Spectra) for one in several):
        return frf(measured)
    check_response(measured)
    return measured


def _say_rejected(result: Frf) -> None:
    left_out = result.rejected_hz
    if len(left_out):
        few = ", ".join(f"{f:g}" for f in left_out[:8]) + ", ..." * (len(left_out) > 8)
        why = "too weak" if result.n_realisations == 1 else "too weak, or not in every record"
        _log.warning("lines left out, their input being %s: %d (%s Hz)", why, len(left_out), few)


def _parts(
    records: list[Record | Spectra],
    period: int | None,
    settle: int | None,
    lpm: bool,
    window: int | None,
    merge: bool,
) -> tuple[list[Realisation] | list[Unsettled], int | None]:
    """Realisations to estimate from, or none and the windows to cut the records into."""
    if window is not None:
        return [], window
    if lpm:
        from gsid.response.local_polynomial import unsettled

        return unsettled(records, period=period, settle=settle), None
    try:
        return realisations(records, period=period, settle=settle), None
    except NotPeriodicError:
        # periods that are merged, or were transformed before, are not to become windows
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
    """Estimate at the lines that every part excites with `min_input`; those left out are kept in mind."""
    line = common_lines(parts, band)
    each = [_single(part, line) if isinstance(part, Realisation) else part.frf(line) for part in parts]
    if min_input > 0:
        strong = np.min([np.abs(one.u) for one in each], axis=0) >= min_input
        if not strong.any():
            most = max(np.abs(one.u).max() for one in each)
            hint = f"the largest has {most:.4g}"
            raise InputError("no line has that much input", each[0].name, f"{min_input:g}", hint)
        line, each = line[strong], [one.at(strong) for one in each]
    rejected = parts[0].f_hz[rejected_lines(parts, line, band)]
    average = merged if merge else _over_realisations
    return replace(each[0] if len(each) == 1 else average(each), rejected_hz=rejected)


def _without_tones(record: Record, removed: list[Tone], period: int | None, settle: int | None) -> Record:
    """The record less its periodic disturbances, which are said and added to `removed`."""
    from gsid.spectrum.noise import without_tones

    cleaned, tones = without_tones(record, period=period, settle=settle)
    unit = f" {record.y_unit}" if record.y_unit else ""
    taken = ", ".join(f"{tone.name} of {tone.amplitude:.3g}{unit}" for tone in tones) or "nothing"
    _log.info("%s: taken off as periodic disturbance: %s", record.name or "record", taken)
    removed += tones
    return cleaned


def _single(part: Realisation, line: np.ndarray) -> Frf:
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


def _over_realisations(each: list[Frf]) -> Frf:
    """Mean of the responses and of their levels (thesis, eq. 5.14)."""
    first, m = each[0], len(each)
    turn = [np.exp(-1j * np.angle(one.u)) for one in each]
    return Frf(
        line=first.line,
        f_hz=first.f_hz,
        g=sum(one.g for one in each) / m,
        var_g=sum(one.var_g for one in each) / m**2,
        u=sum(one.u * t for one, t in zip(each, turn, strict=True)) / m,
        y=sum(one.y * t for one, t in zip(each, turn, strict=True)) / m,
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
