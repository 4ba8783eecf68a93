"""Values at the ends of the range of numbers are refused, instead of a numpy warning and a wrong result."""

import numpy as np
import pytest

import gsid
from gsid.base.errors import InputError
from gsid.models.rational import RationalModel
from gsid.records.record import Record

FS_HZ, N, PERIODS = 1000.0, 60, 10
pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")


def record(factor_u=1.0, factor_y=1.0):
    """Periods of 19 lines behind two taps; no period is stated."""
    n = np.arange(N)
    u = np.tile(sum(np.cos(2 * np.pi * k * n / N + k**2) for k in range(1, 20)), PERIODS)
    y = np.convolve(u, [0, 0.5, 0.3])[: len(u)] + np.random.default_rng(7).normal(0, 0.01, len(u))
    return Record(factor_u * u, factor_y * y, FS_HZ, name="rig.csv")


@pytest.mark.parametrize("factors", [(1e200, 1.0), (1.0, 1e200), (1.0, 1e-200)])
@pytest.mark.parametrize(
    "estimate",
    [gsid.frf, lambda one: gsid.frf(one, window=30), lambda one: gsid.frf(one, lpm=True), gsid.noise],
    ids=["periods", "windows", "local polynomials", "noise"],
)
def test_samples_whose_squares_exceed_the_range_are_refused(estimate, factors):
    """Bug: windows, local polynomials and noise wrote NaN after a warning of numpy; periods refused them."""
    with pytest.raises(InputError, match=r"the samples of [uy] are too (large|small)"):
        estimate(record(*factors))


def test_the_coherence_of_an_output_of_zeros_is_not_a_number():
    """Bug: `gsid frf` printed numpy's warning of 0/0."""
    assert np.isnan(gsid.frf(record(1.0, 0.0)).coherence).all()
    assert (gsid.frf(record()).coherence > 0.9).all()


def test_a_leading_coefficient_that_is_too_small_is_refused():
    """Bug: a model of infinite coefficients, after a warning of numpy."""
    with pytest.raises(ValueError, match=r"den\[0\] is too small"):
        RationalModel([1.0, 1e10], [1e-300, 1.0])
    assert RationalModel([1e-300], [1e-300, 1e-300]).num == 1.0
