"""The remark on a line that is not noise where all others are."""

from types import SimpleNamespace

import numpy as np
import pytest

from gsid.diagnosis.from_records.one_line import remark_on_one_line
from gsid.diagnosis.from_records.settings import DEFAULTS

SEED = 20261129
N_LINES, DOF = 60, 20


def fit(*costs, variance_dof=DOF):
    """A fit to records with these costs of their lines, every half hertz."""
    records = [
        SimpleNamespace(
            name="" if i else "low.csv",
            line=np.arange(1, len(one) + 1),
            residual=np.concatenate([np.sqrt(one), np.zeros(len(one))]),
            spectra=SimpleNamespace(f_hz=0.5 * np.arange(len(one) + 1)),
        )
        for i, one in enumerate(map(np.asarray, costs))
    ]
    n = 2 * sum(map(len, costs))
    cost = float(sum(map(np.sum, costs)))
    return SimpleNamespace(
        records=records, variance_dof=variance_dof, cost=cost, n_dof=n, cost_per_dof=cost / n
    )


def remark(*costs):
    return remark_on_one_line(fit(*costs), DEFAULTS)


def test_bug_a_cost_of_three_times_noise_was_no_missing_effect_without_a_word():
    """A disturbance of the lowest line, locked to the period: the test of all lines had p = 0.06."""
    noise = np.full(N_LINES, 2.0)
    one = noise.copy()
    one[3] = 300.0
    (found,) = remark(noise, one)
    assert found.startswith("56 % of the cost is on one line, 2 Hz of record 1 (p = 1e-17)")


def test_the_record_has_its_name():
    (found,) = remark([300.0, *[2.0] * N_LINES])
    assert "0.5 Hz of low.csv" in found


@pytest.mark.parametrize(("cost", "n"), [(27.7, 0), (28.0, 1)])
def test_the_line_counts_from_one_of_a_thousand_fits(cost, n):
    """F(2, 2 d) exceeds x with (1 + x/d)^-d: 60 lines have 14.66 once in a thousand: a cost of 27.9."""
    assert len(remark([cost, *[2.0] * (N_LINES - 1)])) == n


@pytest.mark.parametrize(("others", "n"), [(1.14, 1), (1.20, 0)])
def test_a_model_that_leaves_more_on_all_lines_has_no_such_line(others, n):
    assert len(remark([300.0, *[2 * others * N_LINES / (N_LINES - 1)] * (N_LINES - 1)])) == n


def test_noise_has_such_a_line_in_one_of_a_thousand_fits():
    """Costs are ratios of noise and of variances that are estimated, F(2, 2 dof): 20 of 20 000 expected.

    Not all of them have the rest of the lines below 1.15.
    """
    rng = np.random.default_rng(SEED)
    weight = (DOF - 1) / DOF  # so that the mean of the costs is 2
    n = sum(bool(remark(2 * weight * rng.f(2, 2 * DOF, N_LINES))) for _ in range(20_000))
    assert 5 <= n <= 36, f"seed {SEED}: {n}"  # 99.9 % of a Poisson distribution of 20 is 8 to 36
