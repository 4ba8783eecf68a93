"""The statistic of CMP-1 against its definition, and what a model's covariance does to its output."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from gsid.models.misfit import Errors, misfit
from gsid.models.piecewise import PiecewiseModel
from gsid.models.rational import RationalModel, half_of

SEED = 20261122
MODEL = RationalModel([900.0], [1.0, 30.0, 900.0], 0.003, free_delay=True)
COV = np.diag([1.0, 40.0, 30.0, 1e-4]) ** 2 + np.outer([0.5, 20, 20, 5e-5], [0.5, 20, 20, 5e-5])
F = np.linspace(0.5, 40, 30)


def errors_of(rng, n, p, *, dof=np.inf, line_0=False, strength=1.0):
    """Errors that are noise and a change of the model along p directions, variances known or estimated."""

    def normal(*shape):
        return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)

    real = np.arange(n) < line_0
    variance = np.exp(rng.standard_normal(n))
    by_model = strength * normal(n, p)
    by_model[real] = by_model[real].real
    noise = np.sqrt(variance) * np.where(real, rng.standard_normal(n), normal(n))
    shape = np.where(real, 0.5, 1.0) * dof
    estimated = variance if np.isinf(dof) else variance * rng.gamma(shape, 1 / shape)
    dof = np.full(n, float(dof))
    return Errors(noise + by_model @ rng.standard_normal(p), estimated, dof, variance, real, by_model)


def quadratic_form(errors):
    """e' (S + A A')^-1 e of real and imaginary parts, as it is written."""
    complex_ = ~errors.real

    def stacked(lines):
        return np.concatenate([lines.real, lines.imag[complex_]])

    half = np.where(errors.real, 1.0, 0.5) * errors.var_weight
    a, e = stacked(errors.by_model), stacked(errors.error)
    cov = np.diag(np.concatenate([half, half[complex_]])) + a @ a.T
    return e @ np.linalg.solve(cov, e)


@pytest.mark.parametrize("p", [1, 5])
def test_with_known_variances_it_is_the_quadratic_form_of_the_full_covariance(p):
    errors = errors_of(np.random.default_rng(SEED), 20, p, strength=3.0)
    assert misfit(errors).chi2 == pytest.approx(quadratic_form(errors), rel=1e-9)
    assert misfit(errors).n_dof == 40


def test_what_is_allowed_at_the_line_at_0_is_real():
    errors = errors_of(np.random.default_rng(SEED), 20, 3, line_0=True, strength=3.0)
    found = misfit(errors)
    t = found.left.t[0]
    as_squares = found.chi2 + 2 * np.log(stats.chi2.sf(t, 1)) + t
    assert as_squares == pytest.approx(quadratic_form(errors), rel=1e-9)


@pytest.mark.parametrize("dof", [1, 2, 7])
@pytest.mark.parametrize("strength", [0.3, 3.0])
def test_it_is_chi_square_with_estimated_variances(dof, strength):
    """2000 draws with 6 parameters on 40 lines: 5 % within the binomial 99.9 % range, and uniform."""
    print("seed", SEED)
    rng = np.random.default_rng([SEED, dof])
    p_values = [misfit(errors_of(rng, 40, 6, dof=dof, strength=strength)).p_value for _ in range(2000)]
    lo, hi = stats.binom.interval(0.999, 2000, 0.05)
    assert lo <= np.sum(np.array(p_values) < 0.05) <= hi
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_output_without_noise_is_judged_too():
    errors = errors_of(np.random.default_rng(SEED), 20, 3)
    none = np.zeros(20)
    with np.errstate(over="ignore"):
        assert misfit(dataclasses.replace(errors, var_mean=none, var_weight=none)).p_value == 0
    explained = dataclasses.replace(errors, error=errors.by_model @ np.ones(3), var_weight=none)
    assert misfit(explained).moved == pytest.approx(3, rel=1e-6)


def test_half_of_a_covariance_that_has_no_inverse():
    cov = COV.copy()
    cov[1], cov[:, 1] = 0, 0  # known
    cov[3], cov[:, 3] = 1e-6 * cov[0], 1e-6 * cov[:, 0]  # tied to another
    cov[3, 3] = 1e-12 * cov[0, 0]
    half = half_of(cov)
    assert half.shape == (4, 2)
    np.testing.assert_allclose(half @ half.T, cov, atol=1e-12 * cov.max())


@pytest.mark.parametrize(("domain", "hold"), [("s", "none"), ("s", "zoh"), ("z", "none")])
def test_deviations_are_the_covariance_of_the_response(domain, hold):
    """Against draws of the parameters, each evaluated as a model of its own."""
    model = dataclasses.replace(MODEL, fs_hz=90.0, hold=hold, cov=COV)
    if domain == "z":
        cov = np.diag([1e-3, 1e-3, 1e-3, 1e-5]) ** 2
        model = RationalModel([0.1], [1, -1.5, 0.7], 1e-3, domain="z", fs_hz=90.0, free_delay=True, cov=cov)
    rng = np.random.default_rng(SEED)
    moved = []
    for x in rng.multivariate_normal(np.zeros(4), 1e-4 * model.cov, 4000):
        den = model.den + np.concatenate([[0], x[:2]])
        moved.append(dataclasses.replace(model, den=den, num=model.num + x[2], delay_s=model.delay_s + x[3]))
    away = 100 * (np.array([one.response(F) for one in moved]) - model.response(F))
    d = model.deviations(F)
    for found, drawn in ((d @ d.conj().T, away.T @ away.conj()), (d @ d.T, away.T @ away)):
        np.testing.assert_allclose(found, drawn / len(away), atol=0.1 * np.max(np.abs(found)))
    if hold == "none":
        np.testing.assert_allclose(np.linalg.norm(d, axis=1), model.response_std(F), rtol=1e-9)


def test_the_pieces_of_a_set_deviate_apart():
    pieces = tuple(dataclasses.replace(MODEL, cov=COV, band_hz=band) for band in ((0.5, 10), (10, 40)))
    d = PiecewiseModel(pieces, (10.0,)).deviations(F)
    np.testing.assert_array_equal(d[F < 10, :4], pieces[0].deviations(F)[F < 10])
    assert not np.any(d[F < 10, 4:])
    assert not np.any(d[F >= 10, :4])
    assert RationalModel([1.0], [1.0, 2.0]).deviations(F).shape == (len(F), 0)


def test_a_p_value_that_underflows_has_its_logarithm():
    """With known variances chi2 is a sum of squares: ln p is -chi2/2 and the terms of a Poisson sum."""
    errors = errors_of(np.random.default_rng(SEED), 3, 0)
    errors = dataclasses.replace(errors, error=200 * np.sqrt(errors.var_mean).astype(complex))
    found = misfit(errors)
    half = found.chi2 / 2
    assert half == pytest.approx(3 * 200**2)
    assert found.p_value == 0
    assert found.log10_p_value == pytest.approx((np.log1p(half + half**2 / 2) - half) / np.log(10), rel=1e-12)


@pytest.mark.parametrize("n_periods", [2, 3, 8])
def test_the_level_holds_for_errors_of_a_fit(n_periods):
    """A parameter took a whole degree of freedom: 10 % of right fits to two periods were rejected at 5 %."""
    print("seed", SEED)
    rng, n, p, runs, dof = np.random.default_rng(SEED), 50, 10, 3000, n_periods - 1
    columns = rng.standard_normal((2 * n, p))
    known = np.linalg.qr(columns)[0]  # of a linear model, with equal weights
    half = rng.standard_normal((runs, 2 * n)) * np.sqrt(0.5)
    left = half - half @ known @ known.T
    variance = rng.gamma(dof, 1 / dof, (runs, n))
    line = np.zeros(n, bool)
    rejected = 0
    for error, own in zip(left, variance, strict=True):
        lines = error[:n] + 1j * error[n:]
        errors = Errors(lines, own, np.full(n, float(dof)), own, line, np.zeros((n, 0)))
        rejected += misfit(errors).p_value_of_fit(p) < 0.05
    low, high = stats.binom.interval(0.999, runs, 0.05)
    print(n_periods, rejected / runs)
    assert low <= rejected <= high
