"""Held-out realisations: the cost's mean and interval, and what tables show of them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from gsid.base.errors import InputError
from gsid.fitting.estimators import fit_all
from gsid.fitting.order import select_order
from gsid.fitting.rational import fit
from gsid.fitting.validation import validate
from gsid.models.rational import RationalModel
from gsid.response.frf import Frf

SEED = 20260403
F = np.arange(1, 61) * 2.0
TRUTH = RationalModel([40.0, 900.0], [1.0, 30.0, 2000.0], 0.0042)


def measured(rng, periods=20, truth=TRUTH, noise=0.01):
    """Mean and sample variance of so many periods."""
    g = truth.response(F)
    sigma = noise * np.abs(g)
    normal = (rng.standard_normal(len(F)) + 1j * rng.standard_normal(len(F))) / np.sqrt(2)
    var = sigma**2 * rng.gamma(periods - 1, 1 / (periods - 1), len(F))
    response = Frf.from_arrays(F, g + sigma * normal, var, fs_hz=3000.0)
    response.period_samples, response.n_periods, response.n_dof = 1500, periods, periods - 1
    return response


def test_the_interval_of_the_cost_covers():
    """200 fits, judged on new data; binomial range of 99.8 %, mean within 4 standard errors."""
    rng = np.random.default_rng(SEED)
    inside, ratio, n = 0, [], 200
    for _ in range(n):
        found = validate(fit(measured(rng), "2/1", delay=TRUTH.delay_s), measured(rng))
        inside += found.interval[0] < found.cost < found.interval[1]
        ratio.append(found.cost / found.cost_expected)
    lo, hi = stats.binom.interval(0.998, n, 0.95)
    assert lo <= inside <= hi, inside / n
    assert np.mean(ratio) == pytest.approx(1, abs=4 * np.std(ratio) / np.sqrt(n))


def test_a_model_that_fits_its_noise_costs_more_on_new_data():
    """p parameters take p/2 off the cost of their own data, and add p/2 to that of new ones."""
    rng = np.random.default_rng(SEED)
    difference = []
    for _ in range(20):
        model = fit(measured(rng), "2/1")
        difference.append(validate(model, measured(rng)).cost - model.cost)
    assert np.mean(difference) == pytest.approx(5 * 19 / 18, abs=4 * np.std(difference) / np.sqrt(20))


def test_a_wrong_model_is_not_adequate_on_new_data():
    rng = np.random.default_rng(SEED)
    ours, new = measured(rng), measured(rng)
    right, wrong = validate(fit(ours, "2/1"), new), validate(fit(ours, "1/0"), new)
    assert right.adequate
    assert not wrong.adequate
    assert wrong.whiteness < 1e-6 < right.whiteness
    assert wrong.error_db > -20 > right.error_db
    assert right.error_db == pytest.approx(right.noise_db, abs=1)
    assert right.noise_db == pytest.approx(-40, abs=1)
    assert validate(fit(ours, "2/1", band=(10, 60)), new).n_lines == 26


def test_tables_show_it():
    rng = np.random.default_rng(SEED)
    ours, new = measured(rng), measured(rng)
    found = fit_all(ours, "2/1", methods=["ls", "ml"], held_out=new)
    assert found["ml"].held_out == validate(found["ml"].model, new)
    table = found.table()
    assert table.rows[1][table.head.index("held-out cost")] == f"{found['ml'].held_out.cost:.5g}"
    assert "held-out cost" not in fit_all(ours, "2/1", methods=["ml"]).table().head
    choice = select_order(ours, ["1/0", "2/1", "4/3"], held_out=new)
    assert choice.chosen.order == "2/1"
    assert choice.chosen in choice.tried
    costs = {c.order: c.held_out.cost for c in choice.tried}
    assert costs["2/1"] < costs["4/3"] < costs["1/0"]  # unlike those of the data fitted
    assert choice.tried[2].cost < choice.tried[1].cost
    assert "held-out cost" in choice.table().head


def test_a_model_is_judged_at_the_rate_of_the_new_data(caplog):
    """Bugs: a held model answered at its own rate, one in z too, and a hold that one of them lacks passed."""
    rng = np.random.default_rng(SEED)
    held = RationalModel(TRUTH.num, TRUTH.den, TRUTH.delay_s, fs_hz=300.0, hold="zoh")
    new = measured(rng, truth=held)
    new.fs_hz, new.hold = 300.0, "zoh"
    want = validate(held, new)
    assert validate(replace(held, fs_hz=3000.0), new) == want
    assert not caplog.records
    validate(TRUTH, new)
    assert "the model has no hold" in caplog.text
    with pytest.raises(InputError, match="300 and 3000 Hz"):
        validate(RationalModel([0.1], [1, -0.9], domain="z", fs_hz=3000.0), new)
