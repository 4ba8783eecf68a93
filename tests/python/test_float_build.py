"""The float build of the streaming measurement beside the double build, on a gimbal's signal.

The figure printed here is the one that gsid/frf.h states.
"""

import numpy as np
import pytest

from gsid.excitation.multisine import Multisine
from gsid.response.streaming import StreamingFrf

N, PERIODS = 6000, 75
SEED = 20240229


def gimbal_response(f_hz):
    """Rate over command: rigid body with viscous friction, 5.4 ms delay, 179 Hz mode."""
    s = 2j * np.pi * f_hz
    w0 = 2 * np.pi * 179
    return 7.4 * np.exp(-0.0054 * s) * (1 / (s + 1.5) + 2e-3 * s / (s**2 + 0.02 * w0 * s + w0**2))


@pytest.fixture(scope="module")
def excitation():
    return Multisine.design(3000, N, (0.5, 250), amplitude=3)


def measure(excitation, noise, offset, precision, known, engine):
    rng = np.random.default_rng(SEED)
    lines = np.zeros(N // 2 + 1, complex)
    lines[excitation.line] = excitation.spectrum() * gimbal_response(excitation.f_hz) * (N / 2)
    one_period = np.fft.irfft(lines, N)
    size = one_period.std()
    u = np.tile(excitation.table(), PERIODS)
    y = np.tile(one_period, PERIODS) + size * (offset + noise * rng.standard_normal(N * PERIODS))
    streaming = StreamingFrf(
        3000,
        N,
        excitation.line,
        u_known=excitation.spectrum() if known else None,
        precision=precision,
        engine=engine,
    )
    assert streaming.step(u, y) == PERIODS
    return streaming.result()


# Without noise the float sums round alike in every period and nothing averages out: the worst case. An offset
# of the signal's own size is more than the bias of a gyro worth the name.
@pytest.mark.parametrize(
    ("noise", "offset", "known"), [(0.0, 0.0, True), (1e-3, 1.0, True), (0.1, 0.0, False)]
)
@pytest.mark.parametrize(("engine", "limit"), [("direct", 1e-5), ("spread", 1e-6)])
def test_float_agrees_with_double(excitation, noise, offset, known, engine, limit, capsys):
    double, single = (measure(excitation, noise, offset, p, known, engine) for p in ("double", "single"))

    def distance(name):
        reference = getattr(double, name)
        return np.abs(getattr(single, name) - reference).max() / np.abs(reference).max()

    y, g = distance("y"), distance("g")
    std = np.abs(np.sqrt(single.var_y) - np.sqrt(double.var_y)).max() / np.abs(double.y).max()
    with capsys.disabled():
        print(
            f"\n  float beside double, {engine}, {len(double.line)} lines, {PERIODS} periods of {N}, "
            f"noise {noise:g}, offset {offset:g}, {'known' if known else 'measured'} input: "
            f"Y {y:.1e}, G {g:.1e}, std of Y {std:.1e} of the largest line"
        )
    assert y < limit
    assert g < limit
    assert std < limit
