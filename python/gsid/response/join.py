"""Join responses that were measured in different bands to one response.

A line that was measured once keeps its value. At a line that several measurements share, the responses are
averaged with weights that are inverse to their variances (JOI-1). The measurements must agree there; a test
compares their difference with the noise (JOI-2). The weights use variances that are pooled over neighbouring
lines: a weight that followed the scatter of its own line would favour the measurement whose scatter happens
to be small, and the variance of the mean would be too small.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from gsid.base.errors import InputError
from gsid.base.plottable import Plottable
from gsid.response.frf import Frf
from gsid.spectrum.line_test import exponential_score
from gsid.spectrum.pooling import smoothed

SAME_LINE = 1e-6  # largest relative difference of two frequencies that are one line
OTHER_LEVEL = 1.2  # ratio of two levels from which on they count as different
TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, eq=False)
class Overlap:
    """Comparison of two measurements at their common lines.

    Attributes
    ----------
    names : (str, str)
    f_hz : (F,) [Hz]
        Common lines; empty if there are none.
    difference : (F,) complex
        Second response minus first.
    sigma, dof : (F,)
        Standard deviation of the difference if both responses are the same, and its degrees of freedom.
    p_value : float
        Probability of differences this large or larger if both responses are the same; NaN without a common
        line.
    agree : bool or None
        Whether the test does not reject that both are the same; None without a common line.
    scale : float
        Factor on the standard deviation of the joined lines: 1 if the measurements agree, otherwise the ratio
        of the differences to those of noise.
    relative : float
        Largest difference beyond its 95 % bound, relative to the first response; 0 if they agree.
    where_hz : (lo, hi) or None
        First and last line at which the measurements differ [Hz].
    level_ratio, travel_ratio : float
        Rms input, and rms integral of the output, of the second over the first measurement.
    """

    names: tuple[str, str]
    f_hz: np.ndarray
    difference: np.ndarray
    sigma: np.ndarray
    dof: np.ndarray
    p_value: float
    agree: bool | None
    scale: float
    relative: float
    where_hz: tuple[float, float] | None
    level_ratio: float
    travel_ratio: float

    @property
    def sentence(self) -> str:
        """The result in one or two sentences."""
        first, second = self.names
        if self.agree is None:
            return f"{first} and {second} have no common line: whether they agree is not tested."
        shared = f"at {len(self.f_hz)} common lines, {self.f_hz[0]:.4g} to {self.f_hz[-1]:.4g} Hz"
        if self.agree:
            return f"{first} and {second} agree {shared} (p = {self.p_value:.2g})."
        assert self.where_hz is not None
        low, high = self.where_hz
        return (
            f"{first} and {second} differ {shared} (p = {self.p_value:.2g}): by up to "
            f"{100 * self.relative:.2g} % at {low:.4g} to {high:.4g} Hz. {self._cause} The standard "
            f"deviations of the common lines are multiplied by {self.scale:.3g}."
        )

    @property
    def _cause(self) -> str:
        level, travel = (
            f"{ratio:.2g} times" if max(ratio, 1 / max(ratio, TINY)) >= OTHER_LEVEL else ""
            for ratio in (self.level_ratio, self.travel_ratio)
        )
        if level or travel:
            each = [f"{level} the input"] * bool(level) + [f"{travel} the travel"] * bool(travel)
            return (
                f"The second has {' and '.join(each)}: the response depends on the level or on the position."
            )
        return "Their levels are the same: the position of the axis or the axis itself has changed."


@dataclass(frozen=True, eq=False, repr=False)
class Joined(Plottable):
    """Bands that were measured apart, as one response.

    Attributes
    ----------
    response : Frf
        All lines in ascending order. `dof` has the degrees of freedom of each line.
    parts : tuple of Frf
        The measurements.
    overlaps : tuple of Overlap
        Each measurement compared with those before it.
    """

    response: Frf
    parts: tuple[Frf, ...]
    overlaps: tuple[Overlap, ...]

    @property
    def agree(self) -> bool | None:
        """False if any two measurements differ; None if none of them have a common line."""
        tested = [one.agree for one in self.overlaps if one.agree is not None]
        return all(tested) if tested else None

    @property
    def sentence(self) -> str:
        """The result in words."""
        return " ".join(one.sentence for one in self.overlaps)

    def __repr__(self) -> str:
        return f"{self.response!r}\n{self.sentence}"


def join(responses: Sequence[Frf], *, alpha: float = 0.05) -> Joined:
    """Join responses of different bands to one, and test that they agree at their common lines.

    Parameters
    ----------
    responses : sequence of Frf
        At least two, with a variance, of one sample rate, hold and units. Their periods may differ.
    alpha : float
        False-alarm rate of each test.

    Returns
    -------
    Joined
        JOI-1, JOI-2.

    Raises
    ------
    ValueError
        There are fewer than two responses, one has no variance, or alpha is not between 0 and 1.
    InputError
        The responses differ in sample rate, hold or units, or one is given twice.
    """
    if len(responses) < 2:
        raise ValueError(f"joining needs at least two responses, got {len(responses)}")
    if not 0 < alpha < 1:
        raise ValueError(f"alpha must be between 0 and 1, got {alpha}")
    first = responses[0]
    for one in responses:
        _require_same_axis(first, one)
        if not np.all(np.isfinite(one.var_g)) or np.any(degrees_of_freedom(one) < 1):
            raise ValueError(f"{one.name or 'a response'} has no variance: measure at least 2 periods")
    overlaps: list[Overlap] = []
    pair = functools.partial(_joined_pair, alpha=alpha, overlaps=overlaps)
    whole = functools.reduce(pair, responses)
    return Joined(whole, tuple(responses), tuple(overlaps))


def degrees_of_freedom(response: Frf) -> np.ndarray:
    """Degrees of freedom of the variance of each line, (F,)."""
    return np.full(len(response.g), float(response.n_dof)) if response.dof is None else response.dof


def _require_same_axis(first: Frf, other: Frf) -> None:
    for what in ("fs_hz", "hold", "u_unit", "y_unit"):
        ours, theirs = getattr(first, what), getattr(other, what)
        if ours != theirs and not (ours != ours and theirs != theirs):
            raise InputError(
                f"the responses differ in {what}",
                other.name,
                f"{theirs!r}, not {ours!r} as in {first.name or 'the first'}",
                "join responses of one axis, measured at one sample rate",
            )


def _common(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the frequencies that both ascending lists contain."""
    near = np.clip(np.searchsorted(b, a * (1 - SAME_LINE)), 0, len(b) - 1)
    at = np.flatnonzero(np.abs(b[near] - a) <= SAME_LINE * np.abs(a))
    return at, near[at]


