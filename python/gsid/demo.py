"""The main job, end to end, on the simulated axis: excited over a serial line, measured, fitted, compared."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsid.compare import Comparison, compare
from gsid.excitation import Multisine
from gsid.fit import fit
from gsid.frf import Frf, Spectra, frf, spectra
from gsid.io import write_record
from gsid.link import Progress, run
from gsid.model import RationalModel
from gsid.record import Record
from gsid.report import Report, Truth

FS_HZ = 3000.0
PERIOD = 6000
BAND_HZ = (0.5, 250.0)
AMPLITUDE = 3.0  # command per line, as the source's Schroeder multisine
PERIODS = 12  # not a multiple of 5, over which the fan's 61.8 turns per period would cancel from the mean
SETTLE_PERIODS = 2
ORDER = "5/3"  # rigid body on a spring, flexible mode, gyro lag
COULOMB_LEVEL = 2.0  # deg/s^2, about 1 % of the torque that the excitation peaks at

DELAY_TOLERANCE_S = 5e-5
MODE_TOLERANCE_HZ = 0.5
SIGMAS = 3.0


@dataclass
class Experiment:
    """One run of the axis and what was made of it."""

    name: str
    story: str
    record: Record
    spectra: Spectra
    frf: Frf
    model: RationalModel
    comparison: Comparison
    truth: list[Truth]


@dataclass
class Demo:
    """Both runs, what they should have shown, and where the report is."""

    linear: Experiment
    friction: Experiment
    checks: dict[str, bool]
    report: Path

    @property
    def passed(self) -> bool:
        return all(self.checks.values())

    def to_dict(self) -> dict[str, Any]:
        """The numbers of `gsid demo --json`."""
        return {
            "report": str(self.report),
            "passed": self.passed,
            "checks": self.checks,
            "truth": [
                {"name": t.name, "unit": t.unit, "truth": t.truth, "estimate": t.estimate, "std": t.std}
                for t in self.linear.truth
            ],
            "linear": self.linear.comparison.to_dict(),
            "friction": self.friction.comparison.to_dict(),
        }


def demo(
    folder: str | Path,
    *,
    seed: int = 1,
    on_step: Callable[[str], None] = lambda text: None,
    on_progress: Callable[[Progress], None] | None = None,
) -> Demo:
    """Measure, fit and compare the simulated axis twice, without and with Coulomb friction.

    Parameters
    ----------
    folder : path-like
        Where records, models and the report are written; made when it is not there.
    seed : int
        Of the axis's noise.
    on_step : callable
        Told in words what comes next.
    on_progress : callable, optional
        Told how far a run over the serial line is.

    Returns
    -------
    Demo
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    excitation = Multisine.design(FS_HZ, PERIOD, BAND_HZ, amplitude=AMPLITUDE)
    steps = (on_step, on_progress)
    linear = _experiment(
        "linear",
        "The axis without friction; the model stands beside the truth.",
        excitation,
        folder,
        seed,
        0.0,
        steps,
    )
    story = (
        f"The same axis with Coulomb friction of {COULOMB_LEVEL:g} deg/s², fitted by the same linear model."
    )
    friction = _experiment("friction", story, excitation, folder, seed + 1, COULOMB_LEVEL, steps)

    on_step("writing the report")
    report = Report("A simulated gimbal axis, measured, fitted and compared")
    for experiment in (linear, friction):
        report.add_experiment(
            experiment.name,
            experiment.record,
            experiment.spectra,
            experiment.frf,
            experiment.model,
            experiment.comparison,
            multisine=excitation,
            truth=experiment.truth if experiment is linear else None,
            story=experiment.story,
        )
    path = report.write(folder / "report.html")
    return Demo(linear, friction, _checks(linear, friction), path)


def _experiment(
    name: str,
    story: str,
    excitation: Multisine,
    folder: Path,
    seed: int,
    coulomb_level: float,
    steps: tuple[Callable[[str], None], Callable[[Progress], None] | None],
) -> Experiment:
    on_step, on_progress = steps
    truth_file = folder / f"{name}_truth.json"
    on_step(f"{name}: exciting the axis over the serial line")
    with simulated_axis(truth_file, seed, coulomb_level) as port:
        record = run(
            port, excitation, periods=PERIODS, settle=SETTLE_PERIODS * PERIOD, on_progress=on_progress
        )
    record.name = f"{name}.csv"
    write_record(folder / record.name, record)
    on_step(f"{name}: measuring, fitting order {ORDER} and comparing")
    measured = spectra(record)
    response = frf(record)
    model = fit(response, ORDER)
    model.save(folder / f"{name}_model.json")
    comparison = compare(model, measured)
    truth = beside_truth(model, json.loads(truth_file.read_text(encoding="utf-8")))
    return Experiment(name, story, record, measured, response, model, comparison, truth)


