"""Incomplete gamma and beta functions of the C library against scipy; far tails against long sums."""

import math
from decimal import Decimal, getcontext

import numpy as np
import pytest
from scipy import special

from gsid._lib import ffi, lib

SEED = 20261123
TOLERANCE = 1e-12  # of the issue: scipy itself is right to some 1e-13
N = 3000


def tails(function, *columns):
    """Both sides and their logarithms, (4, n)."""
    tail = ffi.new("gsid_tail *")
    rows = []
    for values in zip(*columns, strict=True):
        assert function(*values, tail) == lib.GSID_OK, values
        rows.append((tail.lower, tail.upper, tail.log_lower, tail.log_upper))
    return np.array(rows).T


def compare(found, lower, upper):
    """Both sides above 1e-300, and their logarithms below -1, within the tolerance."""
    for side, log_side, want in ((found[0], found[2], lower), (found[1], found[3], upper)):
        shown = want > 1e-300
        error = np.abs(side[shown] / want[shown] - 1)
        print(f"seed {SEED}: largest error {error.max():.2g} of {np.count_nonzero(shown)}")
        assert error.max() < TOLERANCE
        low = shown & (want < math.exp(-1))
        np.testing.assert_allclose(log_side[low], np.log(want[low]), rtol=TOLERANCE)
    assert np.all(found[0] + found[1] == pytest.approx(1, abs=1e-15))


def around(rng, mean, sd, low, high):
    """Points near the mean and in the tails, to 4.5 standard deviations, where scipy is exact."""
    away = np.clip(rng.standard_normal(N) * rng.choice([0.3, 3.0], N), -4.5, 4.5)
    return np.clip(mean + sd * away, low, high)


@pytest.mark.parametrize("largest", [1, 3, 4])
def test_incomplete_gamma_functions(largest):
    """Farther from the mean scipy has errors of 2e-12 at a = 1000; mpmath shows 1e-14 here."""
    rng = np.random.default_rng(SEED)
    a = 10 ** rng.uniform(-1, largest, N)
    x = around(rng, a, np.sqrt(a), 1e-3 * a, np.inf)
    compare(tails(lib.gsid_tail_gamma, a, x), special.gammainc(a, x), special.gammaincc(a, x))


@pytest.mark.parametrize("largest", [1, 3, 5])
def test_incomplete_beta_functions(largest):
    rng = np.random.default_rng(SEED)
    a, b = (10 ** rng.uniform(-1, largest, N) for _ in range(2))
    mean = a / (a + b)
    x = around(rng, mean, np.sqrt(mean * (1 - mean) / (a + b + 1)), 1e-6, 1 - 1e-6)
    found = tails(lib.gsid_tail_beta, a, b, x, 1 - x)
    compare(found, special.betainc(a, b, x), special.betaincc(a, b, x))


def test_chi_square_and_f_distributions():
    """F(1, nu) of CMP-1; the argument of the reference is the side that does not lose digits."""
    rng = np.random.default_rng(SEED)
    dof, t = 10 ** rng.uniform(0, 6, N), 10 ** rng.uniform(-6, 3, N)
    ratio = t / dof
    upper = np.where(ratio > 1, special.betainc(dof / 2, 0.5, 1 / (1 + ratio)), np.nan)
    upper = np.where(ratio > 1, upper, special.betaincc(0.5, dof / 2, ratio / (1 + ratio)))
    lower = special.betainc(0.5, dof / 2, ratio / (1 + ratio))
    compare(tails(lib.gsid_tail_f, np.ones(N), dof, t), lower, upper)
    dof = 10 ** rng.uniform(0, 4, N)
    x = around(rng, dof, np.sqrt(2 * dof), 1e-3 * dof, np.inf)
    compare(tails(lib.gsid_tail_chi2, dof, x), special.chdtr(dof, x), special.chdtrc(dof, x))
    known = tails(lib.gsid_tail_f, np.full(N, 3.0), np.full(N, np.inf), t)
    np.testing.assert_array_equal(known, tails(lib.gsid_tail_chi2, np.full(N, 3.0), 3 * t))


def log_poisson_sum(a, x):
    """ln Q(a, x) for a whole a: ln(exp(-x) sum over k < a of x^k/k!), with 60 digits."""
    getcontext().prec = 60
    x, term, total = Decimal(x), Decimal(1), Decimal(1)
    for k in range(1, a):
        term *= x / k
        total += term
    return float(total.ln() - x)


