"""The next excitation from a first measurement, against the scatter of repeated measurements."""

import numpy as np
import pytest
from scipy.signal import lfilter

from gsid.excitation.expected import Errors
from gsid.excitation.limits import plan_budget
from gsid.excitation.multisine import Multisine
from gsid.excitation.periodic import Limits
from gsid.excitation.redesign import next_excitation
from gsid.fitting.rational import fit
from gsid.records.record import Record
from gsid.response.estimate import frf
from gsid.response.frf import Frf

FS_HZ, N = 1000.0, 500


def measured(signals, n_periods, noise, rng, pole=0.95, gain=0.5):
    """Response of y[n] = pole y[n-1] + gain u[n-1], in steady state."""
    records = []
    for signal in signals:
        u = np.tile(signal.table(), n_periods + 2)
        y = lfilter([0, gain], [1, -pole], u) + noise * rng.standard_normal(len(u))
        records.append(Record(u, y, FS_HZ, N, 2 * N, hold="zoh"))
    return frf(records)


def first(noise, rng, **axis):
    return measured([Multisine.design(FS_HZ, N, (4, 200), peak=3.0)], 6, noise, rng, **axis)


def test_a_wanted_uncertainty_of_the_response_is_reached():
    rng = np.random.default_rng(5)
    plan = next_excitation(first(0.5, rng), sigma=0.02)
    assert plan.reachable
    assert plan.expected_std == pytest.approx(0.02, rel=1e-3)
    assert plan.amplitude <= 3.01
    truth = lfilter_response(plan.excitation.f_hz)
    errors = []
    for _ in range(100):
        again = measured(plan.realisations(), plan.n_periods, 0.5, rng)
        errors.append(np.abs(again.g / truth - 1) ** 2)
    scatter = np.sqrt(np.mean(errors, axis=0))
    # the noise of each line is known from 6 periods only: the lines agree in the mean
    assert np.sqrt(np.mean(scatter**2)) == pytest.approx(np.sqrt(np.mean(plan.expected**2)), rel=0.15)


def lfilter_response(f_hz, pole=0.95, gain=0.5):
    z = np.exp(-2j * np.pi * f_hz / FS_HZ)
    return gain * z / (1 - pole * z)


@pytest.mark.parametrize("seed", range(10))
def test_each_parameter_scatters_as_expected_after_the_redesign(seed):
    """Ten axes, 300 repeats each: the least certain parameter reaches what was wanted within 15 %."""
    rng = np.random.default_rng(seed)
    axis = {"pole": rng.uniform(0.85, 0.97), "gain": rng.uniform(0.2, 2.0)}
    noise = 0.5 * axis["gain"]
    start = first(noise, rng, **axis)
    model = fit(start, "1/0", delay="none", quiet=True)
    plan = next_excitation(start, parameter_sigma=0.01, model=model, limits=Limits(command=3.0))
    assert plan.reachable
    found = []
    for _ in range(300):
        again = fit(
            measured(plan.realisations(), plan.n_periods, noise, rng, **axis), "1/0", delay="none", quiet=True
        )
        found.append(np.concatenate([again.den[1:], again.num]))
    scatter = np.std(found, axis=0) / np.abs(np.mean(found, axis=0))
    worst = int(np.argmax(plan.expected))
    assert scatter[worst] == pytest.approx(0.01, rel=0.15), f"seed {seed}"


def known(n_periods, n_realisations, noise, total):
    f_hz = np.arange(1, 21) * 2.0
    response = Frf.from_arrays(f_hz, np.ones(20), np.full(20, noise), fs_hz=FS_HZ)
    response.n_periods, response.n_realisations, response.period_samples = n_periods, n_realisations, N
    response.var_total = np.full(20, total)
    return response


def test_distortion_needs_realisations_and_noise_needs_periods():
    many = next_excitation(known(12, 2, 1e-8, 5e-4), sigma=0.01)
    assert (many.n_periods, many.n_realisations) == (2, 11) or many.n_realisations in (10, 12)
    assert many.limited_by == "distortion"
    assert "P = 2" in many.reason
    long = next_excitation(known(12, 2, 1e-3, 1e-3 + 1e-7), sigma=0.004)
    assert long.n_realisations <= 2
    assert long.limited_by == "noise"


def test_what_distortion_alone_prevents_is_reported():
    plan = next_excitation(known(12, 2, 1e-8, 0.5), sigma=0.001)
    assert not plan.reachable
    assert "does not fall with the number of periods" in plan.reason


def test_the_amplitude_is_reduced_if_two_periods_are_enough():
    rng = np.random.default_rng(1)
    plan = next_excitation(first(0.01, rng), sigma=0.05)
    assert plan.n_periods == 2
    assert plan.amplitude < 1.0


def test_the_budget_is_that_of_the_same_formula():
    response = first(2.0, np.random.default_rng(2))
    budget = plan_budget(response, 0.01)
    errors = Errors.of(response)
    variance = errors.variance(np.abs(response.u), budget.n_periods, 1)
    worst = np.max(np.sqrt(variance) / np.abs(response.g))
    assert worst <= 0.01
    fewer = errors.variance(np.abs(response.u), budget.n_periods - 1, 1)
    assert np.max(np.sqrt(fewer) / np.abs(response.g)) > 0.01


@pytest.mark.parametrize(
    "wrong", [{"sigma": 2.0}, {"sigma": 0.1, "parameter_sigma": 0.1}, {"parameter_sigma": 0.1}]
)
def test_what_is_not_valid_is_refused(wrong):
    with pytest.raises(ValueError, match=r"between 0 and 1|not both|needs a model"):
        next_excitation(known(12, 2, 1e-4, 2e-4), **wrong)


def test_a_limit_of_travel_alone_leaves_the_command_within_the_measured_peak():
    response = first(0.5, np.random.default_rng(3))
    model = fit(response, "1/0", delay="none", quiet=True)
    plan = next_excitation(response, sigma=0.002, model=model, limits=Limits(travel=1e9))
    assert plan.amplitude <= 3.01
