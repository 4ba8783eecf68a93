"""Frequency response of a plant in a closed loop, through the reference (indirect method).

In a closed loop the output noise is fed back to the input. A response estimated from input and output alone
is then biased towards -1/C, where C is the controller. The reference is independent of the noise. With R, U
and Y of each realisation:

    G_ru = mean(U / R), G_ry = mean(Y / R), G = G_ry / G_ru  (FRF-5)

The variance of G is that of eq. 7.29, with G_ru, G_ry and their covariance in place of those of U and Y.
Noise common to input and output cancels in Y - G U. The controller need not be known.
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

ROUNDING = 1e-5  # of the largest line: smaller lines are rounding errors of the stored reference


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
        Name of the reference among the additional columns of the records. It repeats with the period.
    period, settle : int, optional
        Period and settling [samples]. Default: the values of each record, else found from the data.
    band : (lo, hi), optional
        Use only lines within this band [Hz].

    Returns
    -------
    Frf
        Response from u to y (FRF-5), at those lines of the reference at which u is above 1 % of its largest
        line and exceeds its noise. A smooth reference may excite u too little at some frequencies. The phases
        of `u` and `y` are relative to the reference. `rejected_hz` has the other lines of the reference.

    Raises
    ------
    InputError
        The column does not exist, or as `gsid.frf`.
    ValueError
        The sequence is empty, or contains Spectra, which have no reference.
    """
    records = listed(records)
    for record in records:
        require_reference(record, reference)
    each = [_spectra(record, reference, period, settle) for record in records]
    first, first_y = each[0]
    for to_u, to_y in each[1:]:
        require_same(first, to_u)
        require_same(first_y, to_y)
    chosen = np.logical_and.reduce([_lines(to_u.U, to_u.period_samples) for to_u, _ in each])
    chosen &= within(first.f_hz, band)
    found = _through_reference(each, chosen)
    found.name = ", ".join(record.name for record in records if record.name)
    level = np.abs(found.u)
    detected = (level > SHARE_OF_LARGEST * level.max(initial=0)) & (
        level**2 > ABOVE_NOISE * found.var_u / found.n_periods
    )
    if not detected.any():
        where = "" if band is None else f" within {band[0]:g}:{band[1]:g} Hz"
        what = f"u does not exceed its noise at any line{where} that {reference} excites"
        raise InputError(what, found.name, None, "excite the reference more, or select another with --r")
    return replace(found.at(detected), rejected_hz=found.f_hz[~detected])


def _spectra(
    record: Record, reference: str, period: int | None, settle: int | None
) -> tuple[Spectra, Spectra]:
    """Spectra from the reference to u, and from the reference to y, over the same periods."""
    driven = driven_by(record, reference)
    to_y = spectra(driven, period=period, settle=settle)
    to_u = spectra(replace(driven, y=record.u), period=to_y.period_samples, settle=settle)
    longest = max(to_y.settle_samples, to_u.settle_samples)
    if to_u.settle_samples == to_y.settle_samples:
        return to_u, to_y
    return _spectra(record, reference, to_y.period_samples, longest)


def loop_spectra(record: Record, reference: str) -> Spectra:
    """Spectra of command and output over the periods of the reference, at the lines that it excites.

    Parameters
    ----------
    record : Record
    reference : str
        Name of its column.

    Raises
    ------
    InputError
        As `driven_by`.
    """
    to_u, to_y = _spectra(record, reference, None, None)
    return replace(to_y, U=to_u.Y, u_unit=record.u_unit, name=record.name)


def require_reference(record: Record | Spectra, reference: str) -> None:
    """Refuse a record without the column of its reference, or with a number in it that is not finite.

    Parameters
    ----------
    record : Record or Spectra
    reference : str

    Raises
    ------
    InputError
        The column does not exist, or has a number that is not finite.
    ValueError
        Spectra have no reference.
    """
    if isinstance(record, Spectra):
        raise ValueError("a closed loop needs the samples of its reference: give records, not their spectra")
    if reference not in record.columns:
        names = [name for name in record.columns if np.ndim(record.columns[name]) == 1]
        hint = f"{choose(reference, names)}; select it with --r"
        raise InputError(f"no column named {reference}", record.name, None, hint)
    r = np.asarray(record.columns[reference], float)
    bad = np.flatnonzero(~np.isfinite(r) & record.valid)
    if bad.size:
        where = f"{record.name} sample {bad[0]}, {reference}"
        raise InputError("a number is not finite", where, r[bad[0]], "repair it, or mark the sample as lost")


def driven_by(record: Record, reference: str) -> Record:
    """The record with its reference as input.

    Parameters
    ----------
    record : Record
    reference : str
        Name of its column.

    Raises
    ------
    InputError
        As `require_reference`.
    """
    require_reference(record, reference)
    r = np.where(record.valid, np.asarray(record.columns[reference], float), 0.0)
    return replace(record, u=r, columns={}, name=f"{record.name} with {reference} for u")


def _lines(R: np.ndarray, n_period: int) -> np.ndarray:
    """Lines that the reference excites. Whether u is large enough there is checked later."""
    size = np.abs(R.mean(axis=0))
    line = np.arange(len(size))
    size[(line == 0) | (2 * line == n_period)] = 0  # they have no phase
    return (size > ROUNDING * size.max()) & (size**2 > ABOVE_NOISE * sample_variance(R) / len(R))


def _through_reference(each: Sequence[tuple[Spectra, Spectra]], chosen: np.ndarray) -> Frf:
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
    # variance of the mean of each realisation; the number of periods may differ between them
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


def plant_of_loop(loop: Frf, controller: np.ndarray) -> Frf:
    """Response of a plant from that of its closed loop and a known controller.  Eq: FRF-8

    Parameters
    ----------
    loop : Frf
        T from the reference to the output, with the reference as input, measured.
    controller : (F,) complex array_like
        C from the error, reference minus output, to the command, at the lines of `loop`. It is assumed to be
        exact.

    Returns
    -------
    Frf
        G = T/(C (1 - T)), with the command C (1 - T) R as input. Where |1 - T| is small, the loop shows
        little of the plant, and the variance is large. Use `closed_loop_frf` if the command was recorded.

    Raises
    ------
    ValueError
        The controller has another length, is not finite or is zero at a line; or T is 1 at a line.
    """
    controller = np.asarray(controller, complex)
    if controller.shape != loop.g.shape:
        raise ValueError(f"the controller has {controller.shape} values, the response {loop.g.shape}")
    path = controller * (1 - loop.g)
    bad = np.flatnonzero(~(np.isfinite(path) & (np.abs(path) > 0)))
    if bad.size:
        raise ValueError(
            f"the controller and the loop do not determine the plant at {loop.f_hz[bad[0]]:g} Hz"
        )
    g, u = loop.g / path, path * loop.u
    variance = loop.var_g / np.abs(path * (1 - loop.g)) ** 2  # |dG/dT| = 1/|C (1 - T)^2|
    zero = np.zeros(len(g))
    return replace(
        loop,
        g=g,
        var_g=variance,
        u=u,
        y=g * u,
        var_u=zero,
        var_y=variance * np.abs(u) ** 2 * loop.n_periods,
        cov_yu=zero.astype(complex),
        var_total=None
        if loop.var_total is None
        else loop.var_total * np.divide(variance, loop.var_g, out=np.ones(len(g)), where=loop.var_g > 0),
    )