def _pooled(one: Frf) -> np.ndarray:
    """Variances pooled over neighbouring lines, in shares of the response, (F,)."""
    size = np.maximum(np.abs(one.g) ** 2, TINY)
    dof = float(np.min(degrees_of_freedom(one)))
    return np.maximum(smoothed(one.var_g / size, dof)[0] * size, TINY)


def effective_dof(share: np.ndarray, dof_a: np.ndarray, dof_b: np.ndarray) -> np.ndarray:
    """Degrees of freedom of a sum of two sample variances (Welch, Satterthwaite).

    Parameters
    ----------
    share : (F,) ndarray
        Part of the first in the sum, 0 .. 1.
    dof_a, dof_b : (F,) ndarray
        Degrees of freedom of both; inf if a variance is known.
    """
    with np.errstate(divide="ignore"):
        return 1 / (share**2 / dof_a + (1 - share) ** 2 / dof_b)


def _joined_pair(a: Frf, b: Frf, *, alpha: float, overlaps: list[Overlap]) -> Frf:
    at_a, at_b = _common(a.f_hz, b.f_hz)
    if len(at_a) and np.array_equal(a.g[at_a], b.g[at_b]):
        hint = "name each measurement once: its noise does not average out with itself"
        raise InputError("the same measurement is given twice", b.name, None, hint)
    var_a, var_b = _pooled(a)[at_a], _pooled(b)[at_b]
    both = a.at(at_a), b.at(at_b)
    overlap = _overlap(a, b, both, (var_a, var_b), alpha)
    overlaps.append(overlap)
    mean = _weighted_mean(*both, var_b / (var_a + var_b), overlap.scale)
    only_a, only_b = (np.setdiff1d(np.arange(len(x.g)), at) for x, at in ((a, at_a), (b, at_b)))
    return _concatenated(a, b, [a.at(only_a), mean, b.at(only_b)])


def _weighted_mean(a: Frf, b: Frf, weight: np.ndarray, scale: float) -> Frf:
    """Mean of two responses at the same lines; `weight` is that of a.  Eq: JOI-1"""
    g = weight * a.g + (1 - weight) * b.g
    part_a, part_b = weight**2 * a.var_g, (1 - weight) ** 2 * b.var_g
    variance = (part_a + part_b) * scale**2
    total = None
    if a.var_total is not None and b.var_total is not None:
        total = (weight**2 * a.var_total + (1 - weight) ** 2 * b.var_total) * scale**2
    # Input and (co)variances are those of the better measurement, scaled to the variance of the mean.
    better = weight >= 0.5
    own = {name: np.where(better, getattr(a, name), getattr(b, name)) for name in ("u", "var_u", "cov_yu")}
    own_y, own_var = np.where(better, a.var_y, b.var_y), np.where(better, a.var_g, b.var_g)
    periods = np.where(better, a.n_periods, b.n_periods)
    factor = np.divide(variance, own_var, out=np.ones(len(g)), where=own_var > 0) * (a.n_periods / periods)
    # The share by which the degrees of freedom combine is that of the pooled variances: the weight itself.
    return replace(
        a,
        g=g,
        var_g=variance,
        u=own["u"],
        y=g * own["u"],
        var_u=own["var_u"] * factor,
        var_y=own_y * factor,
        cov_yu=own["cov_yu"] * factor,
        var_total=total,
        dof=effective_dof(weight, degrees_of_freedom(a), degrees_of_freedom(b)),
    )


