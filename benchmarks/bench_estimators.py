"""Every estimator on the axis of the thesis, and from random starts on the benchmarks' plant; JSON on stdout.

    make bench-fit       (or bench_estimators.py [--page docs/explanation/estimators.md])

The thesis's own ML model (eq. 7.30) is the truth, its excitation the input (500 lines of 3 V up to 250 Hz, 75
periods at 3 kHz), its band the one fitted (1 to 120 Hz), its order 3/2. Its noise is shown in pictures only:
here 40 dB below the output, half of it white and half below 5 Hz. Errors are those from the truth, root mean
squares over the lines and over ten noise seeds; processor times are medians.

Random starts: frequencies of poles and zeros uniform in the logarithm over the band, dampings over 0.003 to
2, the delay uniform over 0 to 12 ms, the gain right at 10 Hz. A start has converged when the cost minimised
is within 1 % of the best one. For the evolutionary search a start is a seed; the linear methods need none.
As they are used, with the scan of delays, the methods get 200 noise seeds; the best cost of a seed is that
from the true model as a start. A linear method, which minimises no such sum, has to end stable and converged.
--page puts the tables into a page of the docs.
"""

import argparse
import json
import os
import time

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # its threads wait busily, and would count as work

import numpy as np
from bench_fit import AMPLITUDE, F_HZ, FS_HZ, PERIODS, SNR_DB, N, measurement
from page import put, table

from gsid.base.bands import in_band
from gsid.base.errors import GsidError
from gsid.fitting.estimators import fit_all
from gsid.fitting.rational import METHODS, fit
from gsid.models.rational import RationalModel
from gsid.response.frf import Frf

TRUTH = RationalModel([-3.132e-5, 7617, 8.768e4], [1, 1027, 1.153e4, 1.735e5], 0.00543)
BAND, ORDER, SEEDS = (1.0, 120.0), "3/2", range(10)
STARTS, CONVERGED = 200, 1.01
LINEAR = ("ls", "iwls")
WA, WR = 2 * np.pi * 165, 2 * np.pi * 179
PLANT = RationalModel(
    np.polymul([1, 11], [1, 0.03 * WA, WA**2]), np.polymul([1, 11, 170], [1, 0.03 * WR, WR**2]), 5.4e-3
)
"""The benchmarks' plant, but for its gain."""


def source_axis(seed: int) -> Frf:
    """Return the response of the thesis's model as its measurement would give it."""
    rng = np.random.default_rng(seed)
    g = TRUTH.response(F_HZ)
    noise = AMPLITUDE**2 / 2 * np.sum(abs(g) ** 2) * 10 ** (-SNR_DB / 10)
    low = 1 / (1 + (np.arange(N // 2 + 1) * FS_HZ / N / 5) ** 2)
    var = 4 * noise / N * (0.5 + 0.5 * low / low.mean())[1:501] / AMPLITUDE**2 / PERIODS
    error = np.sqrt(var / 2) * (rng.standard_normal(500) + 1j * rng.standard_normal(500))
    var_g = var * rng.gamma(PERIODS - 1, 1 / (PERIODS - 1), 500)
    frf, _ = measurement(seed)  # its input, rates and numbers of periods
    frf.g, frf.var_g, frf.y, frf.var_y = g + error, var_g, (g + error) * frf.u, var_g * PERIODS * AMPLITUDE**2
    return frf


def source_table() -> dict:
    """Return for each method the errors from the truth over the seeds."""
    truth = TRUTH.response(F_HZ[in_band(F_HZ, BAND)])
    measured = [source_axis(seed) for seed in SEEDS]
    rows, expected = {}, []
    for method in METHODS:
        each, cpu_s = [], []
        for frf in measured:
            began = time.process_time()
            found = fit_all(frf, ORDER, methods=[method], reference=truth, band=BAND)
            cpu_s.append(time.process_time() - began)
            each.append(found[method])
            if method == "ml":
                expected.append(found.cost_expected)
        good = [row for row in each if row.model is not None]
        rows[method] = {
            "amplitude_db": rms([row.amplitude_db for row in good]),
            "phase_deg": rms([row.phase_deg for row in good]),
            "error_db": 20 * np.log10(rms([10 ** (row.error_db / 20) for row in good])),
            "cost": float(np.mean([row.cost for row in good])),
            "cpu_ms": 1e3 * float(np.median(cpu_s)),
            "stable_and_converged": sum(not row.note for row in each),
        }
    return rows | {"cost_expected": float(np.mean(expected))}


def rms(x: list) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(x))))


