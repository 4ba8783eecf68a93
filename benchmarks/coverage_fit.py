"""How often 95 % intervals hold the truth: parameters, poles, zeros and delay; JSON on stdout.

    make coverage        (or .venv/bin/python benchmarks/coverage_fit.py [REPEATS])

Each case is fitted to REPEATS (1000) responses with new noise and sample variances, from seeds 0, 1, ... on.
With 1000 repeats a coverage of 95 % comes out within 1.4 % of it 95 times in 100; the figure to reach is
93 to 97 %. The bootstrapped check draws 200 responses around one fitted model, fits each, and compares
their scatter with the covariance.
"""

import json
import sys

import numpy as np

from gsid.fitting.estimators import bootstrap
from gsid.fitting.rational import fit
from gsid.models.rational import RationalModel
from gsid.response.frf import Frf

SMALL = RationalModel([40.0, 900.0], [1.0, 30.0, 2000.0], 0.0042)
WA, WR = 2 * np.pi * 165, 2 * np.pi * 179
AXIS = RationalModel(
    40 * (WR / WA) ** 2 * np.polymul([1, 11], [1, 0.03 * WA, WA**2]),
    np.polymul([1, 11, 170], [1, 0.03 * WR, WR**2]),
    0.0054,
)
# truth, order, lines [Hz], periods, noise over the largest gain, of one period, method
CASES = {
    "2/1, 20 periods, ml": (SMALL, "2/1", np.arange(1, 241) * 0.5, 20, 0.01, "ml"),
    "2/1, 6 periods, ml": (SMALL, "2/1", np.arange(1, 241) * 0.5, 6, 0.01, "ml"),
    "2/1, 20 periods, log": (SMALL, "2/1", np.arange(1, 241) * 0.5, 20, 0.01, "log"),
    "2/1, 20 periods, nls": (SMALL, "2/1", np.arange(1, 241) * 0.5, 20, 0.01, "nls"),
    "4/3, the axis, 75 periods, ml": (AXIS, "4/3", np.arange(1, 251) * 1.0, 75, 0.01, "ml"),
}


def measured(truth: RationalModel, f: np.ndarray, periods: int, noise: float, seed: int) -> Frf:
    """Return mean and sample variance of so many periods with white noise."""
    rng = np.random.default_rng(seed)
    g = truth.response(f)
    sigma = noise * np.max(np.abs(g))
    mean = g + sigma * _normal(rng, len(f)) / np.sqrt(periods)
    var = sigma**2 * rng.gamma(periods - 1, 1 / (periods - 1), len(f))
    nothing = np.zeros(len(f))
    return Frf(
        line=np.arange(1, len(f) + 1),
        f_hz=f,
        g=mean,
        var_g=var / periods,
        u=nothing + 1 + 0j,
        y=mean,
        var_u=nothing,
        var_y=var,
        cov_yu=nothing + 0j,
        n_periods=periods,
        n_realisations=1,
        n_spoiled=0,
        settle_samples=0,
        period_samples=6000,
        fs_hz=3000.0,
    )


def _normal(rng: np.random.Generator, n: int) -> np.ndarray:
    return (rng.standard_normal(n) + 1j * rng.standard_normal(n)) / np.sqrt(2)


def quantities(model: RationalModel, near: RationalModel | None = None) -> dict[str, tuple[float, float]]:
    """Return value and standard deviation of everything; roots in the order of those of `near`."""
    out = {f"den[{i}]": (model.den[i], model.std_den[i]) for i in range(1, len(model.den))}
    out |= {f"num[{i}]": (model.num[i], model.std_num[i]) for i in range(len(model.num))}
    out["delay"] = (model.delay_s, model.std_delay_s)
    for kind in ("pole", "zero"):
        roots, cov = getattr(model, f"{kind}s"), getattr(model, f"{kind}_cov")
        wanted = getattr(near or model, f"{kind}s")
        for i, root in enumerate(wanted[wanted.imag >= 0]):
            k = int(np.argmin(abs(roots - root)))
            out[f"{kind} {i} re"] = (roots[k].real, np.sqrt(cov[k, 0, 0]))
            if root.imag:
                out[f"{kind} {i} im"] = (roots[k].imag, np.sqrt(cov[k, 1, 1]))
    return out


def cover(case: tuple, repeats: int) -> dict:
    """Return the share of intervals that hold the truth, for each quantity."""
    truth, order, f, periods, noise, method = case
    exact = {name: value for name, (value, _) in quantities(truth).items()}
    inside = dict.fromkeys(exact, 0)
    for seed in range(repeats):
        found = quantities(fit(measured(truth, f, periods, noise, seed), order, method=method), truth)
        for name, (value, std) in found.items():
            inside[name] += abs(value - exact[name]) < 1.959964 * std
    shares = {name: round(100 * n / repeats, 1) for name, n in inside.items()}
    return {"lowest": min(shares.values()), "highest": max(shares.values()), "percent": shares}


def main() -> int:
    """Run the study; 1 when a share is outside 93 to 97 %."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    cases = {name: cover(case, repeats) for name, case in CASES.items()}
    truth, order, f, periods, noise, _ = CASES["2/1, 20 periods, ml"]
    response = measured(truth, f, periods, noise, 0)
    ratio = bootstrap(fit(response, order), response, n=200) / np.sqrt(np.diag(fit(response, order).cov))
    result = {
        "repeats": repeats,
        "cases": cases,
        "bootstrapped_over_covariance": [round(float(r), 3) for r in ratio],
    }
    print(json.dumps(result, indent=2))
    return int(any(case["lowest"] < 93 or case["highest"] > 97 for case in cases.values()))


if __name__ == "__main__":
    sys.exit(main())
