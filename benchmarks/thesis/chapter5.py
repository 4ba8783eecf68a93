"""Chapter 5: nonlinear distortion."""

from __future__ import annotations

import numpy as np
from thesis_study import HIGHEST_HZ, LINES, Row, Study, rows_of

TITLE = "Chapter 5: nonlinear distortion"
PICTURES = {
    "sine": "Fig. 5.1: one sine, and its harmonics in the output.",
    "random1_time": "Figs. 5.2, 5.3 and 5.4: random phases, test 1 of 6: input, output, position and lines.",
    "random2_time": "Figs. 5.5 and 5.6: test 2 of 6.",
    "robust": "Fig. 5.11: response, noise and distortion by the robust method.",
    "levels": "Section 5.2, superposition: the response at half and at double the level.",
}
BAND = f"--band 1.5:{HIGHEST_HZ}"
SINE = "design multisine --fs 3000 --period 2000 --band 1.4:1.6 --amplitude 6.5"
WAIT = 6 * 3000
#: Amplitude of the first line that gives the rms of section 3.8.
AMPLITUDE = 9.24
REALISATIONS = 6
QUICK_REALISATIONS = 2
AXIS_DIFFERS = "Another axis: friction makes the odd harmonics, the torque over the angle the even ones."


def rows(study: Study) -> list[Row]:
    """Figures of chapter 5."""
    return [*_one_sine(study), *_random_phases(study), *_levels(study)]


def random_phases(seed: int, amplitude: float = AMPLITUDE) -> str:
    """Command that designs a multisine of section 5.3."""
    shape = "--band 1.5:250 --shape -10 --phases random"
    return f"design multisine {LINES} {shape} --seed {seed} --amplitude {amplitude:g}"


def measure(study: Study, test: int, amplitude: float = AMPLITUDE, name: str = "random") -> str:
    """Measure one realisation, and return the command."""
    return study.record(f"{name}{test}", random_phases(test, amplitude), 40, wait=WAIT, seed=20 + test)


def _one_sine(study: Study) -> list[Row]:
    study.record("sine", SINE, 120, wait=WAIT, seed=20)
    command = "distortion sine.csv"
    found = study.gsid(command, "sine")
    size = found["u"][0] * np.hypot(found["bla_re"][0], found["bla_im"][0])
    harmonics = {one["order"]: one for one in found["harmonics"]}
    level = {order: float(20 * np.log10(one["level"])) for order, one in harmonics.items()}
    differs = "Another axis: friction makes the odd harmonics, the torque over the angle the even ones."
    digits = "17.84 + 5.24 = 23.08: the thesis's text has 22."
    return rows_of(
        *("5.2, Fig. 5.1", command),
        ("input at 1.5 Hz [dB]", "16.26", float(20 * np.log10(found["u"][0]))),
        ("output at 1.5 Hz [dB]", "17.84", float(20 * np.log10(size)), "Another axis."),
        ("output at 3 Hz [dB]", "-5.24", level[2], differs),
        ("output at 4.5 Hz [dB]", "-9.173", level[3], differs),
        ("output at 6 Hz [dB]", "-24.63", level[4], differs),
        ("2nd harmonic below the fundamental [dB]", "22", harmonics[2]["below_fundamental_db"], digits),
        ("3rd harmonic above the noise [dB]", "not printed", harmonics[3]["above_noise_db"]),
    )


