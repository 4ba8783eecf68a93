"""How well the 95 % intervals of gsid.distortion cover the truth: `make distortion-study`.

For several numbers of lines, realisations and periods: the share of 400 repeats in which the interval covers
what is known of the simulated axis, mean, least and largest over the lines; the share of lines within the
binomial range of 95 % (95 to 96 % of them where the intervals are exact); the mean of the estimated variance
of distortion over the true one; and the excess kurtosis of distortion, 0 for a normal variable.
"""

import numpy as np
from nonlinear_axis import NonlinearAxis, coverage
from scipy.stats import binom

SEED, REPEATS = 41, 400
# lines = 32 scale; cubic sets the distortion, noise the noise
STRONG, WEAK = {"cubic": 0.05, "noise": 0.03}, {"cubic": 0.03, "noise": 0.2}
CASES = (
    {"scale": 16, **STRONG, "m": 4, "p": 3},
    {"scale": 16, **STRONG, "m": 10, "p": 3},
    {"scale": 4, **WEAK, "m": 4, "p": 3},
    {"scale": 4, **WEAK, "m": 2, "p": 8},
    {"scale": 4, **WEAK, "m": 6, "p": 2},
    {"scale": 4, **STRONG, "m": 4, "p": 3},
    {"scale": 1, **STRONG, "m": 4, "p": 3},
    {"scale": 1, **STRONG, "m": 10, "p": 3},
)


def excess_kurtosis(axis: NonlinearAxis, m: int = 3000, seed: int = 5) -> float:
    """E|d|^4 / (E|d|^2)^2 - 2 of the distortion d of one realisation's response, mean over the lines."""
    u = axis.inputs(np.random.default_rng(seed), m)
    g = np.fft.rfft(axis.output(u))[:, axis.line] / np.fft.rfft(u)[:, axis.line]
    power = np.abs(g - g.mean(axis=0)) ** 2
    return float(np.mean(np.mean(power**2, axis=0) / np.mean(power, axis=0) ** 2) - 2)


def main() -> None:
    """Print the table."""
    low, high = binom.ppf([0.025, 0.975], REPEATS, 0.95)
    print(f"seed {SEED}, {REPEATS} repeats, binomial range {low / REPEATS:.4f} .. {high / REPEATS:.4f}\n")
    head = "lines, M, P, distortion / noise, sigma_n covered, within, sigma_S covered, within"
    columns = [*head.split(", "), "variance / truth", "kurtosis"]
    print("| " + " | ".join(columns) + " |\n" + "| --- " * len(columns) + "|")
    for case in CASES:
        axis = NonlinearAxis(cubic=case["cubic"], noise=case["noise"], scale=case["scale"])
        covered, variance, truth = coverage(axis, case["m"], case["p"], REPEATS, SEED)
        ratio = (truth["std_nonlinear"] / axis.noise_std(case["p"])).mean()
        words = " | ".join(
            f"{c.mean() / REPEATS:.3f} ({c.min() / REPEATS:.3f} .. {c.max() / REPEATS:.3f}) | "
            f"{np.mean((c >= low) & (c <= high)):.0%}"
            for c in covered.values()
        )
        unbiased = variance.sum() / np.sum(truth["std_nonlinear"] ** 2)
        print(
            f"| {len(axis.line)} | {case['m']} | {case['p']} | {ratio:.2f} | {words} | {unbiased:.3f} "
            f"| {excess_kurtosis(axis):.2f} |"
        )


if __name__ == "__main__":
    main()
