"""How well the 95 % intervals of joined bands and of stepped sines cover the truth: `make joined-study`.

A first-order axis with a delay is excited twice: in a low band with long periods, and in a high band with
short ones. The noise is white and slow, made as samples. The true response is computed by its formula, not by
gsid.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.signal import lfilter
from scipy.stats import binom

from gsid.excitation.generators import SteppedSine
from gsid.excitation.multisine import Multisine
from gsid.models.confidence import complex_bound
from gsid.records.record import Record
from gsid.response.estimate import frf
from gsid.response.frf import Frf
from gsid.response.join import Joined, degrees_of_freedom, join

FS_HZ = 1000.0
B, A = np.array([0, 0, 0.3]), np.array([1, -0.97])  # y[n] = 0.97 y[n-1] + 0.3 u[n-2]
N_LOW, N_HIGH = 4000, 1000
LOW_HZ, HIGH_HZ = (0.5, 12.0), (4.0, 200.0)
ALPHA = 1e-3  # of the tests: rate at which a correct program fails


def true_response(f_hz: np.ndarray) -> np.ndarray:
    """Response of the axis, (F,) complex."""
    z = np.exp(-2j * np.pi * f_hz / FS_HZ)
    return (B[2] * z**2) / (1 + A[1] * z)


def measured(u: np.ndarray, n_periods: int, noise: float, rng: np.random.Generator, name: str) -> Frf:
    """Response to a period u, measured in steady state with coloured noise."""
    n_settle = -(-2000 // len(u)) * len(u)
    whole = np.resize(u, n_settle + n_periods * len(u))
    noisy = lfilter(B, A, whole) + noise * coloured(rng, len(whole))
    record = Record(whole, noisy, FS_HZ, len(u), n_settle, name=name, hold="none", y_unit="deg/s")
    return frf(record)


def coloured(rng: np.random.Generator, n: int) -> np.ndarray:
    """White noise, and noise below 5 Hz that is as large, (n,)."""
    slow = lfilter([0.03], [1, -0.97], rng.standard_normal(n + 500))[500:]
    return rng.standard_normal(n) + slow / 0.123


def two_bands(seed: int, p_low: int = 3, p_high: int = 6) -> Joined:
    """Both bands of one seed, joined; their noise differs by a factor of 3."""
    rng = np.random.default_rng(seed)
    low = Multisine.design(FS_HZ, N_LOW, LOW_HZ, phases="random", seed=1, amplitude=1.0).table()
    high = Multisine.design(FS_HZ, N_HIGH, HIGH_HZ, phases="random", seed=2, amplitude=1.0).table()
    parts = measured(low, p_low, 3.0, rng, "low"), measured(high, p_high, 1.0, rng, "high")
    return join(parts)


def inside(response: Frf) -> np.ndarray:
    """Whether the 95 % circle of each line holds the truth, (F,) bool."""
    bound = complex_bound(np.sqrt(response.var_g), n_dof=degrees_of_freedom(response))
    return np.abs(response.g - true_response(response.f_hz)) <= bound


def limits(n: int, share: float = 0.95, alpha: float = ALPHA) -> tuple[int, int]:
    """Counts that a share of n leaves with probability alpha, both sides together."""
    low, high = binom.ppf([alpha / 2, 1 - alpha / 2], n, share)
    return int(low), int(high)


def joined_row(n_seeds: int, p_low: int, p_high: int) -> tuple[float, float, float, int]:
    """Coverage of common lines, of other lines, rate of false alarms, and number of common lines."""
    common, others, alarms = [], [], 0
    for seed in range(n_seeds):
        found = two_bands(seed, p_low, p_high)
        at = np.isin(np.round(found.response.f_hz, 6), np.round(found.overlaps[0].f_hz, 6))
        held = inside(found.response)
        common.append(held[at])
        others.append(held[~at])
        alarms += not found.agree
    return float(np.mean(common)), float(np.mean(others)), alarms / n_seeds, len(common[0])


def stepped_sine(seed: int, n_periods: int, settle: int = 2000) -> Frf:
    """A stepped sine of 0.5 to 12 Hz through the axis from rest, with the same noise."""
    design = SteppedSine.design(
        FS_HZ, 2000, LOW_HZ, grid="quasi-log", settle_samples=settle, n_periods=n_periods, amplitude=2.0
    )
    u = design.table()
    y = lfilter(B, A, u) + coloured(np.random.default_rng(seed), len(u))
    meta = {key: str(value) for key, value in design.steps.keys().items()}
    return frf(Record(u, y, FS_HZ, hold="none", y_unit="deg/s", meta=meta))


def main(n_seeds: int) -> None:
    """Print the table."""
    print(f"seeds 0 .. {n_seeds - 1}\n")
    head = ["P low", "P high", "common lines", "their coverage", "other lines", "false alarms at 5 %"]
    print("| " + " | ".join(head) + " |\n" + "| --- " * len(head) + "|")
    for p_low, p_high in ((2, 2), (2, 6), (3, 6), (4, 12), (10, 20)):
        common, others, alarms, n = joined_row(n_seeds, p_low, p_high)
        print(f"| {p_low} | {p_high} | {n} | {common:.4f} | {others:.4f} | {alarms:.3f} |", flush=True)

    print("\n| P of each sine | sines | coverage |\n| --- | --- | --- |")
    for n_periods in (2, 3, 6):
        found = [stepped_sine(seed, n_periods) for seed in range(n_seeds)]
        held = np.concatenate([inside(one) for one in found])
        print(f"| {n_periods} | {len(found[0].g)} | {held.mean():.4f} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
