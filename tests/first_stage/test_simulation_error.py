"""Null experiment of the p-value from which the error of simulating an unheld input is subtracted (PLT-3)."""

import numpy as np
from scipy.stats import binom

import gsid
from gsid.diagnosis.from_records.simulation_error import noise_p_value, simulation_error
from gsid.excitation.multisine import Multisine
from gsid.plant.effect import Effect, Param

SEED, TRIALS, FS_HZ, N = 6004, 200, 1000.0, 200


def complete_fit(rng):
    """A body of the right structure, lines up to 0.3 to 0.48 of the sample rate, noise of 1e-5 to 1e-3."""
    n_periods, noise = int(rng.choice([3, 4, 6, 8])), 10 ** rng.uniform(-5, -3)
    gain, rate, delay_s = 10 ** rng.uniform(2, 4), 10 ** rng.uniform(0, 2), rng.uniform(0, 3e-3)
    band = (5, rng.uniform(300, 480))
    u = Multisine.design(FS_HZ, N, band, phases="random", seed=int(rng.integers(1e9))).table()
    s = 2j * np.pi * np.fft.rfftfreq(N, 1 / FS_HZ)
    clean = np.fft.irfft(np.fft.rfft(u) * gain / (s + rate) * np.exp(-s * delay_s))
    clean -= clean.mean()
    y = np.tile(clean, n_periods) + noise * np.std(clean) * rng.standard_normal(N * n_periods)
    stack = {
        "rigid_body": {"gain": 1.05 * gain},
        "viscous_friction": {"rate": 0.95 * rate},
        "transport_delay": {"delay_s": 1.05 * delay_s + 1e-5},
    }
    effects = [Effect(name, {each: Param(v) for each, v in params.items()}) for name, params in stack.items()]
    record = gsid.Record(np.tile(u, n_periods), y, FS_HZ, N, 0, hold="none")
    return gsid.fit_plant(gsid.PlantModel(FS_HZ, effects, "rate"), [record])


def test_complete_models_of_unheld_inputs_are_rejected_at_the_stated_rate():
    """The counts lie in the central 99.9 % of their binomial distribution; the plain p-value rejects most."""
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    fits = [complete_fit(rng) for _ in range(TRIALS)]
    p_values = np.array([noise_p_value(fit) for fit in fits])
    disturbed = np.array([simulation_error(fit) > 50 for fit in fits])
    assert np.count_nonzero(disturbed) > TRIALS / 2
    for alpha in (0.01, 0.05, 0.2):
        for some in (p_values, p_values[disturbed]):
            low, high = binom.interval(0.999, len(some), alpha)
            print(f"{np.mean(some < alpha):.4f} of {len(some)} are below {alpha}")
            assert low <= np.count_nonzero(some < alpha) <= high
    assert np.mean([fit.noise_p_value < 0.05 for fit in fits]) > 0.5
