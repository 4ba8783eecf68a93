"""Section 3.4, low and high band measured apart, and section 8.1, the redesign of the excitation."""

from __future__ import annotations

import numpy as np
from chapter3 import MODEL
from thesis_study import LINES, PERIOD, Row, Study, rows_of

from gsid import frf, read_record

TITLE = "Sections 3.4 and 8.1: two bands, and the next excitation"
PICTURES = {
    "methods": "Section 3.4: stepped sine and broadband in the same time, 0.5 to 4 Hz, within ±2 degrees.",
    "joined": "Section 3.4: stepped sine of 0.5 to 4 Hz, joined to a multisine of 2 to 195 Hz.",
    "next": "Section 8.1: the next excitation, from the measured noise and distortion.",
}
STEPPED = f"design stepped-sine {LINES} --band 0.5:4 --lines full --settle 1500 --periods 2 --amplitude 6"
HIGH = f"design multisine {LINES} --band 2:195 --phases random --amplitude 3"
FIRST = f"design multisine {LINES} --band 5:150 --shape -10 --phases random --amplitude 10"
METHODS = (
    f"design compare-methods {LINES} --band 0.5:4 --lines full --duration 120 --noise-rms 0.02"
    " --limit-command 179 --limit-travel-deg 2 --model model_7_30.json --simulations 0"
)
#: Wanted standard deviation over gain.
SIGMA = 0.01
MOST_REALISATIONS = 6


def rows(study: Study) -> list[Row]:
    """Figures of sections 3.4 and 8.1."""
    return [*_methods(study), *_bands(study), *_redesign(study)]


def measure_high(study: Study, test: int) -> str:
    """Measure one realisation of the high band, and return the command."""
    return study.record(f"high{test}", f"{HIGH} --seed {test}", 20, wait=2 * PERIOD, seed=30 + test)


def _methods(study: Study) -> list[Row]:
    MODEL.save(study.folder / "model_7_30.json")
    found = {one["name"]: max(one["sigma"]) for one in study.gsid(METHODS, "methods")["methods"]}
    ratio = float(20 * np.log10(found["stepped-sine"] / found["multisine"]))
    travel = (
        "Each line of the stepped sine may use the whole travel, but for an eighth of the time less its wait."
    )
    return rows_of(
        *("3.4", METHODS),
        ("0.5 to 4 Hz within ±2 degrees: stepped sine over multisine, worst line [dB]", "< 0", ratio, travel),
    )


def _bands(study: Study) -> list[Row]:
    stepped = study.record("stepped", STEPPED, 1, wait=0, seed=30)
    measure_high(study, 1)
    command = "join stepped.csv high1.csv"
    joined = study.gsid(command, "joined")
    f_hz = joined["f_hz"]
    above = "The excitation ends below half of the refresh rate of the gyro."
    test = "By the test of JOI-2. The bands differ in level, and friction makes the response depend on it."
    agree = "yes" if joined["agree"] else "no"
    return [
        *rows_of("3.4", stepped, ("joined response from [Hz]", "0.5", float(f_hz[0]))),
        *rows_of(
            *("3.4", command),
            ("joined response to [Hz]", "500", float(f_hz[-1]), above),
            ("lines of 2 to 4 Hz agree within the noise", "not tested", agree, test),
        ),
    ]


def _redesign(study: Study) -> list[Row]:
    for test in (1, 2):
        study.record(f"first{test}", f"{FIRST} --seed {test}", 8, wait=2 * PERIOD, seed=40 + test)
    command = f"next first1.csv first2.csv --sigma {SIGMA} --limit-command 179"
    found = study.gsid(f"{command} -o next_u.csv", "next")
    before = frf([read_record(study.folder / f"first{test}.csv") for test in (1, 2)])
    records = []
    for test in range(1, min(found["n_realisations"], MOST_REALISATIONS) + 1):
        design = f"{command} --realisation {test}"
        run = study.record(f"next{test}", design, found["n_periods"], wait=2 * PERIOD, seed=50 + test)
        records.append(read_record(study.folder / f"next{test}.csv"))
    after = frf(records)
    first, last = (np.sqrt(one.var_g) / np.abs(one.g) for one in (before, after))
    low = after.f_hz < 60
    wanted = "not printed"
    images = (
        "The held gyro has images around 2800 Hz, seven times its rate, which fold to 200 Hz less the line."
        " They grow with the level."
    )
    return [
        *rows_of(
            *("8.1", command),
            ("first excitation: σ over gain, worst line", wanted, float(first.max())),
            ("expected of the next one", wanted, found["expected_std"], f"Wanted: {SIGMA}."),
            ("its time [s]", wanted, found["time_s"]),
        ),
        *rows_of(
            *("8.1", run),
            ("measured with it, 5 to 60 Hz, median", wanted, float(np.median(last[low]))),
            ("measured with it, 60 to 150 Hz, median", wanted, float(np.median(last[~low])), images),
        ),
    ]
