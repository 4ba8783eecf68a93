"""Low peaks of multisines beside Schroeder's phases, random phases and Guillaume's L2p; JSON on stdout.

    GSID_LCTOOLBOX=FOLDER .venv/bin/python benchmarks/bench_excitation.py [--table]

Figures to reach (design, section 7), 500 lines of 6000 samples, evaluated 8 times finer: crest factor at most
1.40 flat and 1.23 as 1/sqrt(f), in 0.25 s, 15 times faster than L2p in Octave; travel, peak to peak, at most
0.70 of Schroeder's at a crest factor of at most 1.43. FOLDER holds a copy of KU Leuven's LCToolbox (LGPL, not
part of gsid), whose msinl2pi.m is Guillaume's program of 1990: run as its head tells, p = 2, 4 .. 128 with
ten iterations each, on 4096 points, and its best answer counts. All times are processor times on one core.
"""

import os
import statistics
import sys
from pathlib import Path

import numpy as np
from beside import best_seconds, octave, show, versions

from gsid.excitation.limits import optimise, travel
from gsid.excitation.multisine import Multisine
from gsid.excitation.periodic import Limits
from gsid.models.rational import RationalModel

FS_HZ, N, BAND_HZ, TURNS, SEEDS = 3000.0, 6000, (0.5, 250.0), 5, range(1, 6)
SHAPES = {"flat": 0.0, "1/sqrt(f)": -10.0}
AXIS = RationalModel([60.2, 60.2 * 11], [1.0, 11.0, 170.0], y_unit="deg/s")
L2P = """
addpath('{folder}'); warning('off', 'all');
X = zeros(501, 1); X(2:501) = (1:500)'.^({power}); least = inf; start = cputime; p = 2;
while p < 200
    X = msinl2pi(p, X, 4096, [], 0, [], 10, 1e-6); p = 2*p;
    F = zeros(48000, 1); F(1:501) = X; x = real(ifft(F)); least = min(least, max(abs(x))/sqrt(mean(x.^2)));
end
printf('%.6f %.3f', least, cputime - start);
"""


def design(**how: object) -> Multisine:
    """500 lines of an rms of 1."""
    return Multisine.design(FS_HZ, N, BAND_HZ, rms=1.0, **how)


def search(name: str, shape: float) -> dict[str, dict[str, float]]:
    """Crest factors and times of what gsid has; of random phases the median over the seeds."""
    drawn = [design(phases="random", seed=seed, shape_db_per_decade=shape) for seed in SEEDS]
    found = [optimise(start) for start in drawn]
    jobs = {
        "gsid, Schroeder": lambda: design(shape_db_per_decade=shape),
        "gsid, random": lambda: design(phases="random", seed=1, shape_db_per_decade=shape),
        "gsid, optimised": lambda: optimise(drawn[0]),
    }
    crests = {
        "gsid, Schroeder": design(shape_db_per_decade=shape).crest_factor_fine,
        "gsid, random": statistics.median(m.crest_factor_fine for m in drawn),
        "gsid, optimised": max(m.crest_factor_fine for m in found),
    }
    seconds = best_seconds(jobs, TURNS)
    return {f"{who}, {name}": {"crest_factor": crests[who], "seconds": seconds[who]} for who in jobs}


def l2p(name: str, shape: float) -> dict[str, dict[str, float]]:
    """The same of Guillaume's program, where it is."""
    folder = os.environ.get("GSID_LCTOOLBOX", "")
    (program, *_) = [*Path(folder).rglob("msinl2pi.m"), None] if folder else [None]
    if program is None:
        print("without L2p: no msinl2pi.m in the folder GSID_LCTOOLBOX", file=sys.stderr)
        return {}
    answer = octave(L2P.format(folder=program.parent, power=shape / 20))
    if answer is None:
        print("without L2p: octave-cli is not installed", file=sys.stderr)
        return {}
    crest, seconds = map(float, answer.split())
    return {f"L2p in Octave, {name}": {"crest_factor": crest, "seconds": seconds}}


def multisine_package() -> dict[str, dict[str, float]]:
    """Random phases of the package multisine, the median over the seeds."""
    from multisine import random_phase_multisine

    def draw(seed: int) -> np.ndarray:
        return np.ravel(random_phase_multisine(N, FS_HZ, f_max=BAND_HZ[1], seed=seed).u)

    def crest(x: np.ndarray) -> float:
        fine = np.fft.irfft(np.fft.rfft(x), 8 * N)
        return float(np.max(np.abs(fine)) / np.sqrt(np.mean(fine**2)))

    seconds = best_seconds({"draw": lambda: draw(1)}, TURNS)["draw"]
    median = statistics.median(crest(draw(seed)) for seed in SEEDS)
    return {"multisine, random, flat": {"crest_factor": median, "seconds": seconds}}


def together() -> dict[str, dict[str, float]]:
    """Command and travel made small together, beside Schroeder's travel; the worst of the seeds."""
    before = travel(design(), AXIS)
    limits = Limits(command=1.42, travel=0.68 * before)
    found = [optimise(design(phases="random", seed=seed), limits, AXIS) for seed in SEEDS]
    start = design(phases="random", seed=1)
    answer = {
        "crest_factor": max(m.crest_factor_fine for m in found),
        "seconds": best_seconds({"both": lambda: optimise(start, limits, AXIS)}, TURNS)["both"],
        "travel_to_schroeder": max(travel(m, AXIS) for m in found) / before,
    }
    return {"gsid, command and travel, flat": answer}


def main() -> None:
    """Run the benchmark and print its figures."""
    found = versions("multisine")
    version = octave("printf('%s', version)")
    found |= {"octave": version} if version else {}
    results: dict[str, dict[str, float]] = {}
    for name, shape in SHAPES.items():
        results |= search(name, shape) | l2p(name, shape)
    if "multisine" in found:
        results |= multisine_package()
    results |= together()
    faster = {
        name: results[f"L2p in Octave, {name}"]["seconds"] / results[f"gsid, optimised, {name}"]["seconds"]
        for name in SHAPES
        if f"L2p in Octave, {name}" in results
    }
    rows = [("phases", "crest factor", "travel over Schroeder's", "time")]
    for name, result in results.items():
        moved = f"{result['travel_to_schroeder']:.3f}" if "travel_to_schroeder" in result else ""
        rows.append((name, f"{result['crest_factor']:.3f}", moved, f"{1e3 * result['seconds']:.1f} ms"))
    size = {"lines": len(design().line), "period": N, "seeds": list(SEEDS)}
    figures = {"excitation": size, "versions": found, "results": results, "times_faster_than_l2p": faster}
    show(figures, rows)


if __name__ == "__main__":
    main()
