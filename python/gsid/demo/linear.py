"""First half of the demo: measure the axis, fit a linear model, and compare."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsid.comparison import Comparison, compare
from gsid.demo.axis import Bench
from gsid.excitation.multisine import Multisine
from gsid.fitting.rational import fit
from gsid.models.rational import RationalModel
from gsid.records.record import Record
from gsid.report import Report, Truth
from gsid.response.estimate import frf
from gsid.response.frf import Frf
from gsid.spectrum.realisation import spectra
from gsid.spectrum.spectra import Spectra

BAND_HZ = (0.5, 250.0)
AMPLITUDE = 3.0  # command per line, as in the Schroeder multisine of the thesis
PERIODS = 12  # not a multiple of 5, over which the fan's 61.8 turns per period would cancel from the mean
ORDER = "5/3"  # rigid body on a spring, flexible mode, gyro lag
COULOMB_LEVEL = 2.0  # deg/s^2, about 1 % of the torque that the excitation peaks at

DELAY_TOLERANCE_S = 5e-5
MODE_TOLERANCE_HZ = 0.5
SIGMAS = 3.0
ALPHA = 0.01  # of the comparison: at 5 % one seed in twenty would fail by chance


@dataclass
class Experiment:
    """One run of the axis, and the models and results from it."""

    name: str
    story: str
    record: Record
    spectra: Spectra
    frf: Frf
    model: RationalModel
    comparison: Comparison
    truth: list[Truth]


def experiment(
    bench: Bench, excitation: Multisine, seed: int, name: str, story: str, coulomb_level: float
) -> Experiment:
    """Measure the axis with this friction, fit, and compare."""
    truth_file = bench.folder / f"{name}_truth.json"
    bench.on_step(f"{name}: exciting the axis over the serial line")
    record = bench.measure(
        name,
        excitation,
        PERIODS,
        seed=seed,
        effect="coulomb_friction",
        params={"level": coulomb_level},
        truth_file=truth_file,
    )
    bench.on_step(f"{name}: measuring, fitting order {ORDER} and comparing")
    measured = spectra(record)
    response = frf(record)
    model = fit(response, ORDER)
    model.save(bench.folder / f"{name}_model.json")
    comparison = compare(model, measured, alpha=ALPHA, fitted=True)
    truth = compared_with_truth(model, json.loads(truth_file.read_text(encoding="utf-8")))
    return Experiment(name, story, record, measured, response, model, comparison, truth)


def both(bench: Bench, excitation: Multisine, seed: int) -> tuple[Experiment, Experiment]:
    """The axis without friction, and with it."""
    story = "The axis without friction: the fitted parameters are compared with the true ones."
    linear = experiment(bench, excitation, seed, "linear", story, 0.0)
    story = (
        f"The same axis with Coulomb friction of {COULOMB_LEVEL:g} deg/s², fitted by the same linear model."
    )
    return linear, experiment(bench, excitation, seed + 1, "friction", story, COULOMB_LEVEL)


def add_to(page: Report, linear: Experiment, friction: Experiment, excitation: Multisine) -> None:
    """Add both experiments to the page, folded: the hidden effect is its story."""
    for one in (linear, friction):
        page.add_experiment(
            one.name,
            one.record,
            one.spectra,
            one.frf,
            one.model,
            one.comparison,
            multisine=excitation,
            truth=one.truth if one is linear else None,
            story=one.story,
            folded=True,
        )


def mode_pole(poles: np.ndarray, f_hz: float) -> int:
    """Index of the pole above the real axis whose natural frequency [Hz] is nearest to f_hz."""
    above = np.flatnonzero(poles.imag > 0)
    if len(above) == 0:
        raise ValueError("the model has no pair of complex poles")
    return int(above[np.argmin(np.abs(np.abs(poles[above]) / (2 * np.pi) - f_hz))])


def compared_with_truth(model: RationalModel, truth: dict[str, Any]) -> list[Truth]:
    """Estimates compared with the true values of a simulated axis (the JSON of `gsid simulate --truth`).

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


def checks(linear: Experiment, friction: Experiment) -> dict[str, bool]:
    """Criteria that the two runs have to meet."""
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
