"""Random damped axes with a free delay: how often a fit ends in a wrong minimum, and reports it.

    make minima-study     (or .venv/bin/python tests/python/damped_axes.py [--axes 80] [--first-seed 0])

Poles, zeros, delays, lines and noise come from continuous ranges, so that no grid of the search meets them.
A fit is wrong where it costs more than 1.01 times the least cost known: of fits begun at the truth, at random
models around it, and of the fit itself. Two families: the natural frequency lies within the band, or anywhere
from 3 to 60 Hz, below the band too. The fit knows the variance of each line exactly.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from gsid.base.errors import GsidError
from gsid.fitting.rational import fit
from gsid.models.rational import RationalModel
from gsid.response.frf import Frf

FS_HZ = 3000.0
FAMILIES = ("in band", "anywhere")
HOLDS = ("none", "zoh")
STARTS = 12  # random models around the truth
WRONG = 1.01  # times the least cost known


@dataclass(frozen=True)
class Axis:
    """A damped axis and a response of it with noise."""

    truth: RationalModel
    response: Frf

    @property
    def order(self) -> tuple[int, int]:
        """Poles and zeros."""
        return self.truth.n_poles, self.truth.n_zeros

    @property
    def true_cost(self) -> float:
        """V of the truth."""
        error = self.response.g - self.truth.response(self.response.f_hz)
        return float(np.sum(np.abs(error) ** 2 / self.response.var_g))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is as likely anywhere."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def random_lines(rng: np.random.Generator) -> np.ndarray:
    """60 to 400 lines in even steps, or 40 to 150 about even in log f, over one to two and a half decades."""
    f_max = log_uniform(rng, 60, 1000)
    f_min = max(f_max / 10 ** rng.uniform(1, 2.5), 0.5)
    if rng.integers(2):
        step = max(0.25, np.round((f_max - f_min) / rng.integers(60, 400) * 4) / 4)
        return np.arange(np.ceil(f_min / step), np.floor(f_max / step) + 1) * step
    return np.unique(np.round(np.geomspace(f_min, f_max, rng.integers(40, 150)) * 4) / 4)


def random_axis(seed: int, family: str, hold: str) -> Axis:
    """A damped axis of order 2/1, 3/1 or 3/2, and its response with errors of 0.1 or 1 % at every line."""
    rng = np.random.default_rng([20261122, seed, FAMILIES.index(family)])
    f_hz = random_lines(rng)
    low, high = (1.5 * f_hz[0], f_hz[-1] / 4) if family == "in band" else (3.0, 60.0)
    w = 2 * np.pi * log_uniform(rng, low, high)
    num = np.array([1, w * log_uniform(rng, 0.3, 6)])
    den = np.array([1, 2 * rng.uniform(0.3, 1.5) * w, w**2])
    if rng.integers(2):
        den = np.polymul(den, [1, w * log_uniform(rng, 0.2, 8)])
        if rng.integers(2):
            num = np.polymul(num, [1, w * log_uniform(rng, 0.3, 6)])
    truth = RationalModel(num * (10 * den[-1] / num[-1]), den, rng.uniform(0, 0.0115), hold=hold, fs_hz=FS_HZ)
    return Axis(truth, with_noise(truth, f_hz, rng, share=(1e-3, 1e-2)[rng.integers(2)]))


def with_noise(truth: RationalModel, f_hz: np.ndarray, rng: np.random.Generator, share: float) -> Frf:
    """A response whose errors have the same share of |g| at every line."""
    g = truth.response(f_hz)
    sigma = share * np.abs(g)
    errors = sigma * (rng.standard_normal(len(g)) + 1j * rng.standard_normal(len(g))) / np.sqrt(2)
    return Frf.from_arrays(f_hz, g + errors, sigma**2, fs_hz=FS_HZ)


def least_cost_known(axis: Axis, seed: int, n_starts: int = STARTS) -> float:
    """Of fits begun at the truth and at random models around it."""
    rng, truth, hold = np.random.default_rng([7, seed]), axis.truth, axis.truth.hold
    costs = [fit(axis.response, axis.order, hold=hold, start=truth, quiet=True).cost]
    for _ in range(n_starts):
        zeros, poles = (roots * np.exp(0.4 * rng.standard_normal()) for roots in (truth.zeros, truth.poles))
        gain = truth.num[0] * np.prod(np.abs(poles / truth.poles)) / np.prod(np.abs(zeros / truth.zeros))
        delay_s = truth.delay_s + rng.uniform(-1, 1) / (4 * axis.response.f_hz[-1])
        start = RationalModel(
            gain * np.real(np.poly(zeros)), np.real(np.poly(poles)), delay_s, hold=hold, fs_hz=FS_HZ
        )
        try:
            costs.append(fit(axis.response, axis.order, hold=hold, start=start, quiet=True).cost)
        except GsidError:
            continue
    return float(min(costs))


@dataclass(frozen=True)
class Ending:
    """Where one fit ended."""

    seed: int
    ratio: float  # cost over the least known
    per_line: float  # cost over that expected of noise alone
    reported: bool
    converged: bool

    @property
    def wrong(self) -> bool:
        """Another minimum than the lowest known."""
        return self.ratio > WRONG


def ending(seed: int, family: str, hold: str, n_starts: int = STARTS) -> Ending:
    """Fit one axis from nothing."""
    axis = random_axis(seed, family, hold)
    model = fit(axis.response, axis.order, hold=hold, quiet=True)
    least = min(least_cost_known(axis, seed, n_starts), model.cost)
    reported = any(warning.what == "excess_cost" for warning in model.warnings)
    return Ending(seed, model.cost / least, model.cost / model.cost_expected, reported, bool(model.converged))


def row(family: str, hold: str, found: list[Ending]) -> str:
    """Row of the table for the docs."""
    wrong = [one for one in found if one.wrong]
    worst = max((one.ratio for one in wrong), default=1.0)
    reported = sum(one.reported for one in wrong)
    silent = max((one.per_line for one in wrong if not one.reported), default=None)
    n_false = sum(one.reported for one in found if not one.wrong)
    return (
        f"| {family} | {hold} | {len(wrong)} of {len(found)} | {worst:.3g} | {reported} of {len(wrong)} | "
        f"{'' if silent is None else f'{silent:.3g}'} | {n_false} of {len(found) - len(wrong)} |"
    )


def main() -> None:
    """Run the study and print the table."""
    parser = argparse.ArgumentParser(description="Wrong minima of damped axes with a free delay.")
    parser.add_argument("--axes", type=int, default=80, help="axes of each family and hold")
    parser.add_argument("--first-seed", type=int, default=0)
    arguments = parser.parse_args()
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.axes)
    print(f"seeds {seeds.start} to {seeds.stop - 1}")
    head = (
        "natural frequency", "hold", "wrong", "worst, times the least cost", "reported of the wrong",
        "largest unreported, times the cost expected", "reported of the right",
    )  # fmt: skip
    print("| " + " | ".join(head) + " |\n|---|---|---:|---:|---:|---:|---:|")
    for family in FAMILIES:
        for hold in HOLDS:
            print(row(family, hold, [ending(seed, family, hold) for seed in seeds]), flush=True)


if __name__ == "__main__":
    main()
