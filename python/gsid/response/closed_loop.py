"""Frequency response of a plant in a closed loop, through the reference (indirect method).

In a closed loop the noise of the output comes back in the input, and a response estimated from input and
output alone leans towards -1/C, C being the controller. The reference knows nothing of the noise: with R, U
and Y of each realisation,

    G_ru = mean(U / R), G_ry = mean(Y / R), G = G_ry / G_ru  (FRF-5)

The variance of G is that of eq. 7.29 with G_ru and G_ry for U and Y and their covariance: noise that input
and output share cancels in Y - G U. The controller need not be known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.base.bands import within
from gsid.base.errors import InputError, choose
from gsid.records.record import Record
from gsid.response.frf import Frf
from gsid.spectrum.excited import ABOVE_NOISE, SHARE_OF_LARGEST
from gsid.spectrum.lines import covariance, sample_variance
from gsid.spectrum.realisation import listed, require_same, spectra
from gsid.spectrum.spectra import Spectra

ROUNDING = 1e-5  # of the largest line: smaller ones are what was rounded away when the reference was stored


def closed_loop_frf(
    records: Record | Sequence[Record],
    reference: str,
    *,
    period: int | None = None,
    settle: int | None = None,
    band: tuple[float, float] | None = None,
) -> Frf:
    """Estimate the response from u to y of a plant in a closed loop.

    Parameters
    ----------
    records : Record or sequence of Record
        One per realisation of the reference.
    reference : str
        Name of the reference among the records' other columns; it repeats with the period.
    period, settle : int, optional
        Samples; default: what each record states, else what the reference and the data show.
    band : (lo, hi), optional
        Only lines within [Hz].

    Returns
    -------
    Frf
        From u to y (FRF-5), at the lines of the reference at which u is above 1 % of its largest line and
        stands out of its noise: a smooth reference may have little where the loop asks much of the plant.
        `u` and `y` are turned by the phase of the reference; `rejected_hz` has its other lines.

    Raises
    ------
    InputError
        No such column, or as `gsid.frf`.
    ValueError
        No record, or Spectra, which have no reference.
    """
    records = listed(records)
    if any(isinstance(record, Spectra) for record in records):
        raise ValueError("a closed loop needs the samples of its reference: give records, not their spectra")
    each = [_spectra(record, reference, period, settle) for record in records]
    first, first_y = each[0]
    for to_u, to_y in each[1:]:
        require_same(first, to_u)
        require_same(first_y, to_y)
    chosen = np.logical_and.reduce([_lines(to_u.U, to_u.period_samples) for to_u, _ in each])
    chosen &= within(first.f_hz, band)
    found = _over_realisations(each, chosen)
    found.name = ", ".join(record.name for record in records if record.name)
    level = np.abs(found.u)
    heard = (level > SHARE_OF_LARGEST * level.max(initial=0)) & (
        level**2 > ABOVE_NOISE * found.var_u / found.n_periods
    )
    if not heard.any():
        where = "" if band is None else f" within {band[0]:g}:{band[1]:g} Hz"
        what = f"no line{where} that {reference} excites stands out of the noise of u"
        raise InputError(what, found.name, None, "excite the reference more, or name another with --r")
    return replace(found.at(heard), rejected_hz=found.f_hz[~heard])


def _spectra(
    record: Record, reference: str, period: int | None, settle: int | None
) -> tuple[Spectra, Spectra]:
    """From the reference to u, and to y, over the same periods."""
    if reference not in record.columns:
        names = [name for name in record.columns if np.ndim(record.columns[name]) == 1]
        hint = f"{choose(reference, names)}; name it with --r"
        raise InputError(f"no column named {reference}", record.name, None, hint)
    r = np.asarray(record.columns[reference], float)
    bad = np.flatnonzero(~np.isfinite(r) & record.valid)
    if bad.size:
        where = f"{record.name} sample {bad[0]}, {reference}"
        raise InputError("a number is not finite", where, r[bad[0]], "repair it, or mark the sample as lost")
    r = np.where(record.valid, r, 0.0)
    driven = replace(record, u=r, columns={}, name=f"{record.name} with {reference} for u")
    to_y = spectra(driven, period=period, settle=settle)
    to_u = spectra(replace(driven, y=record.u), period=to_y.period_samples, settle=settle)
    late = max(to_y.settle_samples, to_u.settle_samples)  # the slower of the two to settle
    if to_u.settle_samples == to_y.settle_samples:
        return to_u, to_y
    return _spectra(record, reference, to_y.period_samples, late)


def _lines(R: np.ndarray, n_period: int) -> np.ndarray:
    """Lines that a reference has at all; whether they suffice, u tells."""
    size = np.abs(R.mean(axis=0))
    line = np.arange(len(size))
    size[(line == 0) | (2 * line == n_period)] = 0  # they have no phase
    return (size > ROUNDING * size.max()) & (size**2 > ABOVE_NOISE * sample_variance(R) / len(R))


def _over_realisations(each: Sequence[tuple[Spectra, Spectra]], chosen: np.ndarray) -> Frf:
    """Eq: FRF-5"""
    m = len(each)
    ratios = [(to_u.Y[:, chosen] / to_u.u[chosen], to_y.Y[:, chosen] / to_u.u[chosen]) for to_u, to_y in each]
    level = np.mean([np.abs(to_u.u[chosen]) for to_u, _ in each], axis=0)
    u, y = (level * np.mean([pair[i].mean(axis=0) for pair in ratios], axis=0) for i in (0, 1))
    var_u, var_y, cov_yu = (
        level**2 * np.mean([covariance(pair[i], pair[j]) for pair in ratios], axis=0)
        for i, j in ((0, 0), (1, 1), (1, 0))
    )
    g = y / u
    # of the mean of each realisation, whose numbers of periods may differ
    error = [sample_variance(b - g * a) / len(a) for a, b in ratios]
    variance = level**2 * np.sum(error, axis=0) / m**2 / np.abs(u) ** 2
    to_u, to_y = each[0]
    return Frf(
        line=to_u.line[chosen],
        f_hz=to_u.f_hz[chosen],
        g=g,
        var_g=variance,
        u=u,
        y=y,
        var_u=var_u.real,
        var_y=var_y.real,
        cov_yu=cov_yu,
        n_periods=sum(one.n_periods for one, _ in each),
        n_realisations=m,
        n_spoiled=sum(one.n_spoiled for one, _ in each),
        settle_samples=to_u.settle_samples,
        period_samples=to_u.period_samples,
        fs_hz=to_u.fs_hz,
        hold=to_u.hold,
        u_unit=to_u.u_unit,
        y_unit=to_y.y_unit,
    )
