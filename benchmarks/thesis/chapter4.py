"""Chapter 4: measured frequency responses and their noise."""

from __future__ import annotations

import numpy as np
from chapter3 import PRBS, SCHROEDER, SWEEP
from matplotlib.figure import Figure
from thesis_study import AXIS, FS_HZ, HIGHEST_HZ, PERIOD, Row, Study, rows_of

from gsid import Frf, frf, read_record

TITLE = "Chapter 4: frequency responses"
PICTURES = {
    "zero": "Figs. 4.1 to 4.3: zero input, spectrum of the noise and the fan.",
    "schroeder_time": "Figs. 4.4 and 4.5: multisine, input, output and position.",
    "schroeder_frf": "Fig. 4.10: multisine, response.",
    "prbs_time": "Figs. 4.11 and 4.12: binary sequence, input, output and position.",
    "prbs_frf": "Fig. 4.17: binary sequence, response.",
    "sweep_time": "Figs. 4.18 and 4.19: sweep, input, output and position.",
    "sweep_frf": "Fig. 4.24: sweep, response.",
    "variances": "Figs. 4.7, 4.14 and 4.21: noise of the output, one period. That of the input (4.6) is 0.",
    "responses": "Figs. 4.25 and 4.26: the three responses and their standard deviations.",
}
BAND = f"0.5:{HIGHEST_HZ}"
PERIODS = 75
NAMES = {"schroeder": "multisine", "prbs": "binary sequence", "sweep": "sweep"}
EXCITATIONS = {"schroeder": SCHROEDER, "prbs": PRBS, "sweep": SWEEP}
FAN_HZ = 30.9
#: Section and first figure of each experiment, and its samples without transients.
THESIS = {
    "schroeder": ("4.4.2", 4, "450000"),
    "prbs": ("4.4.3", 11, "465900"),
    "sweep": ("4.4.4", 18, "450000"),
}
#: Bands of the comparison [Hz].
PARTS = {
    "low": (0.5, 5),
    "middle": (5, 100),
    "slope": (10, 100.1),
    "resonance": (160, 195),
    "below 3": (0.5, 3),
    "below 28": (3, 28),
    "above 28": (28, HIGHEST_HZ),
    "fan": (25, 37),
}


def rows(study: Study) -> list[Row]:
    """Figures of chapter 4."""
    found = _zero(study)
    responses = {}
    for name in [name for name in NAMES if not (study.quick and name == "prbs")]:
        command = measure(study, name)
        responses[name] = frf(read_record(study.folder / f"{name}.csv"), band=(0.5, HIGHEST_HZ))
        found += _experiment(study, name, command, responses[name])
    return [*found, *_compared(study, responses)]


def measure(study: Study, name: str) -> str:
    """Measure one of the three experiments, and return the command."""
    seed = 1 + list(NAMES).index(name)
    return study.record(name, EXCITATIONS[name], PERIODS, seed=seed)


def _zero(study: Study) -> list[Row]:
    seconds = 8 if study.quick else 50
    run = f"run --simulate '{AXIS} --seed 11' --zero {seconds} --period {PERIOD} -o zero.csv"
    study.once(run, "zero.csv")
    command = "noise zero.csv"
    noise = study.gsid(command, "zero")["records"][0]
    y = read_record(study.folder / "zero.csv").y[-seconds * FS_HZ :]
    f_hz, psd = (np.array(noise[key]) for key in ("f_hz", "psd"))
    low, high = (np.mean(psd[(f_hz >= lo) & (f_hz <= hi)]) for lo, hi in ((0.5, 5), (100, HIGHEST_HZ)))
    fan = min((tone["f_hz"] for tone in noise["tones"]), key=lambda f: abs(f - FAN_HZ), default=np.nan)
    others = ", ".join(f"{tone['f_hz']:.1f}" for tone in noise["tones"] if tone["f_hz"] > HIGHEST_HZ)
    size = "The noise of the simulated gyro: 0.01 deg/s white, 0.01 deg/s below 5 Hz, and the fan."
    images = "Images of the fan: multiples of 400.02 Hz, less and plus 30.9 Hz. The thesis ends at 250 Hz."
    return [
        *rows_of(
            *("4.4.1, Fig. 4.1", run),
            ("largest output at zero input [deg/s]", "0.050", float(np.abs(y - y.mean()).max()), size),
        ),
        *rows_of(
            *("4.4.1, Figs. 4.2, 4.3", command),
            ("tone of the cooling fan [Hz]", "30.9", float(fan)),
            ("other tones [Hz]", "not printed", others or "none", images),
            ("noise below 5 Hz over 100 to 200 Hz [dB]", "falls", float(10 * np.log10(low / high))),
        ),
    ]


