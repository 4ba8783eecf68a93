"""Every estimator on the axis of the source, and from random starts on the benchmarks' plant; JSON on stdout.

    .venv/bin/python benchmarks/bench_estimators.py

The source's own ML model (eq. 7.30) is the truth, its excitation the input (500 lines of 3 V up to 250 Hz, 75
periods at 3 kHz), its band the one fitted (1 to 120 Hz), its order 3/2. Its noise is shown in pictures only:
here 40 dB below the output, half of it white and half below 5 Hz. Errors are those from the truth, root mean
squares over the lines and over ten noise seeds.

Random starts: frequencies of poles and zeros uniform in the logarithm over the band, dampings over 0.003 to
2, the delay uniform over 0 to 12 ms, the gain right at 10 Hz. A start has converged when the cost minimised
is within 1 % of the best one. For the evolutionary search a start is a seed.
"""

import json

import numpy as np
from bench_fit import AMPLITUDE, F_HZ, FS_HZ, PERIODS, SNR_DB, N, measurement

from gsid.errors import GsidError
from gsid.estimators import fit_all
from gsid.fit import METHODS, fit, in_band
from gsid.frf import Frf
from gsid.model import RationalModel

TRUTH = RationalModel([-3.132e-5, 7617, 8.768e4], [1, 1027, 1.153e4, 1.735e5], 0.00543)
BAND, ORDER, SEEDS = (1.0, 120.0), "3/2", range(10)
STARTS, GA_SEEDS, CONVERGED = 200, 20, 1.01


def source_axis(seed: int) -> Frf:
    """Return the response of the source's model as its measurement would give it."""
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


def table() -> dict:
    """Return for each method the errors from the truth over the seeds."""
    use = in_band(F_HZ, BAND)
    truth = TRUTH.response(F_HZ[use])
    found = [fit_all(source_axis(seed), ORDER, reference=truth, band=BAND) for seed in SEEDS]
    rows = {}
    for method in METHODS:
        each = [f[method] for f in found]
        good = [row for row in each if row.model is not None]
        rows[method] = {
            "amplitude_db": rms([row.amplitude_db for row in good]),
            "phase_deg": rms([row.phase_deg for row in good]),
            "error_db": 20 * np.log10(rms([10 ** (row.error_db / 20) for row in good])),
            "cost": float(np.mean([row.cost for row in good])),
            "ms": 1e3 * float(np.median([row.seconds for row in each])),
            "stable_and_converged": sum(not row.note for row in each),
        }
    return rows | {"cost_expected": float(np.mean([f.cost_expected for f in found]))}


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


def convergence(method: str) -> dict:
    """Return how many random starts end at the best cost of the method."""
    frf, _ = measurement(0)
    rng = np.random.default_rng(1)
    costs = []
    best = minimised(fit(frf, "4/3", method="nls" if method == "ga" else method), frf, method)
    n = GA_SEEDS if method == "ga" else STARTS
    for seed in range(n):
        try:
            options = {"seed": seed} if method == "ga" else {"start": random_model(rng, 1.0)}
            costs.append(minimised(fit(frf, "4/3", method=method, **options), frf, method))
        except GsidError:
            costs.append(np.inf)
    return {"starts": n, "converged": int(np.sum(np.array(costs) <= CONVERGED * best))}


def minimised(model: RationalModel, frf: Frf, method: str) -> float:
    """Return the sum that a method minimises."""
    g = model.response(frf.f_hz)
    if method == "log":
        return float(np.sum(abs(np.log(g / frf.g)) ** 2))
    return model.cost if method in ("ml", "ml-io") else float(np.sum(abs(g - frf.g) ** 2))


def main() -> None:
    """Run the benchmark and print its figures."""
    starts = {method: convergence(method) for method in METHODS if method not in ("ls", "iwls")}
    print(json.dumps({"source_axis": table(), "random_starts": starts}, indent=2))


if __name__ == "__main__":
    main()