def random_model(rng: np.random.Generator, gain: float) -> RationalModel:
    """Return a stable model of order 4/3."""

    def roots(n: int) -> np.ndarray:
        w = 2 * np.pi * 0.5 * 500 ** rng.uniform(size=n)
        pair = np.exp(rng.uniform(np.log(0.003), np.log(2), size=n // 2))
        coefficients = np.ones(1)
        for i, damping in enumerate(pair):
            coefficients = np.polymul(coefficients, [1, 2 * damping * w[2 * i], w[2 * i] ** 2])
        return np.polymul(coefficients, [1, w[-1]]) if n % 2 else coefficients

    model = RationalModel(roots(3), roots(4), rng.uniform(0, 0.012))
    return RationalModel(model.num * gain / abs(model.response([10.0])[0]), model.den, model.delay_s)


def from_random_starts(method: str) -> int | None:
    """Return how many of the starts end at the best cost of the method; None: it takes no start."""
    if method in LINEAR:
        return None
    frf, _ = measurement(0)
    rng = np.random.default_rng(1)
    best = minimised(fit(frf, "4/3", method="nls" if method == "ga" else method), frf, method)
    costs = []
    for seed in range(STARTS):
        options = {"seed": seed} if method == "ga" else {"start": random_model(rng, 1.0)}
        costs.append(cost_of(frf, method, options))
    return int(np.sum(np.array(costs) <= CONVERGED * best))


def from_the_scan(method: str) -> int:
    """Return at how many noise seeds the method, as it is used, ends at its best cost."""
    count = 0
    for seed in range(STARTS):
        frf, _ = measurement(seed)
        if method in LINEAR:
            count += bool(fit(frf, "4/3", method=method, allow_unstable=True, quiet=True).stable)
            continue
        gain = abs(frf.g[19]) / abs(PLANT.response(F_HZ[19:20])[0])
        truth = RationalModel(PLANT.num * gain, PLANT.den, PLANT.delay_s)
        options = {"start": truth, "method": "nls" if method == "ga" else method}
        best = minimised(fit(frf, "4/3", **options), frf, method)
        count += cost_of(frf, method, {"seed": seed}) <= CONVERGED * best
    return count


def cost_of(frf: Frf, method: str, options: dict) -> float:
    """Return the sum minimised by a fit, infinite where there is no stable model."""
    try:
        return minimised(fit(frf, "4/3", method=method, **options), frf, method)
    except GsidError:
        return np.inf


def minimised(model: RationalModel, frf: Frf, method: str) -> float:
    """Return the sum that a method minimises."""
    g = model.response(frf.f_hz)
    if method == "log":
        return float(np.sum(abs(np.log(g / frf.g)) ** 2))
    return model.cost if method in ("ml", "ml-io") else float(np.sum(abs(g - frf.g) ** 2))


def page_of_source(rows: dict) -> str:
    """Return the table of section 7.10 for the docs."""
    head = ["method", "amplitude [dB]", "phase [deg]", "complex error [dB]"]
    head += [f"cost ({rows['cost_expected']:.1f} expected)", "processor [ms]", "stable and converged, of 10"]
    body = [
        [
            f"`{method}`",
            f"{row['amplitude_db']:.2g}",
            f"{row['phase_deg']:.2g}",
            f"{row['error_db']:.1f}",
            f"{row['cost']:.4g}",
            f"{row['cpu_ms']:.0f}",
            f"{row['stable_and_converged']}",
        ]
        for method, row in rows.items()
        if method != "cost_expected"
    ]
    return table(head, body)


def page_of_starts(rows: dict) -> str:
    """Return the table of convergence for the docs."""
    head = ["method", f"of {STARTS} random starts", f"of {STARTS} noise seeds, as it is used"]
    body = [
        [f"`{method}`", "needs none" if row["random"] is None else str(row["random"]), str(row["as_used"])]
        for method, row in rows.items()
    ]
    return table(head, body)


def main() -> None:
    """Run the benchmark, print its figures, and put them into the given page."""
    parser = argparse.ArgumentParser(description="Every estimator on one axis, and from random starts.")
    parser.add_argument("--page", help="page of the docs that takes the tables")
    page = parser.parse_args().page
    source = source_table()
    starts = {
        method: {"random": from_random_starts(method), "as_used": from_the_scan(method)} for method in METHODS
    }
    print(json.dumps({"source_axis": source, "starts": STARTS, "converged": starts}, indent=2))
    if page:
        put(page, "source_axis", page_of_source(source))
        put(page, "starts", page_of_starts(starts))


if __name__ == "__main__":
    main()