def _random_phases(study: Study) -> list[Row]:
    tests = range(1, 1 + (QUICK_REALISATIONS if study.quick else REALISATIONS))
    runs = [measure(study, test) for test in tests]
    crest = [study.gsid(random_phases(test))["crest_factor"] for test in tests]
    position = [
        study.gsid(f"look random{test}.csv --limit-travel-deg 2", f"random{test}_time")["records"][0][
            "position"
        ]
        for test in (1, 2)
    ]
    design, travel = random_phases(1), "look random1.csv --limit-travel-deg 2"
    sides = " and ".join(f"{max(map(abs, one)):.3g}" for one in position)
    return [
        Row("5.3, Fig. 5.2", "excited lines", "498", study.gsid(design)["n_lines"], design),
        Row(
            "5.3",
            "crest factors of the six signals",
            "2.9 to 3.8",
            f"{min(crest):.3g} to {max(crest):.3g}",
            design,
        ),
        Row("Figs. 5.4, 5.6", "position, largest to one side [deg]", "< 2", sides, travel),
        Row("5.3", "samples of one test without transients", "240000", _samples(study), runs[0]),
        *_robust(study, tests),
    ]


def _samples(study: Study) -> int:
    found = study.gsid("look random1.csv")["records"][0]
    return found["periods"] * found["period_samples"]


def _robust(study: Study, tests: range) -> list[Row]:
    command = "distortion " + " ".join(f"random{test}.csv" for test in tests) + f" {BAND}"
    found = study.gsid(command, "robust")
    f_hz, noise, total = (np.array(found[key]) for key in ("f_hz", "var_noise", "var_total"))
    gain = np.hypot(found["bla_re"], found["bla_im"])

    def over_noise(lo: float, hi: float) -> float:
        use = (f_hz >= lo) & (f_hz <= hi)
        return float(10 * np.log10(np.median(total[use] / noise[use])))

    def peak(variance: np.ndarray, lo: float, hi: float) -> float:
        use = (f_hz >= lo) & (f_hz <= hi)
        return float(f_hz[use][np.argmax(variance[use])])

    snr = float(20 * np.log10(np.median(gain / np.sqrt(noise * found["n_periods"]))))
    below = float(100 * np.mean(total[f_hz > 150] < noise[f_hz > 150]))
    mean = "One period, up to 200 Hz; the mean of 40 periods has 16 dB more."
    hidden = "The noise of the images, 150 to 200 Hz, hides the distortion of the resonance."
    images = (
        "Images of the lines above 200 Hz drift through each period: they count as noise of a realisation."
        " The thesis quotes nonstationary distortion."
    )
    return [
        *rows_of("5.3", command, ("signal over noise, median [dB]", "> 40", snr, mean)),
        *rows_of(
            *("5.6, Fig. 5.11", command),
            ("total over noise, 1.5 to 5 Hz [dB]", "distortion dominates", over_noise(1.5, 5)),
            ("total over noise, 20 to 50 Hz [dB]", "falls rapidly", over_noise(20, 50)),
            ("total over noise, 100 to 150 Hz [dB]", "below the noise from 200 Hz on", over_noise(100, 150)),
            ("largest total, 165 to 195 Hz, at [Hz]", "179", peak(total, 165, 195), hidden),
            ("peak of the noise near the fan [Hz]", "30", peak(noise, 25, 37)),
            ("lines from 150 Hz on with total below noise [%]", "217 to 236 Hz", below, images),
        ),
        *rows_of(
            "5.2, eq. 5.3", command, ("smallest coherence", "not printed", float(min(found["coherence"])))
        ),
    ]


def _levels(study: Study) -> list[Row]:
    if study.quick:
        return []
    for test in (1, 2):
        measure(study, test, AMPLITUDE / 2, "half")
    study.gsid(f"plot half1.csv random1.csv --legend level {BAND}", "levels")
    command = f"distortion random1.csv random2.csv {BAND} --other-level half1.csv --other-level half2.csv"
    found = study.gsid(command)["superposition"]
    lowest = np.array(found["change_db"])[np.array(found["f_hz"]) <= 5]
    change = float(np.sqrt(np.mean(lowest**2)))
    friction = "Friction acts more at a small level; two realisations do not show it with certainty."
    return rows_of(
        *("5.2, eq. 5.2", command),
        ("change of the response at half the level, 1.5 to 5 Hz, rms [dB]", "not printed", change, friction),
        ("p-value of an equal response at both levels", "not printed", float(found["p_value"])),
    )
