"""A frequency response with the variance of its noise, and beside it that of noise and distortion.

Only records show the distortion: the response of several realisations is their mean, and the lines that are
not excited are not part of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.base.errors import InputError
from gsid.records.record import Record
from gsid.response.estimate import as_response, frf
from gsid.response.frf import Frf, error_variance
from gsid.response.stepped import are_stepped
from gsid.spectrum.realisation import listed
from gsid.spectrum.spectra import Spectra

MEASURABLE = 1.5
"""Total variance over that of the noise, in the median over lines, from which on distortion is measured.
Without distortion it is about 1.1: the largest of several estimates of one variance."""


def frf_with_distortion(
    records: Record | Spectra | Sequence[Record | Spectra], *, reference: str | None = None
) -> Frf:
    """Frequency response as `gsid.frf`, with its total variance where the records show it (BLA-1 .. BLA-3).

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
        One per realisation.
    reference : str, optional
        Of records measured in a closed loop: the column of its reference.

    Returns
    -------
    Frf
        `var_total` is None where the variance is not that of periods, or distortion does not exceed the
        noise.

    Raises
    ------
    InputError, NotPeriodicError, ValueError, TypeError
        As `gsid.frf`.
    """
    from gsid.response.total_variance import total_variance

    response = frf(records, reference=reference)
    if response.method != "periods" or are_stepped(listed(records)):
        return response
    try:
        total = total_variance(records, reference=reference)
    except InputError:
        return response
    place = np.searchsorted(total.line, response.line)
    if not np.isin(response.line, total.line).all():
        return response
    noise, variance = total.var_noise[place], total.var_total[place]
    if np.median(variance / noise) < MEASURABLE:
        return response
    return replace(response, var_total=variance, smooth_phases=total.smooth_phases)


def as_response_with_distortion(measured: Frf | Record | Spectra | Sequence[Record | Spectra]) -> Frf:
    """Return a response unchanged, or estimate it from records by :func:`frf_with_distortion`.

    Parameters
    ----------
    measured : Frf, Record or Spectra, or a sequence of records or spectra

    Raises
    ------
    TypeError
        The argument is neither a response nor records.
    InputError, ValueError
        As `gsid.frf`.
    """
    several = measured if isinstance(measured, list | tuple) else [measured]
    if several and all(isinstance(one, Record | Spectra) for one in several):
        return frf_with_distortion(measured)
    return as_response(measured)


def weighted_by_total(response: Frf, relative_error: float = 0.0) -> Frf:
    """The response with its total variance, taken as known, in place of that of the noise.  Eq: EST-15

    Parameters
    ----------
    response : Frf
        With `var_total`.
    relative_error : float
        Error that a linear model is allowed over the response; its square is added to the variance.

    Returns
    -------
    Frf
        Distortion is an error of the output; the (co)variances of the input remain.
    """
    from gsid.response.total_variance import response_level

    assert response.var_total is not None
    variance = response.var_total + relative_error**2 * response_level(response.g)
    noise = error_variance(response.var_u, response.var_y, response.cov_yu, response.g)
    known = np.divide(variance, response.var_g, out=np.ones(len(variance)), where=response.var_g > 0)
    return replace(
        response,
        var_g=variance,
        var_y=response.var_y + (known - 1) * noise,
        n_dof=np.inf,
        var_total=None,
        smooth_phases=False,
    )
