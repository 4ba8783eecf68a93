"""Which minima the estimators end in, and what they cost, on the plant of the benchmarks."""

import control
import numpy as np
import pytest
from scipy import stats

from gsid.fitting.estimators import fit_all
from gsid.fitting.order import select_order
from gsid.fitting.rational import fit
from gsid.models.rational import RationalModel
from gsid.response.frf import Frf

SEEDS = range(12)
F = np.arange(1, 251) * 1.0
WA, WR = 2 * np.pi * 165, 2 * np.pi * 179
AXIS = RationalModel(
    17 * np.polymul([1, 11], [1, 0.03 * WA, WA**2]), np.polymul([1, 11, 170], [1, 0.03 * WR, WR**2]), 0.0054
)
N_PARAMETERS = 4 + 4 + 1


def measured(seed: int, noise: float = 3e-4) -> Frf:
    """White noise of known variance, `noise` of the largest gain."""
    rng = np.random.default_rng([20260404, seed])
    g = AXIS.response(F)
    sigma = np.full(len(F), noise * np.max(np.abs(g)))
    error = sigma / np.sqrt(2) * (rng.standard_normal(len(F)) + 1j * rng.standard_normal(len(F)))
    return Frf.from_arrays(F, g + error, sigma**2, fs_hz=3000.0)


def true_cost(response: Frf) -> float:
    return float(np.sum(np.abs(response.g - AXIS.response(F)) ** 2 / response.var_g))


@pytest.fixture(scope="module")
def responses() -> list[Frf]:
    return [measured(seed) for seed in SEEDS]


def test_ml_costs_what_the_true_model_costs_less_its_parameters(responses):
    """2 (V_true - V_ml) is chi-square of p where the variances are known: each, and their sum, at 99.8 %."""
    gained = np.array([2 * (true_cost(r) - fit(r, "4/3").cost) for r in responses])
    print("seeds", list(SEEDS), "2 (V_true - V_ml)", gained)
    lo, hi = stats.chi2.interval(1 - 0.002 / len(gained), N_PARAMETERS)
    assert np.all((gained > lo) & (gained < hi)), gained
    lo, hi = stats.chi2.interval(0.998, N_PARAMETERS * len(gained))
    assert lo < gained.sum() < hi


def test_ml_lies_in_the_interval_stated(responses):
    """The 95 % interval of the table of orders; of 12 seeds 8 or more are inside (binomially 99.98 %)."""
    inside = 0
    for response in responses:
        (tried,) = select_order(response, ["4/3"]).tried
        inside += tried.interval[0] < tried.cost < tried.interval[1]
    assert inside >= 8


@pytest.mark.parametrize("noise", [3e-5, 3e-4, 1e-3])
def test_nls_and_log_do_not_fail_where_ml_does_not(noise):
    """Stable, converged, with the resonance and the delay of the truth; 1e-3 buries the anti-resonance."""
    for seed in SEEDS:
        found = fit_all(measured(seed, noise), "4/3", methods=["nls", "nls-output", "log", "ml"])
        for row in found.rows:
            assert not row.note, (seed, row)
            poles = row.model.poles
            resonance = poles[np.argmin(np.abs(poles - (-0.015 + 1j) * WR))]
            assert abs(resonance.imag / WR - 1) < 0.01, (seed, row)
            assert abs(row.model.delay_s - AXIS.delay_s) < 5 * row.model.std_delay_s, (seed, row)


def test_ga_reaches_the_basin_of_iwls_without_it(responses):
    """Both are starts of the same nonlinear least squares, and end in one minimum.

    Bred by absolute errors it missed the resonance in 17 of 48 runs here, with seed 1 at the third response.
    """
    for response in responses[:4]:
        from_iwls = fit(response, "4/3", method="nls", start=fit(response, "4/3", method="iwls"))
        by_evolution = fit(response, "4/3", method="ga", seed=1)

        def squares(model, g=response.g):
            return np.sum(np.abs(model.response(F) - g) ** 2)

        assert squares(by_evolution) == pytest.approx(squares(from_iwls), rel=1e-3)


def test_an_unstable_lead_is_turned_into_a_shorter_delay(responses):
    """From a delay 1.5 ms too long, which unstable poles make up for, to a cost below that of the true model.

    Its poles were reflected and nothing else. The search among stable models then began at a cost of 1e8,
    ended at 590 times the true model's with the first response here, and found nothing with the sixth.
    """
    lag, lead = control.pade(1.5e-3, 5)
    start = RationalModel(np.polymul(AXIS.num, lead), np.polymul(AXIS.den, lag), AXIS.delay_s + 1.5e-3)
    for response in responses[:6]:
        model = fit(response, "9/8", start=start)
        assert model.stable
        assert model.cost < true_cost(response)
