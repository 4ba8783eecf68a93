"""Coverage of the intervals of a 4 x 4 model over many seeds: `make coverage-mimo`.

One fit of the gimbal a seed. Counted: how often the 95 % intervals of the parts of each pole and of each
delay, and the 95 % circle of each response at six frequencies, hold the truth. Delays that the fit calls
ill-determined, and the responses that have them, are counted apart: what is asked of such a delay is that the
interval over all minima holds the truth.
"""

import sys

import mimo_gimbal as gimbal
import numpy as np
from scipy import stats

from gsid.fitting.mimo import fit_mimo
from gsid.models.confidence import NORMAL_95
from gsid.response.mimo import frf_mimo

F_HZ = np.array([5.0, 30.0, 62.0, 110.0, 171.0, 230.0])


ALL_SEEDS = ("poles", "delays", "responses")
ILL_DELAYS, ILL_RESPONSES = "ill-determined delays, from their range", "responses with such a delay"


def deviations(seed: int, **options) -> dict[str, np.ndarray]:
    """Errors of one fit over their standard deviations, by kind; ill-determined delays apart.

    The same numbers stand in the same places for every seed; nan where a number belongs to the other kind.
    """
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
    ill = model.ill_determined_delays
    delays = (model.delay_s - gimbal.DELAY_S) / model.std_delay_s
    beyond = gimbal.DELAY_S - np.clip(gimbal.DELAY_S, *np.moveaxis(model.delay_range_s, -1, 0))
    responses = np.abs(response) / model.response_std(F_HZ)
    return {
        "poles": parts[order].ravel(),
        "delays": np.where(ill, np.nan, delays).ravel(),
        "responses": np.where(ill, np.nan, responses).ravel(),
        ILL_DELAYS: np.where(ill, beyond / model.std_delay_s, np.nan).ravel(),
        ILL_RESPONSES: np.where(ill, responses, np.nan).ravel(),
    }


def inside(deviations: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Whether the truth lies within 95 %, 1 or 0; a response within the circle of that content."""
    circle = np.sqrt(-np.log(0.05))
    limits = {kind: circle if "responses" in kind else NORMAL_95 for kind in deviations}
    return {
        kind: np.where(np.isnan(values), np.nan, np.abs(values) <= limits[kind])
        for kind, values in deviations.items()
    }


def bounds(n: int, share: float = 0.95, alpha: float = 1e-4) -> tuple[int, int]:
    """Counts that a share of n leaves with probability alpha, both sides together."""
    low, high = stats.binom.ppf([alpha / 2, 1 - alpha / 2], n, share)
    return int(low), int(high)


def main(n: int) -> None:
    seeds = [deviations(seed) for seed in range(n)]
    print(f"{n} seeds; 95 % of them is {0.95 * n:.0f}, sd {np.sqrt(n * 0.95 * 0.05):.1f}")
    for kind in seeds[0]:
        held = np.array([inside(one)[kind] for one in seeds])
        counted = np.isfinite(held)
        if not counted.any():
            print(f"{kind}: none")
            continue
        largest = np.nanmax(np.abs([one[kind] for one in seeds]))
        share = 100 * np.nanmean(held)
        print(f"{kind}: {share:.1f} % of {counted.sum()}; largest error {largest:.1f} standard deviations")
        if kind in ALL_SEEDS:
            often = counted.sum(axis=0) >= n / 4
            share = 100 * np.nanmean(held[:, often], axis=0)
            print(f"    lowest {share.min():.1f}, highest {share.max():.1f}, each of n / 4 seeds or more")
    print_ill_determined(seeds)


def print_ill_determined(seeds: list[dict[str, np.ndarray]]) -> None:
    """Which delays they are, how often, and how often each is held, ill-determined or not."""
    ill = np.array([np.isfinite(one[ILL_DELAYS]) for one in seeds])
    held = [np.nansum([inside(one)["delays"], inside(one)[ILL_DELAYS]], axis=0) for one in seeds]
    share = 100 * np.mean(held, axis=0)
    for i in np.flatnonzero(ill.any(axis=0)):
        output, source = divmod(i, len(gimbal.DELAY_S))
        print(f"delay of output {output + 1}, input {source + 1}: ", end="")
        print(f"ill-determined with {ill[:, i].sum()} seeds of {len(seeds)}, held in {share[i]:.1f} % of all")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