@pytest.mark.parametrize("a", [1, 2, 7, 40, 1000, 20000])
@pytest.mark.parametrize("ratio", [0.3, 0.999, 1.0, 1.01, 2.0, 30.0, 1e4])
def test_logarithms_go_on_where_probabilities_underflow(a, ratio):
    """Errors of the probability 1e-300 and of its logarithm are those of a number near 690."""
    x = a * ratio
    want = log_poisson_sum(a, x)
    ((lower,), (upper,), _, (log_upper,)) = tails(lib.gsid_tail_gamma, [a], [x])
    assert log_upper == pytest.approx(want, rel=TOLERANCE, abs=1e-14)
    assert upper == pytest.approx(math.exp(want), rel=TOLERANCE)
    assert (upper == 0) == (want < -745.2)
    assert 0 <= lower <= 1


def log_lower_sum(a, x):
    """ln P(a, x) by its series with 60 digits, for a whole a."""
    getcontext().prec = 60
    x, term, total = Decimal(x), Decimal(1), Decimal(1)
    k = 1
    while term > total * Decimal("1e-30"):
        term *= x / (a + k)
        total += term
        k += 1
    log_factorial = sum((Decimal(k).ln() for k in range(2, a + 1)), Decimal(0))
    return float(total.ln() + a * x.ln() - x - log_factorial)


@pytest.mark.parametrize(("a", "x"), [(5, 1e-70), (500, 20.0), (3000, 2000.0), (3000, 2999.0)])
def test_lower_tails_against_the_series(a, x):
    _, _, (log_lower,), _ = tails(lib.gsid_tail_gamma, [a], [x])
    assert log_lower == pytest.approx(log_lower_sum(a, x), rel=TOLERANCE)


def test_large_shapes_and_ends():
    """At 1e10 the distribution is normal with the skewness 2/sqrt(a); the ends are exact."""
    a = 1e10
    ((lower,), (upper,), _, _) = tails(lib.gsid_tail_gamma, [a], [a])
    assert upper == pytest.approx(0.5 - 1 / (3 * math.sqrt(2 * math.pi * a)), abs=1e-12)
    ((lower,), (upper,), _, _) = tails(lib.gsid_tail_beta, [a], [a], [0.5], [0.5])
    assert (lower, upper) == (pytest.approx(0.5, abs=1e-11), pytest.approx(0.5, abs=1e-11))
    for function, low, high in (
        (lib.gsid_tail_gamma, (2.0, 0.0), (2.0, np.inf)),
        (lib.gsid_tail_beta, (2.0, 3.0, 0.0, 1.0), (2.0, 3.0, 1.0, 0.0)),
        (lib.gsid_tail_f, (1.0, 3.0, 0.0), (1.0, 3.0, np.inf)),
    ):
        np.testing.assert_array_equal(tails(function, *([v] for v in low))[:, 0], [0, 1, -np.inf, 0])
        np.testing.assert_array_equal(tails(function, *([v] for v in high))[:, 0], [1, 0, 0, -np.inf])


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("gamma", (0.0, 1.0)), ("gamma", (1e11, 1.0)), ("gamma", (1.0, -1.0)), ("gamma", (1.0, np.nan)),
        ("gamma", (np.nan, 1.0)), ("beta", (1.0, 1.0, 0.5, 0.6)), ("beta", (1.0, 1.0, -1e-9, 1.0)),
        ("beta", (np.inf, 1.0, 0.5, 0.5)), ("beta", (1.0, 1.0, np.nan, 0.5)), ("chi2", (-1.0, 1.0)),
        ("f", (1.0, 1.0, -1.0)), ("f", (1.0, np.nan, 1.0)), ("f", (1.0, 1.0, np.nan)),
    ],
)  # fmt: skip
def test_what_has_no_probability_is_refused(name, values):
    function, tail = getattr(lib, f"gsid_tail_{name}"), ffi.new("gsid_tail *", {"lower": -7})
    assert function(*values, tail) == lib.GSID_E_CONFIG
    assert tail.lower == -7
    assert function(*values, ffi.NULL) == lib.GSID_E_NULL
