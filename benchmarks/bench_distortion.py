"""Time of the robust method beside numpy and best-linear-approximation; JSON on stdout.

    .venv/bin/python benchmarks/bench_distortion.py [--table]

Figures to reach (design, section 7), 6 realisations of 40 periods: at most 1.5 times the time of numpy, a
third of that of the package. numpy computes the thesis's eqs. 5.12 to 5.16 and nothing else: gsid checks its
input besides, finds the lines, and sums by Welford's update. That the package gives the same result is
tests/python/test_distortion_peer.py.
"""

import numpy as np
from beside import best_linear_approximation, best_seconds, show, versions

from gsid.excitation.multisine import Multisine
from gsid.records.record import Record
from gsid.response.estimate_distortion import distortion

FS_HZ, N, M, P, TURNS, SEED = 3000.0, 6000, 6, 40, 20, 1


def numpy_robust(u: np.ndarray, y: np.ndarray, line: np.ndarray) -> tuple[np.ndarray, ...]:
    """Best linear approximation, and its variances by noise and in all; u is (M, N), y (M, P, N)."""
    g = np.fft.rfft(y)[..., line] / np.fft.rfft(u)[:, None, line]
    each = g.mean(axis=1)
    noise = np.sum(np.abs(g - each[:, None]) ** 2, axis=(0, 1)) / (P * (P - 1) * M**2)
    bla = each.mean(axis=0)
    return bla, noise, np.sum(np.abs(each - bla) ** 2, axis=0) / (M * (M - 1))


def main() -> None:
    """Run the benchmark and print its figures."""
    rng = np.random.default_rng(SEED)
    designs = [Multisine.design(FS_HZ, N, (0.5, 250), phases="random", rms=10, seed=m) for m in range(M)]
    u, line = np.array([m.table() for m in designs]), designs[0].line.astype(int)
    y = (u + 1e-3 * u**3)[:, None] + 0.1 * rng.standard_normal((M, P, N))
    records = [Record(np.tile(u[m], P), y[m].ravel(), FS_HZ, N, 0) for m in range(M)]
    noisy = [Record(r.u + 0.01 * rng.standard_normal(len(r)), r.y, FS_HZ, N, 0) for r in records]
    jobs = {
        "gsid": lambda: distortion(records),
        "gsid, input measured": lambda: distortion(noisy),
        "numpy": lambda: numpy_robust(u, y, line),
    }
    found = versions("best-linear-approximation")
    if "best-linear-approximation" in found:
        robust = best_linear_approximation()
        samples, several = (
            np.moveaxis(y, 2, 0)[:, None],
            np.stack([r.u.reshape(P, N).T for r in noisy], 1)[:, None],
        )
        jobs["package"] = lambda: robust.known_input(u.T[:, None], samples, FS_HZ, line, show_warnings=False)
        jobs["package, input measured"] = lambda: robust.noisy_input(
            several, samples, FS_HZ, line, show_warnings=False
        )
    seconds = best_seconds(jobs, TURNS)
    size = {"realisations": M, "periods": P, "period": N, "lines": len(line), "seed": SEED}
    figures = {
        "measurement": size,
        "versions": found,
        "seconds": seconds,
        "ratio_to_numpy": seconds["gsid"] / seconds["numpy"],
    }
    if "package" in seconds:
        figures["times_faster_than_package"] = seconds["package"] / seconds["gsid"]
    rows = [("what", "time", "over gsid's")]
    for name, value in seconds.items():
        own = seconds["gsid, input measured" if name.endswith("measured") else "gsid"]
        rows.append((name, f"{1e3 * value:.1f} ms", f"{value / own:.2f}"))
    show(figures, rows)


if __name__ == "__main__":
    main()
