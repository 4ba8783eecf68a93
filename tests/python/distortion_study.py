"""How well the 95 % intervals of gsid.distortion cover the truth: `make distortion-study`.

For a few numbers of lines, realisations and periods, the share of 400 repeats in which the interval covers
what is known of the simulated axis; mean, least and largest over the lines.
"""

from nonlinear_axis import NonlinearAxis, coverage

SEED, REPEATS = 41, 400
# lines = 32 scale; cubic sets the distortion, noise the noise
CASES = (
    {"scale": 1, "cubic": 0.05, "noise": 0.03, "m": 4, "p": 3},
    {"scale": 4, "cubic": 0.05, "noise": 0.03, "m": 4, "p": 3},
    {"scale": 4, "cubic": 0.03, "noise": 0.2, "m": 4, "p": 3},
    {"scale": 4, "cubic": 0.03, "noise": 0.2, "m": 2, "p": 8},
    {"scale": 4, "cubic": 0.03, "noise": 0.2, "m": 6, "p": 2},
)


def main() -> None:
    """Print the table."""
    print(f"seed {SEED}, {REPEATS} repeats; coverage mean (least .. largest over lines)")
    for case in CASES:
        axis = NonlinearAxis(cubic=case["cubic"], noise=case["noise"], scale=case["scale"])
        covered, _, truth = coverage(axis, case["m"], case["p"], REPEATS, SEED)
        ratio = (truth["std_nonlinear"] / axis.noise_std(case["p"])).mean()
        words = ", ".join(
            f"{name} {c.mean() / REPEATS:.3f} ({c.min() / REPEATS:.3f} .. {c.max() / REPEATS:.3f})"
            for name, c in covered.items()
        )
        print(
            f"{len(axis.line)} lines, M {case['m']}, P {case['p']}, distortion {ratio:.2f} of noise: {words}"
        )


if __name__ == "__main__":
    main()
