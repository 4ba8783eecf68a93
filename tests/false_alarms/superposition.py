"""Level of the superposition test: a linear axis has one response at two input levels."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter
from scipy.stats import chi2
from study import Cell, Study

from gsid.records.record import Record
from gsid.response.distortion import Distortion
from gsid.response.estimate_distortion import StreamingDistortion, distortion
from gsid.response.superposition import superposition

FS_HZ, N = 1024.0, 2048
LEVELS = (1.0, 2.0)
NOISE = 0.05  # of one period's line, over the output's amplitude at the first level

POWER = ((2, 5e-5), (8, 2e-5))  # periods, and a cubic term that is found nearly always if the noise is known

# A resonance behind a lag, as a filter of the samples.
NUM, DEN = [0.02, 0.03], np.polymul([1.0, -0.9], [1.0, -1.6, 0.8])


def response(line: np.ndarray) -> np.ndarray:
    """Of the axis at these lines, (F,) complex."""
    z = np.exp(2j * np.pi * line / N)
    return np.polyval(NUM, z) * z ** (len(DEN) - len(NUM)) / np.polyval(DEN, z)


def run(cell: Cell, seed: int) -> float | dict[str, bool]:
    """P-value of the two levels of one experiment; of a cubic axis, whether it is found at 1 %."""
    given = {"periods": (8, 8), "realisations": (1, 1), "lines": 20, "noise": (1.0, 1.0)} | cell.setting
    measure = measured_in_records if given.get("records") else measured_at_lines
    rng = cell.rng(seed)
    both = superposition(*(measure(rng, given, i) for i in range(2)))
    if "cubic" not in given:
        return both.p_value
    variance = sum(
        noise_std(given, i) ** 2 / (d.u**2 * d.n_periods) for i, d in enumerate((both.first, both.second))
    )
    known = chi2.sf(2 * np.sum(np.abs(both.change) ** 2 / variance), 2 * len(both.line))
    return {"found_at_0.01": both.p_value <= 0.01, "found_if_the_noise_were_known": bool(known <= 0.01)}


def lines_of(given: dict) -> np.ndarray:
    return 2 * np.arange(1, given["lines"] + 1) - 1


def amplitudes(rng: np.random.Generator, given: dict, i: int) -> np.ndarray:
    """Input lines of one realisation at level i, (F,) complex."""
    line = lines_of(given)
    shape = (line / line[-1]) ** (given.get("tilt", 0.0) * i)
    return LEVELS[i] * shape * np.exp(2j * np.pi * rng.random(len(line)))


def noise_std(given: dict, i: int) -> np.ndarray:
    """Standard deviation of the output's noise of one period at level i, at each line."""
    line = lines_of(given)
    std = NOISE * np.full(len(line), np.sqrt(given["noise"][i]))
    if given.get("uneven") and i == 1:  # up at one half of the lines, down at the other
        std *= np.where(np.arange(len(line)) < len(line) / 2, 2.0, 0.5)
    return std


def measured_at_lines(rng: np.random.Generator, given: dict, i: int) -> Distortion:
    """The lines of each period go to the core, which measures as `gsid.distortion` does."""
    line, std = lines_of(given), noise_std(given, i)
    known = StreamingDistortion(FS_HZ, N, line, input_is_known=True)
    for _ in range(given["realisations"][i]):
        U = amplitudes(rng, given, i)
        known.start(U)
        noise = std * complex_normal(rng, (given["periods"][i], len(line)))
        known.add_periods(answer(line, U, given.get("cubic", 0.0)) + noise)
        known.finish()
    return known.result()