def _concatenated(a: Frf, b: Frf, pieces: list[Frf]) -> Frf:
    """Lines of all pieces in ascending order. Their variances of one period refer to all periods together."""
    order = np.argsort(np.concatenate([one.f_hz for one in pieces]), kind="stable")
    n_periods = a.n_periods + b.n_periods

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(one, name) for one in pieces])[order]

    per_period = {
        name: np.concatenate([getattr(one, name) * (n_periods / one.n_periods) for one in pieces])[order]
        for name in ("var_u", "var_y", "cov_yu")
    }
    dof = np.concatenate([degrees_of_freedom(one) for one in pieces])[order]
    same_grid = a.period_samples == b.period_samples and a.period_samples > 0
    with_total = a.var_total is not None or b.var_total is not None
    totals = [one.var_g if one.var_total is None else one.var_total for one in pieces]
    return replace(
        a,
        **{name: joined(name) for name in ("f_hz", "g", "var_g", "u", "y")},
        **per_period,
        line=joined("line") if same_grid else np.arange(1, len(order) + 1),
        period_samples=a.period_samples if same_grid else 0,
        n_periods=n_periods,
        n_realisations=a.n_realisations + b.n_realisations,
        n_spoiled=a.n_spoiled + b.n_spoiled,
        removed=a.removed + b.removed,
        rejected_hz=np.setdiff1d(np.union1d(a.rejected_hz, b.rejected_hz), joined("f_hz")),
        name=", ".join(name for name in (a.name, b.name) if name),
        method=a.method if a.method == b.method else "joined",
        dof=dof,
        n_dof=len(dof) / float(np.sum(1 / dof)) if np.any(np.isfinite(dof)) else np.inf,
        var_total=np.concatenate(totals)[order] if with_total else None,
        smooth_phases=a.smooth_phases or b.smooth_phases,
    )


def _overlap(
    a: Frf, b: Frf, both: tuple[Frf, Frf], pooled: tuple[np.ndarray, np.ndarray], alpha: float
) -> Overlap:
    """Test that two measurements agree at their common lines.  Eq: JOI-2"""
    first, second = both
    difference = second.g - first.g
    totals = [one.var_g if one.var_total is None else one.var_total for one in both]
    known = [one.var_total is not None for one in both]
    nus = [
        np.full(len(difference), np.inf) if is_known else degrees_of_freedom(one)
        for one, is_known in zip(both, known, strict=True)
    ]
    expected = [
        total if is_known else var for total, is_known, var in zip(totals, known, pooled, strict=True)
    ]
    sigma2 = np.maximum(totals[0] + totals[1], TINY)
    share = expected[0] / np.maximum(expected[0] + expected[1], TINY)
    t = np.abs(difference) ** 2 / sigma2
    # Exact for the true share: |difference|^2 is exponential, and both variances are independent of it.
    score = exponential_score(t * share, nus[0]) + exponential_score(t * (1 - share), nus[1])
    n, p_value, agree = len(t), np.nan, None
    if n:
        p_value = float(special.chdtrc(2 * n, 2 * np.sum(score)))
        agree = p_value >= alpha
    differs = np.flatnonzero(score > -np.log(0.05)) if agree is False else np.empty(0, int)
    if agree is False and not len(differs):
        differs = np.arange(n)
    ratio = float(np.mean(np.abs(difference) ** 2 / np.maximum(sum(expected), TINY))) if n else 1.0
    size = np.abs(first.g[differs])
    return Overlap(
        (a.name or "the first", b.name or "the second"),
        first.f_hz,
        difference,
        np.sqrt(sigma2),
        effective_dof(share, *nus),
        p_value,
        agree,
        scale=max(ratio, 1.0) ** 0.5 if agree is False else 1.0,
        relative=float(np.max(np.abs(difference[differs]) / np.maximum(size, TINY))) if len(differs) else 0.0,
        where_hz=(float(first.f_hz[differs[0]]), float(first.f_hz[differs[-1]])) if len(differs) else None,
        level_ratio=_ratio(b.u, a.u),
        travel_ratio=_ratio(b.y / (2 * np.pi * b.f_hz), a.y / (2 * np.pi * a.f_hz)),
    )


def _ratio(numerator: np.ndarray, denominator: np.ndarray) -> float:
    """Ratio of two rms values of lines."""
    return float(np.linalg.norm(numerator) / max(np.linalg.norm(denominator), TINY))
