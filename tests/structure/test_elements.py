"""Response of structures against a simulator of its own; slopes, refinement and covariance."""

import axes
import numpy as np
import pytest
import truth

from gsid.structure.covariance import estimate
from gsid.structure.elements import Lines, Structure, Values, columns
from gsid.structure.projection import Data, linear_fit, refine
from gsid.structure.stack import as_rational

SEED = 20261123
F_HZ = np.linspace(0.5, 1200, 400)


@pytest.fixture
def rng():
    print("seed", SEED)
    return np.random.default_rng(SEED)


def values_of(axis, output="rate"):
    body = (axis.rate, axis.stiffness)[: 1 + (axis.stiffness > 0)]
    modes = [(2 * np.pi * f, z) for f, z, _ in axis.modes]
    return Values.of(output, body, modes, [axis.lag_s] if axis.lag_s else [], axis.delay_s, False)


@pytest.mark.parametrize("seed", range(6))
def test_held_response_is_exact(seed):
    """Images of the hold at all multiples of the sample rate, with a delay of any fraction of a sample."""
    axis = axes.drawn(np.random.default_rng([SEED, seed]), 0.0)
    axis.modes = axis.modes[:1]
    print("seed", SEED, seed, axis)
    gains = axis.gain * np.array([1.0, axis.modes[0][2]])
    mine = columns(values_of(axis), Lines(F_HZ, axes.FS_HZ, True)) @ gains
    true = truth.linear_response(axis.params(axis.modes[0]), F_HZ)
    assert np.abs(mine / true - 1).max() < 1e-7


def test_held_response_of_the_angle_of_a_free_body():
    """A double pole at 0."""
    values = Values.of("angle", (), [], [], 1.3e-3, False)
    mine = columns(values, Lines(F_HZ, axes.FS_HZ, True))[:, 0] * 7.0
    params = {"fs_hz": axes.FS_HZ, "gain": 7.0, "delay_s": 1.3e-3, "viscous_rate": 1e-6}
    true = truth.linear_response(params, F_HZ, output="theta")
    assert np.abs(mine / true - 1).max() < 1e-5


def test_a_direct_term_has_no_images():
    values = Values.of("rate", (), [], [], 1e-3, True)
    with_images, without = (
        columns(values, Lines(F_HZ, axes.FS_HZ, True, images)) for images in (True, False)
    )
    assert np.all(with_images[:, 1] == without[:, 1])
    assert np.any(with_images[:, 0] != without[:, 0])


@pytest.mark.parametrize("held", [False, True])
def test_refinement_recovers_an_axis(held, rng):
    axis = axes.drawn(rng, 0.0)
    lines = Lines(np.arange(0.5, 250, 1.0), axes.FS_HZ, held)
    true = values_of(axis)
    g = columns(true, lines) @ (axis.gain * np.array([1.0, *(r for _, _, r in axis.modes)]))
    data = Data(lines, g, 1 / (1e-3 * np.abs(g)))
    start = Values(true.structure, true.theta * (1 + 0.002 * rng.standard_normal(len(true.theta))))
    found = refine(start, data)
    assert found.cost < 1e-2
    # the images are constant factors in a step: the exact steps of the estimate end at the truth
    exact = estimate(found, data, 1e-8 * np.abs(g) ** 2, 1.0).fitted
    assert exact.values.theta == pytest.approx(true.theta, rel=1e-6)


def test_covariance_is_that_of_repeated_fits(rng):
    """Sandwich and noise-only form, where the weights are not those of the noise."""
    lines = Lines(np.arange(0.5, 250, 1.0), axes.FS_HZ, False)
    true = Values.of("rate", (12.0,), [(2 * np.pi * 60, 0.03)], [], 2e-3, False)
    g = columns(true, lines) @ np.array([8.0, 2.0])
    sigma = 2e-3 * np.abs(g) * (1 + lines.f_hz / 100)
    weight = 1 / (1e-2 * np.abs(g))
    found = []
    for _ in range(200):
        noise = (rng.standard_normal(len(g)) + 1j * rng.standard_normal(len(g))) / np.sqrt(2)
        data = Data(lines, g + sigma * noise, weight)
        found.append(estimate(refine(true, data), data, sigma**2, 1.0))
    theta = np.array([[*one.fitted.values.theta, *one.fitted.gains] for one in found])
    spread = theta.std(axis=0)
    sandwich, noise_only = (
        np.sqrt(np.mean([np.diag(getattr(one, name)) for one in found], axis=0))
        for name in ("covariance", "noise_only")
    )
    assert sandwich == pytest.approx(spread, rel=0.2)
    assert noise_only == pytest.approx(spread, rel=0.2)


def test_bug_a_rate_far_above_the_band_ended_the_search(rng):
    """A body of 1e15 1/s and a lag of 1e-20 s have no slope left: 0 / 0, and no decomposition of it."""
    lines = Lines(np.arange(0.5, 250, 1.0), axes.FS_HZ, False)
    true = Values.of("rate", (12.0,), [], [], 2e-3, False)
    g = columns(true, lines) @ np.array([8.0])
    g = g + 1e-2 * np.abs(g) * rng.standard_normal(len(g))
    far = Values.of("rate", (1e15,), [], [1e-20], 2e-3, False)
    data = Data(lines, g, 1 / (1e-2 * np.abs(g)))
    found = estimate(linear_fit(far, data), data, 1e-4 * np.abs(g) ** 2, 1.0)
    assert np.all(np.isfinite(found.fitted.values.theta))
    assert np.isfinite(found.fitted.cost)


@pytest.mark.parametrize("output", ["rate", "angle", "acceleration"])
@pytest.mark.parametrize("body", [(), (20.0,), (20.0, 900.0)])
@pytest.mark.parametrize("residual", [False, True])
@pytest.mark.parametrize("n_modes", [0, 1])
def test_rational_form_and_its_order(output, body, residual, n_modes):
    values = Values.of(output, body, [(300.0, 0.02)][:n_modes], [2e-3], 0.0, residual)
    lines = Lines(np.linspace(1, 200, 50), 1000.0, False)
    gains = np.array([10.0, *[-3.0] * n_modes, *[0.01] * residual])
    data = Data(lines, columns(values, lines) @ gains, np.ones(50))
    fitted = linear_fit(values, data)
    num, den = as_rational(estimate(fitted, data, np.ones(50), 1.0))
    assert (len(den) - 1, len(num) - 1) == values.structure.order
    ratio = np.polyval(num, lines.s) / np.polyval(den, lines.s) / data.g
    assert np.abs(ratio - 1).max() < 1e-6


def test_structure_counts_its_parameters():
    structure = Structure("rate", "sprung", 2, 1, True)
    assert structure.n_parameters == 4 + 2 + 4 + 1 + 1
    assert structure.text() == "rate, sprung body, 2 modes, 1 lag, modes above the band"
