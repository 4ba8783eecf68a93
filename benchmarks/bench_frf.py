"""Time of a frequency response with its variance, beside scipy and pyFRF on the same samples; JSON on stdout.

    .venv/bin/python benchmarks/bench_frf.py [--table]

Figures to reach (design, section 7), a record of 450 000 samples: at most twice the time of scipy.fft on it,
and four times faster than pyFRF and scipy.signal.csd, which give no variance. `scipy.fft` transforms what has
to be transformed and no more: the output's periods, and one of an input that repeats. Without a window csd
and pyFRF give the same response; as they come they do not (Hann's window of csd; pyFRF divides by j w unless
told otherwise). All run in one process, turn by turn, and the least of several times counts.
"""

import time

import numpy as np
import scipy.fft
import scipy.signal
from beside import best_seconds, show, versions

from gsid._lib import ffi32, lib32
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


def scipy_csd(record: Record, **how: object) -> np.ndarray:
    """H1 by scipy.signal, in segments of a period."""
    _, yu = scipy.signal.csd(record.u, record.y, FS_HZ, nperseg=N, **how)
    _, uu = scipy.signal.welch(record.u, FS_HZ, nperseg=N, **how)
    with np.errstate(invalid="ignore", divide="ignore"):
        return yu / uu


def pyfrf(rows_u: np.ndarray, rows_y: np.ndarray) -> np.ndarray:
    """The same by pyFRF."""
    from pyFRF import FRF

    peer = FRF(int(FS_HZ), exc=rows_u, resp=rows_y, exc_type="f", resp_type="v", window="none")
    return np.squeeze(peer.get_FRF(frf_form="mobility"))


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
    no_window = {"window": "boxcar", "noverlap": 0, "detrend": False}
    found = versions("pyFRF")
    responses = {
        "scipy.signal.csd, no window": lambda: scipy_csd(record, **no_window),
        "scipy.signal.csd as it comes": lambda: scipy_csd(record),
    }
    if "pyFRF" in found:
        responses["pyFRF"] = lambda: pyfrf(rows_u, rows_y)
    transforms = {
        "scipy.fft": lambda: (scipy.fft.rfft(rows_u[:1]), scipy.fft.rfft(rows_y)),
        "scipy.fft of u and y": lambda: (scipy.fft.rfft(rows_u), scipy.fft.rfft(rows_y)),
    }
    seconds = best_seconds({"gsid": lambda: frf(record)} | transforms | responses, TURNS)
    ours = frf(record)
    apart = {name: float(np.max(np.abs(job()[ours.line] / ours.g - 1))) for name, job in responses.items()}
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
        "versions": found,
        "seconds": seconds,
        "ratio_to_scipy_fft": seconds["gsid"] / seconds["scipy.fft"],
        "times_faster_than": {name: seconds[name] / seconds["gsid"] for name in responses},
        "largest_difference_of_g": apart,
        "streaming_microseconds_per_sample": {name: 1e6 * value for name, value in per_sample.items()},
    }
    rows = [("what", "time", "to gsid's", "variance", "largest difference from gsid's response")]
    for name, value in seconds.items():
        difference = f"{apart[name]:.1g}" if name in apart else "-"
        ratio = f"{value / seconds['gsid']:.2f}"
        rows.append((name, f"{1e3 * value:.1f} ms", ratio, "yes" if name == "gsid" else "no", difference))
    show(figures, rows)


if __name__ == "__main__":
    main()
