"""The core's fit on a target, single precision beside double: three poles, two zeros and a delay from a
streamed response."""

import numpy as np
import pytest

from gsid._lib import check, ffi, ffi32, lib, lib32
from gsid.excitation.multisine import Multisine
from gsid.response.streaming import StreamingFrf

N, PERIODS, FS_HZ = 6000, 10, 3000
SEED = 7
DEN, NUM, DELAY_S = np.array([1, 60, 4e5, 4.4e6]), np.array([1.2, 40, 5.2e5]), 0.0054
SCALE_RAD_S = 2 * np.pi * 60


def response(f_hz):
    s = 2j * np.pi * f_hz
    return np.exp(-s * DELAY_S) * np.polyval(NUM, s) / np.polyval(DEN, s)


@pytest.fixture(scope="module")
def streamed():
    """Measured in single precision by the spread engine, as on the target."""
    excitation = Multisine.design(FS_HZ, N, (0.5, 250), amplitude=3)
    lines = np.zeros(N // 2 + 1, complex)
    lines[excitation.line] = excitation.spectrum() * response(excitation.f_hz) * (N / 2)
    one_period = np.fft.irfft(lines, N)
    rng = np.random.default_rng(SEED)
    y = np.tile(one_period, PERIODS) + 0.02 * one_period.std() * rng.standard_normal(N * PERIODS)
    streaming = StreamingFrf(
        FS_HZ, N, excitation.line, u_known=excitation.spectrum(), precision="single", engine="spread"
    )
    streaming.step(np.zeros(len(y)), y)
    return streaming.result()


def fit(frf, precision):
    """Parameters and covariance, in the order of gsid_estimate_covariance, found as firmware does: linear
    fits from delays over a grid, then Gauss-Newton from the best."""
    f, c, real, cplx = (
        (ffi, lib, np.float64, np.complex128)
        if precision == "double"
        else (ffi32, lib32, np.float32, np.complex64)
    )
    arrays = [frf.f_hz.astype(real), frf.g.astype(cplx), np.sqrt(frf.var_g).astype(real)]
    data = f.new("gsid_frd *", [len(frf.line)])
    for name, array, kind in zip(("f_hz", "g", "sigma"), arrays, ("real", "cplx", "real"), strict=True):
        setattr(data, name, f.from_buffer(f"gsid_{kind}[]", array))
    work = f.new("gsid_real[]", c.gsid_estimate_mem_size(3, 2) // real().itemsize)
    memory = work, f.sizeof(work)
    cost = f.new("gsid_real *")
    starts = []
    for delay_ms in range(13):
        model = f.new("gsid_rational *")
        check(c.gsid_rational_init(model, c.GSID_DOMAIN_S, 3, 2, SCALE_RAD_S))
        model.delay_s = delay_ms * 1e-3
        if (
            c.gsid_estimate_iwls(data, f.new("gsid_iwls_cfg *", {"n_iterations": 8}), model, cost, *memory)
            >= 0
        ):
            starts.append((cost[0], model))
    model = min(starts, key=lambda start: start[0])[1]
    check(c.gsid_estimate_ml(data, f.new("gsid_ml_cfg *", {"free_delay": 1}), model, cost, *memory))
    cov = np.empty((7, 7), real)
    check(c.gsid_estimate_covariance(data, model, 1, f.from_buffer("gsid_real[]", cov), *memory))
    return np.array([*model.den[0:3], *model.num[0:3], model.delay_s]), cov.astype(float)


def test_single_precision_agrees_with_double_within_the_error_bars(streamed, capsys):
    double, cov = fit(streamed, "double")
    single, cov_single = fit(streamed, "single")
    std = np.sqrt(np.diag(cov))
    powers = SCALE_RAD_S ** np.arange(4)
    truth = np.array(
        [*(DEN[::-1][:3] * powers[:3] / powers[3]), *(NUM[::-1] * powers[:3] / powers[3]), DELAY_S]
    )
    apart = np.abs(single - double) / std
    with capsys.disabled():
        print(
            f"\n  3/2 with delay, single beside double: at most {apart.max():.3f} standard deviations apart"
        )
    # The search stops when a step promises less than a hundredth of what noise costs: a tenth of a deviation.
    assert apart.max() < 0.2
    np.testing.assert_allclose(np.sqrt(np.diag(cov_single)), std, rtol=0.02)
    # and both are right: 7 normal numbers stay within 4 with probability 0.9996
    assert (np.abs(double - truth) < 4 * std).all()