def _experiment(study: Study, name: str, run: str, response: Frf) -> list[Row]:
    place, figure, samples = THESIS[name]
    look = f"look {name}.csv --limit-travel-deg 2"
    position = study.gsid(look, f"{name}_time")["records"][0]["position"]
    command = f"frf {name}.csv --band {BAND}"
    if not study.quick:
        study.gsid(command, f"{name}_frf")
    offset = ["The offset of the gyro is subtracted; the thesis leaves it in."] if name == "prbs" else []
    what, n = NAMES[name], response.n_periods * response.period_samples
    side = float(max(map(abs, position)))
    return [
        *rows_of(place, run, (f"{what}: samples without transients", samples, n)),
        *rows_of(
            f"Fig. 4.{figure + 1}", look, (f"{what}: position, to one side [deg]", "< 2", side, *offset)
        ),
        *rows_of(
            *(f"Figs. 4.{figure + 2} to 4.{figure + 5}", command),
            (f"{what}: largest variance of the input", "0", float(np.max(response.var_u))),
            (f"{what}: largest covariance", "0", float(np.max(np.abs(response.cov_yu)))),
        ),
    ]


def _variances(responses: dict[str, Frf]) -> Figure:
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    ax = figure.subplots()
    for name, response in responses.items():
        ax.semilogx(response.f_hz, 10 * np.log10(response.var_y), linewidth=0.8, label=NAMES[name])
    ax.set(xlabel="frequency [Hz]", ylabel="variance [dB re 1 (deg/s)²]")
    ax.legend()
    return figure


def _compared(study: Study, responses: dict[str, Frf]) -> list[Row]:
    command = "plot " + " ".join(f"{name}.csv" for name in responses) + f" --band {BAND}"
    if not study.quick:
        study.gsid(command, "responses")
    study.draw(lambda: _variances(responses), "variances")
    multisine, sweep = responses["schroeder"], responses["sweep"]
    f_hz, gain = multisine.f_hz, np.abs(multisine.g)
    part = {name: (f_hz >= lo) & (f_hz < hi) for name, (lo, hi) in PARTS.items()}
    slope = np.polyfit(np.log10(f_hz[part["slope"]]), 20 * np.log10(gain[part["slope"]]), 1)[0]
    resonance = f_hz[part["resonance"]][np.argmax(gain[part["resonance"]])]
    difference = np.abs(sweep.g - multisine.g) / gain
    low, high = (float(100 * np.sqrt(np.mean(difference[part[name]] ** 2))) for name in ("low", "middle"))
    ratio = np.sqrt(sweep.var_g / multisine.var_g)
    ratios = [float(np.median(ratio[part[name]])) for name in ("below 3", "below 28", "above 28")]
    near = part["fan"] & (np.abs(f_hz - FAN_HZ) > 1)
    fan = float(np.sqrt(multisine.var_g[np.argmin(np.abs(f_hz - FAN_HZ))] / np.median(multisine.var_g[near])))
    lags = "The lag of the gyro and its refreshes add to the -20 dB/decade of the axis."
    friction = "Friction: the signals move the axis differently. 5 % are 0.4 dB, which no Bode plot shows."
    level = "A line of the sweep exceeds the 3 V of the multisine below 3 Hz only (Fig. 3.9)."
    return [
        *rows_of(
            *("4.4.5, Fig. 4.25", command),
            ("slope of the gain, 10 to 100 Hz [dB/decade]", "-20", float(slope), lags),
            ("resonance [Hz]", "179", float(resonance)),
            ("difference of sweep and multisine below 5 Hz, rms [%]", "they differ", low, friction),
            ("the same, 5 to 100 Hz", "they overlap", high, friction),
        ),
        *rows_of(
            *("4.4.5, Fig. 4.26", command),
            ("σ of the sweep over σ of the multisine below 3 Hz, median", "< 1", ratios[0]),
            ("the same, 3 to 28 Hz", "< 1", ratios[1], level),
            ("the same, above 28 Hz", "> 1", ratios[2]),
            ("σ at 31 Hz over that of the lines around", "a small peak", fan),
        ),
    ]
