"""Chapter 3: design of excitation signals."""

from __future__ import annotations

import numpy as np
from thesis_study import FS_HZ, LINES, PERIOD, Row, Study

from gsid import Multisine, RationalModel, read_record
from gsid.excitation.generators import Prbs, Sweep
from gsid.excitation.limits import optimise, search_course, travel
from gsid.excitation.periodic import Limits
from gsid.plots.leakage import amplitudes
from gsid.plots.search import search_course as draw_search

TITLE = "Chapter 3: excitation signals"
PICTURES = {
    "leakage": "Fig. 3.1: spectrum of one period, and of 1.2 periods.",
    "schroeder": "Figs. 3.4 and 3.5: Schroeder multisine.",
    "prbs": "Figs. 3.7 and 3.8: binary sequence.",
    "sweep": "Figs. 3.9 and 3.10: logarithmic sweep.",
    "random": "Figs. 3.11, 3.14 and 3.15, left: random phases.",
    "search": "Fig. 3.13: crest factor and travel during the search for phases.",
    "optimised": "Figs. 3.14 and 3.15, right: phases after the search.",
}
SCHROEDER = f"design multisine {LINES} --band 0.5:250 --amplitude 3 --offset-phase 0.2793"
PRBS = f"design prbs --fs {FS_HZ} --period 6212 --band 0.48:300 --amplitude 45"
SWEEP = (
    f"design sweep {LINES} --band 0.5:250 --kind log --amplitude 16"
    " --phase-deg 45 --phase-of cosine --no-mean --jump"
)
#: The same signals for the pictures.
SIGNALS = {
    "schroeder": lambda: Multisine.design(FS_HZ, PERIOD, (0.5, 250), amplitude=3, offset_phase_rad=0.2793),
    "prbs": lambda: Prbs.design(FS_HZ, 6212, (0.48, 300), amplitude=45),
    "sweep": lambda: Sweep.design(
        *(FS_HZ, PERIOD, (0.5, 250)),
        **{"kind": "log", "amplitude": 16, "phase_rad": np.pi / 4, "phase_of": "cosine"},
        **{"has_mean": False, "continuous": False},
    ),
}
#: The thesis's own model, eq. 7.30, for the travel of section 3.8.
MODEL = RationalModel([-3.132e-5, 7617, 8.768e4], [1, 1027, 1.153e4, 1.735e5], 0.00543)
#: Of the multisine of section 3.8: its peak over its crest factor.
RMS = 109.1 / 4.19


def rows(study: Study) -> list[Row]:
    """Figures of chapter 3."""
    return [*_leakage(study), *_general_purpose(study), *_optimised(study)]


def _leakage(study: Study) -> list[Row]:
    study.record("leakage", f"design multisine {LINES} --band 2:250", 4, wait=PERIOD)
    command = "plot leakage.csv --leakage 1.2"
    study.gsid(command, "leakage")
    u = read_record(study.folder / "leakage.csv").u[-2 * PERIOD :]
    largest_db = []
    for n in (PERIOD, PERIOD * 6 // 5):
        f_hz, amplitude = amplitudes(u[:n], FS_HZ)
        outside = (f_hz < 1.9) | (f_hz > 251)
        largest_db.append(20 * np.log10(np.max(amplitude[outside]) / np.max(amplitude)))
    what = "largest line outside of 2 to 250 Hz over the largest inside [dB]"
    steps = "What is left is the rounding of the command to 12 bits."
    return [
        Row("Fig. 3.1", f"{what}, T = T0", "none", largest_db[0], command, steps),
        Row("Fig. 3.1", f"{what}, T = 1.2 T0", "not printed", largest_db[1], command),
    ]


def _general_purpose(study: Study) -> list[Row]:
    MODEL.save(study.folder / "model_7_30.json")
    schroeder, prbs, sweep = (
        study.gsid(f"{command} --model model_7_30.json") for command in (SCHROEDER, PRBS, SWEEP)
    )
    for name, signal in SIGNALS.items():
        study.draw(lambda signal=signal: signal().plot("command", model=MODEL, limits=Limits(travel=2)), name)
    mean = "Without the mean of the sweep; with it, as definition 3.2.1 has it, 1.465 (EXC-7)."
    share = "0.995 with the mean of the sweep, which is 0.99 if the last digit is cut off."
    within = "Travel by the model of eq. 7.30, in steady state."
    return [
        Row("3.5", "lines of the Schroeder multisine", "500", schroeder["n_lines"], SCHROEDER),
        Row("3.5, Fig. 3.5", "its crest factor", "1.73", schroeder["crest_factor"], SCHROEDER),
        Row("3.5, Fig. 3.4", "its P_int/P_tot", "1", schroeder["p_int_over_p_tot"], SCHROEDER),
        Row("3.5", "its travel to each side [deg]", "< 2", schroeder["travel_deg"], SCHROEDER, within),
        Row("3.6", "period of the binary sequence [s]", "2.07", prbs["period_samples"] / FS_HZ, PRBS),
        Row("3.6, Fig. 3.8", "its crest factor", "1.21", prbs["crest_factor"], PRBS),
        Row("3.6, Fig. 3.7", "its P_int/P_tot", "0.68", prbs["p_int_over_p_tot"], PRBS),
        Row("3.6", "its travel to each side [deg]", "< 2", prbs["travel_deg"], PRBS, within),
        Row("3.7, Fig. 3.10", "crest factor of the sweep", "1.51", sweep["crest_factor"], SWEEP, mean),
        Row("3.7, Fig. 3.9", "its P_int/P_tot", "0.99", sweep["p_int_over_p_tot"], SWEEP, share),
        Row("3.7", "its travel to each side [deg]", "< 2", sweep["travel_deg"], SWEEP, within),
    ]


def _optimised(study: Study) -> list[Row]:
    limits = Limits(command=69.9, travel=1.40)  # the thesis's result: both peaks shall fall below it alike
    start = Multisine.design(FS_HZ, PERIOD, (1.5, 250), shape_db_per_decade=-10, phases="random", rms=RMS)
    if study.quick:
        best = optimise(start, limits, MODEL)
    else:
        search = search_course(start, limits, MODEL)
        best = search.best
        study.draw(lambda: draw_search(search), "search")
    for name, signal in {"random": start, "optimised": best}.items():
        study.draw(lambda signal=signal: signal.plot("command", model=MODEL, limits=limits), name)
    phases = "Other random phases: the figure differs from one realisation to the next."
    better = "The search minimises a norm of high order of command and travel (EXC-9), not two squares."
    found = []
    for what, thesis, value in (
        ("crest factor", ("4.19", "2.68"), lambda signal: signal.crest_factor),
        ("peak of the command", ("109.1", "69.9"), lambda signal: np.abs(signal.table()).max()),
        ("travel to each side [deg]", ("1.94", "1.40"), lambda signal: travel(signal, MODEL)),
    ):
        place = "3.8, Fig. 3.15" if "travel" in what else "3.8, Fig. 3.14"
        how = "gsid.Multisine.design", "gsid.excitation.limits.optimise"
        found.append(Row(place, f"{what}, random phases", thesis[0], float(value(start)), how[0], phases))
        found.append(Row(place, f"{what}, after the search", thesis[1], float(value(best)), how[1], better))
    return found
