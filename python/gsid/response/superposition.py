"""Classical tests for nonlinearity (thesis, 5.2): superposition at two amplitudes, and harmonics of a sine.

On a linear axis the responses at two levels are equal, and their difference is noise. The variance of this
noise at a line is the sum of two variances. Both are estimates. Their ratio is unknown, since the noise may
depend on the level. The test therefore assumes one ratio for all lines, and averages over the values that are
consistent with the records. Given the ratio, both estimates are pooled. The statistic of each line is then
exactly F(2, 2 nu) with the degrees of freedom of both, and the lines are combined as in `gsid.compare`
(DIS-6). If the records show that the ratio differs between lines, a bound that holds for any ratio is used at
each line. The p-value is then an upper bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit
from scipy.stats import beta, chi2, gamma, norm

from gsid.base.cached import cached_property
from gsid.base.errors import InputError
from gsid.base.plottable import Plottable
from gsid.spectrum.line_test import exponential_score

if TYPE_CHECKING:
    from gsid.response.distortion import Distortion

SUPERPOSITION_ALARM = 0.01
# Level of the test for one noise ratio at all lines. A false rejection only reduces the power. If the ratios
# scatter too little for a rejection, they change the level little: those above and below the mean cancel.
RATIO_ALARM = 0.01
RATIO_NODES = np.linspace(-5, 5, 41)  # nodes of a normal variable, for the integral over the ratio
ROUNDING = 1e-13  # of a response: smallest scatter, which records without noise have


@dataclass(repr=False)
class Superposition(Plottable):
    """Comparison of responses at two input levels, which are equal on a linear axis (thesis, eq. 5.2).

    Attributes
    ----------
    line : (F,) int
        Lines excited at both levels.
    f_hz : (F,) [Hz]
    level_ratio : float
        Input of the second measurement over that of the first, rms.
    change : (F,) complex
        Second response minus first.
    change_db, change_deg : (F,)
        Change of gain and phase.
    std : (F,)
        Standard deviation of `change`. With several realisations it includes their scatter.
    n_dof : int
        Complex degrees of freedom of `std`.
    p_value : float
        Probability of changes this large on a linear axis, all lines together (DIS-6).
    noise_ratio : float
        Variance of the output noise at the second level over that at the first, from all lines. With several
        realisations, the ratio of their scatter.
    one_noise_ratio : bool
        Whether the records are consistent with one ratio at all lines. If not, `p_value` is an upper bound.
    first, second : Distortion
    """

    line: np.ndarray
    f_hz: np.ndarray
    level_ratio: float
    change: np.ndarray
    change_db: np.ndarray
    change_deg: np.ndarray
    std: np.ndarray
    n_dof: int
    p_value: float
    noise_ratio: float
    one_noise_ratio: bool
    first: Distortion
    second: Distortion

    @property
    def sentence(self) -> str:
        """Summary of the comparison in one sentence."""
        ratio = f"At {self.level_ratio:.3g} times the input"
        p = f"p {'=' if self.one_noise_ratio else '<='} {self.p_value:.2g}"
        if self.p_value > SUPERPOSITION_ALARM:
            return f"{ratio} the response is the same within its scatter ({p})."
        worst = int(np.argmax(np.abs(self.change) / self.std))
        return (
            f"{ratio} the response changes ({p}): by {self.change_db[worst]:+.2f} dB and "
            f"{self.change_deg[worst]:+.1f} deg at {self.f_hz[worst]:.3g} Hz, where the change is most "
            "significant."
        )

    def __repr__(self) -> str:
        return f"Superposition({len(self.line)} lines; {self.sentence})"


def superposition(first: Distortion, second: Distortion) -> Superposition:
    """Compare the responses at two input levels.

    Parameters
    ----------
    first, second : Distortion
        Measurements of one axis at different levels.

    Returns
    -------
    Superposition

    Raises
    ------
    InputError
        There is no common line, or the output of a record has neither response nor noise.
    """
    if (first.fs_hz, first.period_samples) != (second.fs_hz, second.period_samples):
        what = "the two levels were measured with different periods or rates"
        raise InputError(what, second.name, None, "measure both with the same period")
    line, a, b = np.intersect1d(first.line, second.line, return_indices=True)
    if not len(line):
        raise InputError("no line is excited at both levels", second.name, None, "excite the same lines")
    level_ratio = float(np.sqrt(np.sum(second.u[b] ** 2) / np.sum(first.u[a] ** 2)))
    change = second.bla[b] - first.bla[a]
    ratio = second.bla[b] / first.bla[a]
    scatter = _Scatter(
        variance=np.array([_variance(first)[a], _variance(second)[b]]),
        nu=np.array([_degrees(first), _degrees(second)]),
        expected=(first.u[a] ** 2 * first.n_periods) / (second.u[b] ** 2 * second.n_periods),
    )
    for d, variance in zip((first, second), scatter.variance, strict=True):
        if not np.all(variance > 0):
            hint = "measure an output that responds to the input"
            raise InputError("the output is constant: there is nothing to compare", d.name, None, hint)
    judged = _judged(np.abs(change) ** 2, scatter)
    return Superposition(
        line=line,
        f_hz=first.f_hz[a],
        level_ratio=level_ratio,
        change=change,
        change_db=20 * np.log10(np.abs(ratio)),
        change_deg=np.degrees(np.angle(ratio)),
        **judged,
        first=first,
        second=second,
    )


def _variance(d: Distortion) -> np.ndarray:
    """Variance of the mean response, from the scatter over realisations if there are several.

    On a linear axis the scatter over periods would suffice, with more degrees of freedom. But distortion
    differs between realisations, and this difference is not a change of the response with the level.
    """
    variance = d.var_total if d.n_realisations > 1 else d.var_noise
    return np.maximum(variance, (ROUNDING * np.abs(d.bla)) ** 2)


def _degrees(d: Distortion) -> int:
    return d.n_realisations - 1 if d.n_realisations > 1 else d.n_periods - 1


@dataclass(frozen=True)
class _Scatter:
    """Variances of two responses: `variance` (2, F) with `nu` (2,) complex degrees of freedom.

    If the noise of both outputs has the same variance, the second variance is `expected` (F,) times the
    first.
    """

    variance: np.ndarray
    nu: np.ndarray
    expected: np.ndarray

    @cached_property
    def log_odds(self) -> np.ndarray:
        """Logarithm of the second sum of squares over the first, scaled to equal noise, (F,)."""
        first, second = self.nu[:, None] * self.variance
        return np.log(second / (first * self.expected))

    def share(self, log_ratio: float) -> np.ndarray:
        """Share of the second level in the pooled sum of squares: Beta(nu2, nu1) for the true ratio, (F,)."""
        return expit(self.log_odds - log_ratio)

    def log_ratio(self, mean_share: float) -> float:
        """Logarithm of the noise ratio for which the shares have this mean."""
        odds = self.log_odds
        low, high = odds.min() - 40, odds.max() + 40
        return brentq(lambda x: np.mean(expit(odds - x)) - mean_share, low, high, xtol=1e-6)

    def pooled(self, log_ratio: float) -> np.ndarray:
        """Variance of the difference for this ratio, with the degrees of freedom of both, (F,)."""
        scale = self.expected * np.exp(log_ratio)
        sums = self.nu[:, None] * self.variance
        return (sums[0] + sums[1] / scale) / self.nu.sum() * (1 + scale)


def _judged(power: np.ndarray, scatter: _Scatter) -> dict[str, np.ndarray | float | bool]:
    """Results of `Superposition` for differences with these squared magnitudes (F,)."""
    nu1, nu2 = scatter.nu
    nu = nu1 + nu2
    log_ratio = scatter.log_ratio(nu2 / nu)
    one_ratio = _p_value_of_one_ratio(scatter, log_ratio) > RATIO_ALARM
    if one_ratio:
        variance, n_dof = scatter.pooled(log_ratio), nu
        p_value = _p_value_over_ratios(power, scatter)
    else:
        # (1 + t w/nu1)^-nu1 (1 + t (1 - w)/nu2)^-nu2 <= (1 + t/n_dof)^-n_dof for all shares w of the first
        variance, n_dof = scatter.variance.sum(axis=0), min(nu1, nu2)
        p_value = _combined(power / variance, n_dof)
    return {
        "std": np.sqrt(variance),
        "n_dof": int(n_dof),
        "p_value": p_value,
        "noise_ratio": float(np.exp(log_ratio)),
        "one_noise_ratio": bool(one_ratio),
    }


def _p_value_over_ratios(power: np.ndarray, scatter: _Scatter) -> float:
    """P-value of all lines, averaged over the noise ratios that are consistent with the records.

    At the true ratio, the mean share has a known distribution that does not depend on the pooled variances
    (Basu's theorem). Each of its quantiles therefore gives a ratio. A beta distribution with the same mean
    and variance is exact for one line and a good approximation for more.
    """
    nu1, nu2 = scatter.nu
    nu = nu1 + nu2
    size = (nu + 1) * len(power) - 1
    shares = beta.ppf(norm.cdf(RATIO_NODES), nu2 / nu * size, nu1 / nu * size)
    p_values = [_combined(power / scatter.pooled(scatter.log_ratio(share)), nu) for share in shares]
    return float(np.average(p_values, weights=norm.pdf(RATIO_NODES)))


def _combined(t: np.ndarray, nu: int) -> float:
    """Combined p-value of the statistics t (F,), each F(2, 2 nu) (CMP-1)."""
    return float(chi2.sf(2 * np.sum(exponential_score(t, nu)), 2 * len(t)))


def _p_value_of_one_ratio(scatter: _Scatter, log_ratio: float) -> float:
    """Probability of a scatter of the shares this large if the noise ratio is the same at all lines.

    The sum of their squared deviations is approximated by a gamma variable with the same mean and variance.
    The estimated ratio uses one of the F degrees of freedom.
    """
    n, law = len(scatter.expected), beta(scatter.nu[1], scatter.nu[0])
    if n < 2:
        return 1.0
    mean, variance, kurtosis = law.stats("mvk")
    spread = float(np.sum((scatter.share(log_ratio) - mean) ** 2) / variance)
    width = float(kurtosis) + 2  # variance of one squared deviation
    return float(gamma.sf(spread, (n - 1) / width, scale=width))


@dataclass(frozen=True)
class Harmonic:
    """A harmonic of a sine in the output.

    Attributes
    ----------
    order : int
    f_hz : float
    level, noise : float
        Amplitude, and its standard deviation due to noise, unit of y.
    below_fundamental_db, above_noise_db : float
    """

    order: int
    f_hz: float
    level: float
    noise: float
    below_fundamental_db: float
    above_noise_db: float


def harmonics(d: Distortion) -> list[Harmonic]:
    """List the harmonics of a record whose input is one sine (thesis, section 5.2).

    Parameters
    ----------
    d : Distortion
        Measurement with one excited line.

    Returns
    -------
    list of Harmonic
        From order 2.

    Raises
    ------
    ValueError
        More than one line is excited.
    """
    if len(d.line) != 1:
        raise ValueError(f"{len(d.line)} lines are excited: harmonics need one sine")
    fundamental = float(np.abs(d.bla[0]) * d.u[0])
    found = []
    for i in np.flatnonzero(d.free_order >= 2):
        level, noise = float(d.level[i]), float(d.level_noise[i])
        with np.errstate(divide="ignore"):
            below, above = 20 * np.log10([fundamental / level, level / noise])
        found.append(
            Harmonic(int(d.free_order[i]), float(d.free_f_hz[i]), level, noise, float(below), float(above))
        )
    return found
