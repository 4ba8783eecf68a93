"""Order selection on responses with known order."""

import numpy as np
import pytest
from scipy import stats

from gsid.fit import fit
from gsid.frf import Frf
from gsid.model import RationalModel
from gsid.order import near_cancelled, select_order
from gsid.validation import whiteness

SEED = 20260304
F = np.arange(1, 121) * 1.0
TRUTH = RationalModel([40.0, 900.0], [1.0, 30.0, 2000.0], 0.0042)


def measured(seed, truth=TRUTH, noise=0.01):
    rng = np.random.default_rng([SEED, seed])
    g = truth.response(F)
    sigma = noise * np.abs(g)
    error = sigma / np.sqrt(2) * (rng.standard_normal(len(F)) + 1j * rng.standard_normal(len(F)))
    return Frf.from_arrays(F, g + error, sigma**2, fs_hz=3000.0)


def test_the_true_order_is_chosen_and_its_cost_is_in_the_interval():
    choice = select_order(measured(0))
    assert choice.chosen.order == "2/1"
    first, second, third = choice.tried[:3]
    assert (first.order, second.order, third.order) == ("1/0", "2/1", "3/2")
    assert first.cost > first.interval[1]
    assert second.interval[0] < second.cost < second.interval[1]
    assert second.p_value < 1e-6 < third.p_value
    assert first.whiteness < 1e-6 < second.whiteness
    assert second.mdl == pytest.approx(second.cost + 5 / 2 * np.log(240))
    assert "chosen" in choice.table()[1][1][-1]


def test_a_surplus_zero_is_removed():
    truth = RationalModel([900.0], [1.0, 30.0, 2000.0], 0.0042)
    assert select_order(measured(0, truth)).chosen.order == "2/0"


def test_orders_may_be_given():
    choice = select_order(measured(0), ["1/0", "3/2"])
    assert [c.order for c in choice.tried] == ["1/0", "3/2"]
    with pytest.raises(ValueError, match="order"):
        select_order(measured(0), ["x"])


def test_whiteness_is_uniform_for_the_truth():
    """Kolmogorov's test over 100 draws, at 0.1 %."""
    values = [whiteness(TRUTH, measured(seed)) for seed in range(100)]
    assert stats.kstest(values, "uniform").pvalue > 1e-3


def test_a_pair_that_nearly_cancels_is_found():
    response = measured(0)
    assert near_cancelled(fit(response, "2/1")) == []
    pole, zero = np.array([-200.0 + 300j, -200.0 - 300j]), np.array([-200.1 + 300j, -200.1 - 300j])
    surplus = RationalModel(
        np.polymul(TRUTH.num, np.poly(zero).real), np.polymul(TRUTH.den, np.poly(pole).real), TRUTH.delay_s
    )
    surplus.free_delay = True
    x = surplus.gradient(F) / np.sqrt(response.var_g)[:, None]
    information = 2 * (x.conj().T @ x).real  # EST-5
    scale = 1 / np.sqrt(np.diag(information))
    surplus.cov = np.linalg.inv(information * scale[:, None] * scale) * scale[:, None] * scale
    found = near_cancelled(surplus)
    assert len(found) == 1
    assert found[0][0] == pytest.approx(pole[0], rel=1e-6)


def test_pairs_of_a_surplus_order_are_found_and_left_out():
    """A fit of 6/5 to a plant of 2/1 has them, what the selection chooses has not."""
    response = measured(0)
    assert len(near_cancelled(fit(response, "6/5"))) >= 1
    chosen = select_order(response).chosen
    assert (chosen.order, near_cancelled(chosen.model)) == ("2/1", [])
