"""The robust method against the package best-linear-approximation (`make peers`): the same to 4 digits.

What the package calls noise, total and nonlinear are variances of the best linear approximation, the mean
over realisations. gsid's `std_nonlinear` is the distortion of one realisation's response (thesis, eq. 5.16):
its square is the number of realisations times the package's nonlinear variance.
"""

import sys

import numpy as np
import pytest
from nonlinear_axis import FS_HZ, NonlinearAxis

from gsid.records.record import Record
from gsid.response.estimate_distortion import distortion

M, P = 5, 6


@pytest.fixture(scope="module")
def robust(request):
    sys.path.insert(0, str(request.config.rootpath / "benchmarks"))
    beside = pytest.importorskip("beside")
    if beside.peer_version("best-linear-approximation") is None:
        pytest.skip("best-linear-approximation is not installed: make peers")
    return beside.best_linear_approximation()


@pytest.fixture(scope="module")
def measured():
    """Input (M, N), noisy input and output (M, P, N) of an axis with odd and even distortion."""
    rng = np.random.default_rng(71)
    axis = NonlinearAxis(even=0.1, cubic=0.05, noise=0.05)
    u = axis.inputs(rng, M)
    several = np.repeat(u[:, None], P, axis=1)
    y = np.repeat(axis.output(u)[:, None], P, axis=1) + axis.noise * rng.standard_normal((M, P, axis.n))
    return axis, u, several + 0.02 * rng.standard_normal(several.shape), y


def same(ours, theirs):
    """To 4 digits: 5e-5 of each number (distortion in the noise is a difference, and loses some)."""
    np.testing.assert_allclose(ours.bla, np.squeeze(theirs.G.value), rtol=5e-5)
    np.testing.assert_allclose(ours.var_noise, np.squeeze(theirs.G.noise.var), rtol=5e-5)
    np.testing.assert_allclose(ours.var_total, np.squeeze(theirs.G.total.var), rtol=5e-5)
    of_one = np.sqrt(M * np.squeeze(theirs.G.nonlinear.var))
    assert np.count_nonzero(of_one) > 20  # of 32 lines: where noise explains the scatter both say 0
    np.testing.assert_allclose(ours.std_nonlinear, of_one, rtol=5e-5, atol=1e-12)


def test_known_input(robust, measured):
    axis, u, _, y = measured
    ours = distortion([Record(np.tile(a, P), b.ravel(), FS_HZ, axis.n, 0) for a, b in zip(u, y, strict=True)])
    same(
        ours,
        robust.known_input(
            u.T[:, None], np.moveaxis(y, 2, 0)[:, None], FS_HZ, axis.line, show_warnings=False
        ),
    )


def test_measured_input(robust, measured):
    axis, _, u, y = measured
    ours = distortion([Record(a.ravel(), b.ravel(), FS_HZ, axis.n, 0) for a, b in zip(u, y, strict=True)])
    samples = [np.moveaxis(x, 2, 0)[:, None] for x in (u, y)]
    same(ours, robust.noisy_input(*samples, FS_HZ, axis.line, show_warnings=False))
