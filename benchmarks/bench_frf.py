"""Time of a frequency response with its variance, beside scipy.fft on the same samples; JSON on stdout.

    .venv/bin/python benchmarks/bench_frf.py

Figure to reach (design, section 7): FRF and variance of a record of 450 000 samples in at most twice the time
of scipy.fft on it. Both run in one process, turn by turn, and the best of several turns counts.
"""

import json
import platform
import time

import numpy as np
import scipy
import scipy.fft

from gsid._lib import ffi, ffi32, lib, lib32, version
from gsid.excitation import Multisine
from gsid.frf import frf
from gsid.record import Record
from gsid.streaming import StreamingFrf

FS_HZ, N, PERIODS, TURNS, SEED = 3000.0, 6000, 75, 15, 1


def make_record() -> tuple[Record, Multisine]:
    """Return 450 000 samples of a first-order axis in steady state with noise on its output."""
    m = Multisine.design(FS_HZ, N, (0.5, 250), amplitude=3)
    lines = np.zeros(N // 2 + 1, complex)
    lines[m.line] = m.spectrum() * 7.4 / (2j * np.pi * m.f_hz + 1.5) * (N / 2)
    y = np.tile(np.fft.irfft(lines, N), PERIODS)
    y += 0.01 * np.random.default_rng(SEED).standard_normal(len(y))
    return Record(np.tile(m.table(), PERIODS), y, FS_HZ, N, 0), m


def best_times(jobs: dict) -> dict[str, float]:
    """Best time of each job [s], the jobs taking turns."""
    best = dict.fromkeys(jobs, float("inf"))
    for _ in range(TURNS):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            best[name] = min(best[name], time.perf_counter() - start)
    return best


def streaming_per_sample(record: Record, m: Multisine, precision: str, known: bool) -> float:
    """Time of the core for one sample [s]; the update at the end of a period is spread over the period."""
    streaming = StreamingFrf(FS_HZ, N, m.line, u_known=m.spectrum() if known else None, precision=precision)
    u, y = record.u[: 2 * N], record.y[: 2 * N]
    start = time.perf_counter()
    streaming.step(u, y)
    with_call = (time.perf_counter() - start) / len(u)
    if precision == "double":
        return with_call
    # the float core is called once per sample from Python: take what a call that does nothing costs off again
    start = time.perf_counter()
    for a, b in zip(u.tolist(), y.tolist(), strict=True):
        lib32.gsid_frf_step(ffi32.NULL, a, b)
    return with_call - (time.perf_counter() - start) / len(u)


def main() -> None:
    """Run the benchmark and print its figures."""
    record, m = make_record()
    rows_u, rows_y = record.u.reshape(PERIODS, N), record.y.reshape(PERIODS, N)
    times = best_times(
        {
            "frf_and_variance": lambda: frf(record),
            "scipy_rfft_of_u_and_y": lambda: (scipy.fft.rfft(rows_u), scipy.fft.rfft(rows_y)),
            "scipy_fft_of_u_and_y": lambda: (scipy.fft.fft(rows_u), scipy.fft.fft(rows_y)),
        }
    )
    per_sample = {
        f"{precision}_{'known' if known else 'measured'}": min(
            streaming_per_sample(record, m, precision, known) for _ in range(5)
        )
        for precision in ("double", "single")
        for known in (True, False)
    }
    figures = {
        "record": {
            "samples": len(record),
            "period": N,
            "periods": PERIODS,
            "lines": len(m.line),
            "seed": SEED,
        },
        "versions": {
            "gsid": version(),
            "fftw": ffi.string(lib.gsid_build_library_version(b"fftw")).decode(),
            "scipy": scipy.__version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
            "machine": platform.machine(),
        },
        "seconds": times,
        "ratio_to_scipy_fft": times["frf_and_variance"] / times["scipy_fft_of_u_and_y"],
        "ratio_to_scipy_rfft": times["frf_and_variance"] / times["scipy_rfft_of_u_and_y"],
        "streaming_microseconds_per_sample": {name: 1e6 * value for name, value in per_sample.items()},
    }
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
