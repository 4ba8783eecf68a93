"""Transforms by numpy in place of FFTW, as in the wheel: same spectra, same quality of phases."""

import numpy as np
import pytest

from gsid._lib import check, ffi, lib, use_numpy_transforms
from gsid.excitation.limits import optimise
from gsid.excitation.multisine import Multisine
from gsid.spectrum.lines import period_lines


@pytest.fixture
def by_numpy():
    """Return a function that calls another with numpy's transforms."""

    def call(function, *arguments, **options):
        use_numpy_transforms()
        try:
            return function(*arguments, **options)
        finally:
            use_numpy_transforms(False)

    return call


@pytest.mark.parametrize("n_period", [2, 7, 60, 6000, 6007])
def test_spectra_are_the_same_with_either_library(by_numpy, n_period):
    periods = np.random.default_rng(n_period).standard_normal((3, n_period))
    line = np.arange(n_period // 2 + 1, dtype=np.uint32)
    other = by_numpy(period_lines, periods, line, 0)
    np.testing.assert_allclose(other, period_lines(periods, line, 0), rtol=0, atol=1e-14)


def test_phases_are_as_good_with_either_library(by_numpy):
    start = Multisine.design(3000.0, 3000, (1, 250), phases="random", seed=1)
    crests = [found.crest_factor_fine for found in (optimise(start), by_numpy(optimise, start))]
    assert crests[1] == pytest.approx(crests[0], rel=0.01)
    assert crests[1] <= 1.40


def test_a_missing_function_is_refused_and_changes_nothing(by_numpy):
    given = ffi.new("gsid_transform *", (lib.gsid_python_to_lines, ffi.NULL))
    assert lib.gsid_transform_use(given) == lib.GSID_E_NULL
    periods, line = np.ones((1, 8)), np.zeros(1, np.uint32)
    assert period_lines(periods, line, 0)[0, 0] == 1
    assert check(lib.gsid_transform_use(ffi.NULL)) == lib.GSID_OK
