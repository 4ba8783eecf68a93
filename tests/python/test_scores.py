"""Scores against the drop in cost that a real least-squares refit brings, and their false-alarm rate."""

import numpy as np
import pytest
from scipy import stats

from gsid.diagnosis.score_test import (
    columns_by_record,
    family_wise_p,
    orthonormal,
    project_out,
    random_periods,
    random_phases,
    score,
)

SEED = 20260304


def problem(rng, n=400, p=5):
    nuisance = rng.standard_normal((n, p)) * 10.0 ** rng.uniform(-3, 3, p)
    return nuisance, rng.standard_normal(n)


@pytest.mark.parametrize("q", [1, 2])
def test_the_drop_is_that_of_a_refit(q):
    rng = np.random.default_rng(SEED)
    nuisance, noise = problem(rng)
    columns = rng.standard_normal((400, q)) + nuisance[:, :1]
    data = noise + columns @ np.full(q, 0.3)
    fit = np.linalg.lstsq(nuisance, data, rcond=None)[0]
    residual = data - nuisance @ fit
    both = np.hstack([nuisance, columns])
    refit = np.linalg.lstsq(both, data, rcond=None)[0]
    drop = residual @ residual - np.sum((data - both @ refit) ** 2)
    got = score(residual, orthonormal(nuisance), columns)
    assert got.drop == pytest.approx(drop, rel=1e-8)
    np.testing.assert_allclose(got.size, refit[-q:], rtol=1e-6)


def test_columns_apart_are_a_fit_of_each_record():
    rng = np.random.default_rng(SEED)
    n_lines = [60, 100, 40]
    columns, data = rng.standard_normal((400, 3)), rng.standard_normal(400)
    fit = np.linalg.lstsq(columns, data, rcond=None)[0]
    residual = data - columns @ fit
    after, first = 0.0, 0
    for m in n_lines:
        rows = np.r_[first : first + m, 200 + first : 200 + first + m]
        own = np.linalg.lstsq(columns[rows], data[rows], rcond=None)[0]
        after += np.sum((data[rows] - columns[rows] @ own) ** 2)
        first += m
    got = score(residual, orthonormal(columns), columns_by_record(columns, n_lines))
    assert got.drop == pytest.approx(residual @ residual - after, rel=1e-8)
    assert got.basis.shape[1] == 6  # three sets of three values, less the one shared


def test_information_of_one_record_alone_is_no_direction():
    """A bug: of a value that acts in one record only, rounding was left apart, and counted as a direction."""
    rng = np.random.default_rng(SEED)
    columns = rng.standard_normal((400, 3))
    columns[np.r_[:100, 200:300], 2] = 0.0  # a stop that the first of two records does not reach
    got = score(rng.standard_normal(400), orthonormal(columns), columns_by_record(columns, [100, 100]))
    assert got.basis.shape[1] == 2
    assert np.max(np.abs(got.size)) < 10


def test_one_sided_scores_never_go_the_unphysical_way():
    rng = np.random.default_rng(SEED)
    nuisance, noise = problem(rng)
    columns = rng.standard_normal((400, 2))
    data = noise + columns @ np.array([1.0, -1.0])
    got = score(data, orthonormal(nuisance), columns, one_sided=True)
    assert got.size[0] > 0
    assert got.size[1] == 0
    assert score(-columns[:, 0], orthonormal(nuisance), columns[:, :1], one_sided=True).drop == 0


def test_a_column_inside_the_nuisances_has_no_score():
    rng = np.random.default_rng(SEED)
    nuisance, noise = problem(rng)
    got = score(noise, orthonormal(nuisance), nuisance @ np.ones((5, 1)))
    assert got.drop == 0
    assert got.survival < 1e-6


def test_projection_is_exact_for_badly_scaled_nuisances():
    rng = np.random.default_rng(SEED)
    nuisance, noise = problem(rng)
    left = project_out(orthonormal(nuisance), noise[:, None])[:, 0]
    assert np.max(np.abs(nuisance.T @ left) / np.linalg.norm(nuisance, axis=0)) < 1e-12


def test_the_best_of_many_is_an_alarm_at_the_stated_rate():
    """300 residuals of noise, 30 candidates each: the least p-value is below 5 % in 5 % (99.9 % range)."""
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    nuisance, _ = problem(rng, n=200)
    basis = orthonormal(nuisance)
    candidates = rng.standard_normal((200, 30))
    alarms = 0
    for i in range(300):
        residual = project_out(basis, rng.standard_normal((200, 1)))[:, 0]
        scores = [score(residual, basis, candidates[:, [j]]) for j in range(30)]
        alarms += min(family_wise_p(residual, random_phases(residual, 199, i), scores)) <= 0.05
    lo, hi = stats.binom.interval(0.999, 300, 0.05)
    assert lo <= alarms <= hi


@pytest.mark.parametrize("periods", [2, 3, 8])
def test_what_the_periods_draw_scatters_as_their_mean(periods):
    """The variance of a mean of P is the sample variance over P, that of P - 1 degrees of freedom: with two
    periods a draw that divides by P instead of sqrt(P (P - 1)) has half of it."""
    print("seed", SEED)
    rng, draws = np.random.default_rng([SEED, periods]), 20_000
    lines = rng.standard_normal((periods, 5)) + 1j * rng.standard_normal((periods, 5))
    drawn = random_periods([lines - lines.mean(0), 3 * (lines - lines.mean(0))], draws, SEED)
    parts = [scale * part for part in (lines.real, lines.imag) for scale in (1, 3)]
    expected = np.concatenate([part.var(axis=0, ddof=1) / periods for part in parts])
    # A variance from 20 000 normal draws scatters by 1 %: five of those.
    np.testing.assert_allclose(drawn.var(axis=1), expected, rtol=5 * np.sqrt(2 / draws))


def test_noise_that_moves_all_lines_together_is_no_alarm():
    """A gain that flutters from period to period: 200 cases, 30 smooth candidates, 8 periods, 2 records."""
    rng = np.random.default_rng(SEED)
    m, periods, n = 100, 8, 200
    response = np.exp(-1j * np.linspace(0, 6, m))
    candidates = [np.exp(-1j * np.linspace(0, 6, m) * (1 + 0.02 * i)) for i in range(30)]
    alarms = {"phases": 0, "periods": 0}
    for i in range(n):
        white = rng.standard_normal((2, periods, m)) + 1j * rng.standard_normal((2, periods, m))
        lines = white / np.sqrt(2) + 2 * rng.standard_normal((2, periods, 1)) * response
        scale = np.sqrt(2 * periods)
        mean = np.concatenate(list(lines.mean(1))) * scale
        residual = np.concatenate([mean.real, mean.imag])
        columns = [np.tile(c, 2) for c in candidates]
        scores = [
            score(residual, np.empty((4 * m, 0)), np.concatenate([c.real, c.imag])[:, None]) for c in columns
        ]
        deviations = [(one - one.mean(0)) * scale for one in lines]
        alarms["phases"] += min(family_wise_p(residual, random_phases(residual, 199, i), scores)) <= 0.05
        alarms["periods"] += min(family_wise_p(residual, random_periods(deviations, 199, i), scores)) <= 0.05
    assert alarms["phases"] > 0.3 * n  # what it would be without
    # The scatter is known from 14 degrees of freedom: P(|t_14| > 1.96) = 7 %; the binomial's 99.9 % of it.
    print("alarms", alarms, "of", n)
    assert alarms["periods"] <= stats.binom.ppf(0.999, n, 2 * stats.t.sf(1.96, 14))
