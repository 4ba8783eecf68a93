"""Motion of the axis over one period, from the measured output.

The output is divided by the sensor's response, and the part of a flexible mode is subtracted. Each line
has the Wiener weight max(0, 1 - variance / |Y|^2). The mean angle of a rate sensor is not known: 0. The mean
rate is that of an angle that turns on and on (`gsid.records.turn`), else 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from gsid._lib import check, ffi, lib
from gsid.diagnosis.missing_torque.problem import LinearPart, Lines, Problem, linear_kind
from gsid.plant.linear_response import LinearView, linear_view
from gsid.response.sample_hold import held_response


@dataclass(frozen=True, eq=False)
class Motion:
    """One period of one record's motion in equal steps.

    Attributes
    ----------
    step_s : float
    angle, rate : (n,) ndarray
    side : (n,) ndarray
        Mean direction around each sample, -1 .. 1.
    drive : (n,) ndarray
        Torque of the motor less those of damping and springs, over the inertia: what dry friction has to hold
        where the axis stands still.
    rate_std : float
        Standard deviation of the rate's noise.
    """

    step_s: float
    angle: np.ndarray
    rate: np.ndarray
    side: np.ndarray
    drive: np.ndarray
    rate_std: float

    def lines(self, signals: np.ndarray, line: np.ndarray) -> np.ndarray:
        """Amplitudes of lines of signals over this motion, (..., K) complex.

        Parameters
        ----------
        signals : (..., n) ndarray
        line : (K,) int
        """
        return rfft(signals)[..., line] * (2 / signals.shape[-1])


def motions(problem: Problem, part: LinearPart) -> list[Motion]:
    """Motion of each record.

    Parameters
    ----------
    problem : Problem
    part : LinearPart
        Gives the responses of sensor, mode and drive.
    """
    views: dict[int, tuple[np.ndarray, LinearView]] = {}
    for r in problem.records:
        if r.group not in views:
            line, one = _lines_of_motion(problem, part, r), r.spectra
            f_hz = one.f_hz[line]
            view = linear_view(
                part.stack,
                f_hz,
                one.fs_hz,
                output_angle=problem.output_angle,
                radians_per_unit=problem.radians,
                held=one.hold != "none" or problem.closed_loop,
                sensor_hold=lambda rate_hz, f_hz=f_hz, one=one: held_response(
                    f_hz, rate_hz, one.fs_hz, one.period_samples
                ),
            )
            views[r.group] = line, view
    return [_motion(problem, part, r, *views[r.group]) for r in problem.records]


def _lines_of_motion(problem: Problem, part: LinearPart, r: Lines) -> np.ndarray:
    """Lines that show the motion: those above half the rate of a held sensor are images of others."""
    holds = [params for label, params in part.stack.items() if linear_kind(label) == "hold"]
    rates_hz = [rate_hz for params in holds for rate_hz in params.values() if rate_hz > 0]
    slowest_hz = min([r.spectra.fs_hz, *rates_hz])
    below_half = (math.ceil(slowest_hz / r.spectra.f_hz[1]) - 1) // 2
    return np.arange(1, min(math.ceil(problem.settings.motion_band * r.line[-1]), below_half) + 1)


def _motion(problem: Problem, part: LinearPart, r: Lines, line: np.ndarray, view: LinearView) -> Motion:
    Y, variance = r.moved[line], r.variance[line]
    power = np.abs(Y) ** 2
    wiener = np.maximum(0.0, 1 - variance / np.where(power > 0, power, np.inf))
    U = r.u[line]
    sensor = view.direct / view.drive
    s = 2j * np.pi * r.spectra.f_hz[line]
    drive = view.reference * view.drive
    beside = view.command - drive * view.torque  # what a mode adds to the output
    has_mode = any(label.startswith("flexible_mode") for label in part.stack)
    rate = wiener * (Y - (beside * U if has_mode else 0.0)) / sensor
    angle = rate / s
    # The balance of torques without the inertia's: body = 1 / (s + damping + spring / s + feedback).
    held = drive * U - (1 / (view.torque / sensor) - s) * rate
    period_s = r.spectra.period_samples / r.spectra.fs_hz
    n = next_fast_len(math.ceil(problem.settings.oversampling * line[-1]), real=True)
    step_s = period_s / n
    mean = float(r.moved[0].real) if problem.output_angle else 0.0
    signals = synthesis(np.array([angle, rate, s * rate, held]), line, n)
    signals[1] += r.spectra.turn / period_s if problem.output_angle else 0.0
    side = np.empty(n)
    doubles = [ffi.from_buffer("double[]", np.ascontiguousarray(x)) for x in (signals[1], signals[2], side)]
    check(lib.gsid_law_side(n, step_s, *doubles), "mean direction")
    rate_std = math.sqrt(np.sum(variance * (wiener / np.abs(sensor)) ** 2) / 2)
    return Motion(step_s, signals[0] + mean, signals[1], side, signals[3], rate_std)


def synthesis(lines: np.ndarray, line: Sequence[int], n: int) -> np.ndarray:
    """Signals of n samples from amplitudes of their lines, (..., n).

    Parameters
    ----------
    lines : (..., K) complex ndarray
    line : (K,) int
    n : int
    """
    spectrum = np.zeros((*lines.shape[:-1], n // 2 + 1), complex)
    spectrum[..., line] = lines
    return irfft(spectrum, n) * (n / 2)