@contextlib.contextmanager
def simulated_axis(truth_file: Path, seed: int, coulomb_level: float) -> Iterator[str]:
    """Serve a simulated axis in a process of its own, as `gsid simulate` does; gives the port's path."""
    command = [sys.executable, "-m", "gsid.cli.main", "simulate", "--once", "--seed", str(seed)]
    command += ["--coulomb", str(coulomb_level), "--truth", str(truth_file)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            port = process.stdout.readline().strip()
            if not port:
                raise RuntimeError(f"the simulated axis did not start: {process.stderr.read()}")
            yield port
            process.wait(timeout=10)  # it ends by itself when the port is closed
        finally:
            process.terminate()


def mode_pole(poles: np.ndarray, f_hz: float) -> int:
    """Index of the pole above the real axis whose natural frequency [Hz] is nearest to f_hz."""
    above = np.flatnonzero(poles.imag > 0)
    if len(above) == 0:
        raise ValueError("the model has no pair of complex poles")
    return int(above[np.argmin(np.abs(np.abs(poles[above]) / (2 * np.pi) - f_hz))])


def beside_truth(model: RationalModel, truth: dict[str, Any]) -> list[Truth]:
    """Estimates beside the true values of a simulated axis (the JSON of `gsid simulate --truth`).

    Parameters
    ----------
    model : RationalModel
        In s, of the orders of the truth.
    truth : dict
        num, den (highest power first), delay_s, parameters.

    Returns
    -------
    list of Truth
        Delay, frequency of the mode, and every coefficient.
    """
    rows = [Truth("delay", "ms", 1e3 * truth["delay_s"], 1e3 * model.delay_s, 1e3 * model.std_delay_s)]
    f_mode = truth["parameters"]["mode_f_hz"]
    index = mode_pole(model.poles, f_mode)
    pole, cov = model.poles[index], model.pole_cov[index]
    along = np.array([pole.real, pole.imag]) / abs(pole)
    rows.append(
        Truth(
            "mode", "Hz", f_mode, abs(pole) / (2 * np.pi), float(np.sqrt(along @ cov @ along)) / (2 * np.pi)
        )
    )
    n = model.n_poles
    for name, true, estimate, std in (
        ("den", truth["den"], model.den, model.std_den),
        ("num", truth["num"], model.num, model.std_num),
    ):
        degree = len(estimate) - 1
        if len(true) > degree + 1:
            raise ValueError(f"the truth's {name} has degree {len(true) - 1}, the model's {degree}")
        padded = np.concatenate([np.zeros(degree + 1 - len(true)), true])
        for i in range(1 if name == "den" else 0, degree + 1):
            power = degree - i
            unit = f"s{_raised(power - n)}" if name == "den" else f"deg s{_raised(power - n - 1)}/command"
            rows.append(Truth(f"{name}, s{_raised(power)}", unit, padded[i], estimate[i], std[i]))
    return rows


def _raised(power: int) -> str:
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _checks(linear: Experiment, friction: Experiment) -> dict[str, bool]:
    """What the two runs have to show."""
    delay, mode = linear.truth[0], linear.truth[1]
    where = friction.comparison.where
    return {
        "delay within 0.05 ms": abs(delay.estimate - delay.truth) <= 1e3 * DELAY_TOLERANCE_S,
        "mode within 0.5 Hz": abs(mode.estimate - mode.truth) <= MODE_TOLERANCE_HZ,
        "every parameter within 3 sigma": all(abs(t.n_sigma) <= SIGMAS for t in linear.truth),
        "linear model adequate without friction": linear.comparison.adequate,
        "linear model rejected with friction": not friction.comparison.adequate,
        "the misfit is at low frequency": bool(where) and where[0]["f_hi_hz"] < BAND_HZ[1] / 10,
    }