def answer(line: np.ndarray, U: np.ndarray, cubic: float) -> np.ndarray:
    """Output lines of the axis, followed by x + cubic x^3, (F,) complex."""
    spectrum = np.zeros(N // 2 + 1, complex)
    spectrum[line] = response(line) * U * N / 2
    x = np.fft.irfft(spectrum, N)
    return np.fft.rfft(x + cubic * x**3)[line] * 2 / N


def complex_normal(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def measured_in_records(rng: np.random.Generator, given: dict, i: int) -> Distortion:
    """Records with a period to settle and coloured noise, through the whole of `gsid.distortion`."""
    return distortion([record(rng, given, i) for _ in range(given["realisations"][i])])


def record(rng: np.random.Generator, given: dict, i: int) -> Record:
    spectrum = np.zeros(N // 2 + 1, complex)
    spectrum[lines_of(given)] = amplitudes(rng, given, i) * N / 2
    u = np.tile(np.fft.irfft(spectrum, N), given["periods"][i] + 1)
    white = rng.standard_normal(len(u))
    coloured = lfilter([1.0], [1.0, -0.5], white) + given.get("drift", 0.0) * np.cumsum(white)
    y = lfilter(NUM, DEN, np.r_[np.zeros(len(DEN) - len(NUM)), u])[: len(u)]
    y += NOISE * np.sqrt(given["noise"][i] * N) / 4 * coloured
    u = u + given.get("input_noise", 0.0) * rng.standard_normal(len(u))
    return Record(u, y, FS_HZ, N, N)


def _cells() -> tuple[Cell, ...]:
    both = [
        Cell(f"P {p}, M {m}, {n} lines", {"periods": (p, p), "realisations": (m, m), "lines": n})
        for n in (20, 500)
        for m in (1, 6)
        for p in (2, 4, 8, 40)
    ]
    other = {
        "P 2 and 40": {"periods": (2, 40)},
        "P 40 and 2": {"periods": (40, 2)},
        "M 1 and 6": {"realisations": (1, 6)},
        "P 40 and 2, noise variance 2 times": {"periods": (40, 2), "noise": (1.0, 2.0)},
        "P 2, noise variance 0.85 times, 500 lines": {
            "periods": (2, 2),
            "noise": (1.0, 0.85),
            "lines": 500,
        },
        "P 8, noise variance 0.25 times": {"noise": (1.0, 0.25)},
        "P 8, levels of different spectra": {"tilt": 0.5},
        "records, P 4": {"records": True, "periods": (4, 4)},
        "records, P 4, M 6": {"records": True, "periods": (4, 4), "realisations": (6, 6)},
        "records, P 8, input noise": {"records": True, "input_noise": 0.5},
    }
    bounds = {
        "P 2, noise up and down by 4": {"periods": (2, 2), "uneven": True},
        "P 8, noise up and down by 4": {"uneven": True},
        "P 8, noise up and down by 4, 500 lines": {"uneven": True, "lines": 500},
    }
    drift = {"records": True, "drift": 0.05}
    return (
        *both,
        *(Cell(name, setting) for name, setting in other.items()),
        *(Cell(name, setting, at_most=True) for name, setting in bounds.items()),
        Cell("records, P 4, M 6, drift", drift | {"periods": (4, 4), "realisations": (6, 6)}),
        Cell("records, P 8, M 1, drift", drift, judged=False),
        *(
            Cell(f"cubic axis, P {p}", {"periods": (p, p), "cubic": cubic}, judged=False)
            for p, cubic in POWER
        ),
    )


ABOUT = """A linear axis is measured at an input level and at twice that level, and `superposition` compares
the responses. P periods, M realisations. Unless a cell states otherwise: 8 periods, one realisation, 20
lines, the same white noise at both levels. The noise is drawn in the frequency domain and processed by the
core. The cells "records" are filtered by scipy, with coloured noise, and processed by the complete
`gsid.distortion`. "Noise up and down by 4": its variance at the second level is 4 times as large at one half
of the lines, and a quarter at the other half. "Drift": a random walk, larger than the other noise at the four
lowest lines. The jump from the first to the last sample of a record is one error in all lines, and the test
assumes independent lines: with one realisation it does not keep its level in this case. With several it does,
because each realisation rotates the phases of that error differently. "Cubic axis": a nonlinear axis. The
table shows how often the test detects it, and how often a test with a known variance of the noise would
detect it."""

STUDY = Study(
    name="superposition",
    title="Superposition: one response at two input levels",
    about=ABOUT,
    cells=_cells(),
    run=run,
    levels=(0.01, 0.05),
    n_seeds=1000,
    n_short=40,
)
