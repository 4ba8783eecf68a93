"""Time of a frequency response with its variance, beside scipy and pyFRF on the same samples; JSON on stdout.

    .venv/bin/python benchmarks/bench_frf.py [--table]

Figures to reach (design, section 7), a record of 450 000 samples: at most twice the time of scipy.fft on it,
and four times faster than pyFRF and scipy.signal.csd, which give no variance. `scipy.fft` transforms what has
to be transformed and no more: the output's periods, and one of an input that repeats. Without a window csd
and pyFRF give the same response; as they come they do not (Hann's window of csd; pyFRF divides by j w unless
stated otherwise). All run in one process, turn by turn, and the least of several times counts.
The time of one sample in the streaming core is that of a C loop (frf_tick.c), in double and in float.
"""

import json
import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import scipy.fft
import scipy.signal
from beside import best_seconds, show, versions

from gsid.excitation.multisine import Multisine
from gsid.records.record import Record
from gsid.response.estimate import frf

ROOT = Path(__file__).resolve().parent.parent
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


def ticks(precision: str) -> dict[str, float]:
    """Time of one sample in the core [ns], in a C program that does nothing else (frf_tick.c)."""
    single = ["-DGSID_SINGLE"] if precision == "float" else []
    core = ROOT / f"build/{precision}/libgsid_core.a"
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "frf_tick"
        flags = ["-std=c99", "-O2", "-ffp-contract=off", f"-I{ROOT / 'include'}", *single]
        source = ROOT / "benchmarks/frf_tick.c"
        subprocess.run([os.environ.get("CC", "cc"), *flags, "-o", program, source, core, "-lm"], check=True)
        done = subprocess.run([program], check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


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
        "streaming_nanoseconds_per_sample": {
            precision: ticks(precision) for precision in ("double", "float")
        },
    }
    rows = [("what", "time", "over gsid's", "variance", "largest difference from gsid's response")]
    for name, value in seconds.items():
        difference = f"{apart[name]:.1g}" if name in apart else "-"
        ratio = f"{value / seconds['gsid']:.2f}"
        rows.append((name, f"{1e3 * value:.1f} ms", ratio, "yes" if name == "gsid" else "no", difference))
    show(figures, rows)


if __name__ == "__main__":
    main()
