"""Coverage of the intervals of a 4 x 4 model over many seeds: `make coverage-mimo`.

One fit of the gimbal a seed. Counted: how often the 95 % intervals of the parts of each pole and of each
delay, and the 95 % circle of each response at six frequencies, hold the truth.
"""

import sys

import mimo_gimbal as gimbal
import numpy as np
from scipy import stats

from gsid.confidence import NORMAL_95
from gsid.mimo import frf_mimo
from gsid.mimo_fit import fit_mimo

F_HZ = np.array([5.0, 30.0, 62.0, 110.0, 171.0, 230.0])


def deviations(seed: int, **options) -> dict[str, np.ndarray]:
    """Errors of one fit over their standard deviations, by kind."""
    model = fit_mimo(frf_mimo(gimbal.experiments(seed, **options)), "8/7")
    true = gimbal.true_poles()
    upper = np.flatnonzero(model.poles.imag > 0)
    true = true[[np.argmin(np.abs(true - pole)) for pole in model.poles[upper]]]
    error = model.poles[upper] - true
    order = np.argsort(true.imag)
    parts = np.column_stack([error.real, error.imag]) / np.sqrt(
        np.diagonal(model.pole_cov[upper], axis1=1, axis2=2)
    )
    response = model.response(F_HZ) - gimbal.true_response(F_HZ)
    return {
        "poles": parts[order].ravel(),
        "delays": ((model.delay_s - gimbal.DELAY_S) / model.std_delay_s).ravel(),
        "responses": (np.abs(response) / model.response_std(F_HZ)).ravel(),
    }


def inside(deviations: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Whether the truth lies within 95 %; a response within the circle of that content."""
    limits = {"poles": NORMAL_95, "delays": NORMAL_95, "responses": np.sqrt(-np.log(0.05))}
    return {kind: np.abs(values) <= limits[kind] for kind, values in deviations.items()}


def bounds(n: int, share: float = 0.95, alpha: float = 1e-4) -> tuple[int, int]:
    """Counts that a share of n leaves with probability alpha, both sides together."""
    low, high = stats.binom.ppf([alpha / 2, 1 - alpha / 2], n, share)
    return int(low), int(high)


def main(n: int) -> None:
    seeds = [deviations(seed) for seed in range(n)]
    print(f"{n} seeds; 95 % of them is {0.95 * n:.0f}, sd {np.sqrt(n * 0.95 * 0.05):.1f}")
    for kind in seeds[0]:
        share = 100 * np.mean([inside(one)[kind] for one in seeds], axis=0)
        largest = np.abs([one[kind] for one in seeds]).max()
        print(
            f"{kind}: {share.mean():.1f} % on average, lowest {share.min():.1f}, highest {share.max():.1f}; "
            f"largest error {largest:.1f} standard deviations"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
