"""The records, and the linear part of a plant that is fitted to them.

    E = Y - Gd(p) U - P(p) T

Y and U are the means over the periods, Gd the response to the held command, P that to a torque. T are the
lines of torques along the measured motion, none in the fit of the linear part alone. A real number of the
whitened E has a variance of 1 where only noise is left.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from scipy.optimize import brentq

from gsid.base.deadline import Deadline
from gsid.base.zero_order_hold import hold_factor
from gsid.diagnosis.missing_torque.far_images import FarImages
from gsid.diagnosis.missing_torque.settings import SearchSettings
from gsid.effects.types import catalogue
from gsid.greybox.weights import lines_used, pooled_variance
from gsid.plant.linear_response import LinearView, linear_view
from gsid.plant.model import PlantModel
from gsid.plant.periodic import input_period, longest_delay_s
from gsid.plant.units import RADIANS
from gsid.response.sample_hold import MeanOutput, held_response, rounding
from gsid.spectrum.spectra import Spectra

ONE_BY_ONE = {"backlash", "hold", "loop"}  # linear parts that take one value at a time
Responses = list[tuple[np.ndarray, np.ndarray]]  # (Gd, P) of each group of records
STEP = 1e-6  # relative step of a derivative: the responses are smooth, and rounding is 1e-10 of it


@dataclass(frozen=True, eq=False)
class Lines:
    """One record on the lines of the fit.

    Attributes
    ----------
    spectra : Spectra
    u, y : (N/2 + 1,) complex ndarray
        Means over the periods of all lines.
    line : (K,) int
    U, Y : (K,) complex ndarray
        The same on the lines of the fit.
    weight : (K,) ndarray
        Makes the real and the imaginary part of Y's noise have unit variance.
    variance : (N/2 + 1,) ndarray
        Of the mean of all lines of the output.
    command : (N,) ndarray
        One period of the mean input.
    group : int
        Records of one group have the same lines, rate and hold, and so the same responses.
    moved : (N/2 + 1,) complex ndarray
        Mean output that the motion is taken from.
    """

    spectra: Spectra
    u: np.ndarray
    y: np.ndarray
    line: np.ndarray
    U: np.ndarray
    Y: np.ndarray
    weight: np.ndarray
    variance: np.ndarray
    command: np.ndarray
    group: int
    moved: np.ndarray

    @property
    def f_hz(self) -> np.ndarray:
        """Frequencies of the lines [Hz]."""
        return self.spectra.f_hz[self.line]


@dataclass(frozen=True, eq=False)
class LinearPart:
    """Structure of the linear part and its values; `names` are the free ones, as "effect.parameter"."""

    stack: dict[str, dict[str, float]]
    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray

    @property
    def values(self) -> np.ndarray:
        """(n,) values of `names`."""
        return np.array([self.stack[label][name] for label, name in map(split, self.names)])

    @property
    def key(self) -> tuple:
        """What a fit that begins from these values depends on, hashable."""
        stack = tuple((label, *params.items()) for label, params in self.stack.items())
        return (stack, self.names, self.lower.tobytes(), self.upper.tobytes())

    def at(self, values: np.ndarray) -> LinearPart:
        """The same structure with other values.

        Parameters
        ----------
        values : (n,) ndarray
            Or (n, m, 1): those of m parts, for `linear_view`.
        """
        stack = {label: dict(params) for label, params in self.stack.items()}
        for name, value in zip(self.names, values, strict=True):
            label, parameter = split(name)
            stack[label][parameter] = value if np.ndim(value) else float(value)
        return replace(self, stack=stack)


def linear_kind(label: str) -> str | None:
    """What an effect of a stack is in a linear axis, as `EffectType.linear_part`; None for a law.

    A law may be one of the user's own, which the catalogue does not have.

    Parameters
    ----------
    label : str
    """
    known = catalogue().get(label.partition("#")[0])
    return known.linear_part if known else None


@cache
def split(name: str) -> tuple[str, str]:
    """Label of the effect, and name of the parameter."""
    label, _, parameter = name.rpartition(".")
    return label, parameter


def linear_part(model: PlantModel) -> LinearPart:
    """Linear part of a model: its effects with a linear part, and their free parameters.

    Parameters
    ----------
    model : PlantModel
    """
    linear = {label for label, effect in model.labels() if effect.type.linear_part}
    lower, upper = model.bounds()
    free = [(i, name) for i, name in enumerate(model.free_names) if split(name)[0] in linear]
    chosen = [i for i, _ in free]
    return LinearPart(model.stack(), tuple(name for _, name in free), lower[chosen], upper[chosen])


class Problem:
    """Records, lines and weights of a fit of the linear part.

    Parameters
    ----------
    model : PlantModel
        Defines the output, and the default of the band.
    measured : sequence of Spectra
    band : (lo, hi) or None
        Hz.
    settings : SearchSettings
    deadline : Deadline, optional
        Time at which the next evaluation raises OutOfTime.
    along : sequence of Spectra, optional
        Records whose output is that of the motion, where the part of known laws was subtracted from
        `measured`.

    Attributes
    ----------
    has_model_error : bool
        Whether the weights contain what a model leaves (`with_model_error`).
    """

    def __init__(
        self,
        model: PlantModel,
        measured: Sequence[Spectra],
        band: tuple[float, float] | None,
        settings: SearchSettings,
        deadline: Deadline | None = None,
        along: Sequence[Spectra] | None = None,
    ) -> None:
        self.settings, self.deadline = settings, deadline or Deadline()
        self.has_model_error = False
        self.output_angle = model.output == "angle"
        self.radians = RADIANS[model.angle_unit]
        self.closed_loop = model.has_controller
        kinds: list[tuple] = []
        self.records: list[Lines] = []
        moved = [one.y for one in along or measured]
        for one, y, (variance, dof) in zip(measured, moved, pooled_variance(measured), strict=True):
            variance = (
                variance * dof / max(dof - 1, 1)
            )  # the mean of 1 / variance is then that of the true one
            used = lines_used(model, one, band)
            used[0] = False  # an offset of the sensor
            kind = (one.fs_hz, one.period_samples, one.hold, np.flatnonzero(used).tobytes())
            if kind not in kinds:
                kinds.append(kind)
            self.records.append(_lines(one, np.flatnonzero(used), variance, kinds.index(kind), y))
        self.n_groups = len(kinds)
        self._known_lines: dict[tuple[int, int], tuple[np.ndarray, np.ndarray | None]] = {}
        self._known_holds: dict[tuple[int, int, float], np.ndarray] = {}
        self._known_far: dict[tuple[int, int], FarImages] = {}
        self.first = [next(r for r in self.records if r.group == g) for g in range(self.n_groups)]
        self.n_rows = 2 * sum(len(r.line) for r in self.records)

    @property
    def longest_delay_s(self) -> float:
        """Longest delay that the simulation of these records can have."""
        return min(longest_delay_s(one.spectra, self.closed_loop) for one in self.first)

    # ---- responses ----

    def view(self, part: LinearPart, group: int, images: int = 0) -> LinearView:
        """Responses of a linear part at the lines of a group of records, image after image.

        Parameters
        ----------
        part : LinearPart
        group : int
        images : int
            On each side.
        """
        sensor_hold = partial(self._sensor_hold, group, images)
        return self._view(part, group, *self._lines_of_view(group, images), sensor_hold)

    def _view(
        self,
        part: LinearPart,
        group: int,
        f_hz: np.ndarray,
        hold: np.ndarray | None,
        sensor_hold: Callable[[float], np.ndarray] | None = None,
    ) -> LinearView:
        return linear_view(
            part.stack,
            f_hz,
            self.first[group].spectra.fs_hz,
            output_angle=self.output_angle,
            radians_per_unit=self.radians,
            held=hold is not None,
            hold=hold,
            sensor_hold=sensor_hold,
        )

    def _sensor_hold(self, group: int, images: int, rate_hz: float) -> np.ndarray:
        """Response of a sensor that is sampled and held, at the lines of `view` (BLA-4)."""
        key = group, images, rate_hz
        if key not in self._known_holds:
            one, (f_hz, _) = self.first[group].spectra, self._lines_of_view(group, images)
            self._known_holds[key] = held_response(f_hz, rate_hz, one.fs_hz, one.period_samples)
        return self._known_holds[key]

    def _lines_of_view(self, group: int, images: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Frequencies of `view`, and the response of the hold there, which is the same in all evaluations."""
        if (group, images) not in self._known_lines:
            lines = self.first[group]
            fs_hz = lines.spectra.fs_hz
            f_hz = (lines.f_hz + np.arange(-images, images + 1)[:, None] * fs_hz).ravel()
            held = lines.spectra.hold != "none" or self.closed_loop
            self._known_lines[group, images] = f_hz, hold_factor(f_hz, fs_hz) if held else None
        return self._known_lines[group, images]

    def responses(self, part: LinearPart, images: int = 0) -> list[tuple[np.ndarray, np.ndarray]]:
        """(Gd, P) of each group: response to the sampled command, and to a torque.

        Parameters
        ----------
        part : LinearPart
        images : int
            Of the held command, on each side.

        Raises
        ------
        OutOfTime
            The deadline was reached.
        """
        self.deadline.check()
        found = []
        for group, lines in enumerate(self.first):
            is_held = lines.spectra.hold != "none"
            view = self.view(part, group, images if is_held else 0)
            n_lines = len(lines.line)
            n_images = view.command.shape[-1] // n_lines
            command, torque = (
                x.reshape(*x.shape[:-1], n_images, n_lines) for x in (view.command, view.torque)
            )
            far = self._far_images(part, group, images) if images and is_held else 0.0
            found.append((command.sum(axis=-2) + far, torque[..., n_images // 2, :]))
        return found

    def _far_images(self, part: LinearPart, group: int, images: int) -> np.ndarray | float:
        """Sum of the images beyond some; left out behind a sensor that is held, and in a closed loop."""
        kinds = {label: linear_kind(label) for label in part.stack}
        last = self.settings.images_far
        if self.closed_loop or last <= images or ONE_BY_ONE & set(kinds.values()):
            return 0.0
        lines = self.first[group]
        if (group, images) not in self._known_far:
            self._known_far[group, images] = FarImages(lines.f_hz, lines.spectra.fs_hz, images, last)
        delay_s = sum(part.stack[label]["delay_s"] for label, kind in kinds.items() if kind == "delay")
        far = self._known_far[group, images]
        return far.sum(lambda f, hold: self._view(part, group, f, hold).command, delay_s)

    def whiten(self, errors: Sequence[np.ndarray]) -> np.ndarray:
        """Errors of each record, (..., K), whitened and put together as real numbers, (..., n_rows).

        Parameters
        ----------
        errors : sequence of complex ndarray
        """
        parts = [error * record.weight for error, record in zip(errors, self.records, strict=True)]
        together = np.concatenate(parts, axis=-1)
        return np.concatenate([together.real, together.imag], axis=-1)

    def has_mean_angle(self, part: LinearPart) -> bool:
        """Whether the mean angle is known: measured, or held by a spring that the records show.

        Parameters
        ----------
        part : LinearPart
        """
        lowest = 2 * np.pi * min(float(r.f_hz[0]) for r in self.records)
        return self.output_angle or self.stiffness(part) > (self.settings.held_angle * lowest) ** 2

    def stiffness(self, part: LinearPart) -> float:
        """Of all springs, over the inertia [1/s^2].

        Parameters
        ----------
        part : LinearPart
        """
        return sum(
            next(iter(params.values()))
            for label, params in part.stack.items()
            if linear_kind(label) == "spring"
        )

    def lines_of(self, whitened: np.ndarray) -> list[np.ndarray]:
        """The errors of each record, (K,) complex, that `whiten` put together.

        Parameters
        ----------
        whitened : (n_rows,) ndarray
        """
        half = self.n_rows // 2
        together = whitened[:half] + 1j * whitened[half:]
        ends = np.cumsum([len(r.line) for r in self.records])[:-1]
        return [part / r.weight for part, r in zip(np.split(together, ends), self.records, strict=True)]

    def with_model_error(self, part: LinearPart, errors: Sequence[np.ndarray]) -> Problem:
        """The same records, weighted by noise and by a white torque of the power that a model leaves.

        The weights of noise put everything on the lines where the output is largest, however little of it
        the model explains there.

        Parameters
        ----------
        part : LinearPart
            Gives the response to a torque.
        errors : sequence of (K,) complex ndarray
            What the model leaves of each record.
        """
        entries = self.responses(part)
        records = []
        for r, error in zip(self.records, errors, strict=True):
            noise, entry = r.variance[r.line], np.abs(entries[r.group][1]) ** 2
            power = torque_power(np.abs(error) ** 2, noise, entry)
            variance = np.maximum(noise + power * entry, np.finfo(float).tiny)
            records.append(replace(r, weight=np.sqrt(2 / variance)))
        other = copy.copy(self)
        other.records, other.has_model_error = records, True
        other.first = [next(r for r in records if r.group == g) for g in range(self.n_groups)]
        return other

    def rows_of(self, record: int) -> np.ndarray:
        """Rows of `whiten` that belong to one record, (n_rows,) bool.

        Parameters
        ----------
        record : int
        """
        sizes = [len(r.line) for r in self.records]
        of = np.repeat(np.arange(len(sizes)), sizes) == record
        return np.concatenate([of, of])

    def error(
        self, part: LinearPart, commands: Sequence[np.ndarray], torques: Sequence[np.ndarray] | None = None
    ) -> np.ndarray:
        """Whitened E.

        Parameters
        ----------
        part : LinearPart
        commands : sequence of (K,) complex ndarray
            Lines of the command of each record, after the static maps of the drive.
        torques : sequence of (K,) complex ndarray, optional
            Lines of a torque against the motion.
        """
        found = self.responses(part, self.settings.images)
        answers = [found[r.group][0] * u for r, u in zip(self.records, commands, strict=True)]
        if torques is not None:
            answers = [
                y - found[r.group][1] * t for y, r, t in zip(answers, self.records, torques, strict=True)
            ]
        return self.whiten([r.Y - y for r, y in zip(self.records, answers, strict=True)])

    def tangent(
        self,
        part: LinearPart,
        commands: Sequence[np.ndarray],
        torques: Sequence[np.ndarray] | None = None,
        here: Responses | None = None,
    ) -> np.ndarray:
        """Derivative of the whitened E by the free values, (n_rows, n); the images move with their line.

        Parameters
        ----------
        part, commands, torques
            As `error`.
        here : list, optional
            `responses` of the part, if they are known.
        """
        values = part.values
        if not len(values):
            return np.zeros((self.n_rows, 0))
        largest = np.where(part.upper < 1, 1e-3 * np.abs(part.upper), 1e-6)
        step = STEP * np.maximum(np.abs(values), largest)
        slopes = [
            ((g - a) / step[:, None], (p - b) / step[:, None])
            for (g, p), (a, b) in zip(
                self._several_responses(part, values + np.diag(step)),
                here or self.responses(part),
                strict=True,
            )
        ]
        parts = [-slopes[r.group][0] * u for r, u in zip(self.records, commands, strict=True)]
        if torques is not None:
            parts = [e + slopes[r.group][1] * t for e, r, t in zip(parts, self.records, torques, strict=True)]
        return self.whiten(parts).T

    def _several_responses(self, part: LinearPart, values: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """(Gd, P) of each group without images, (n, K) each, for rows of free values."""
        kinds = {linear_kind(split(name)[0]) for name in part.names}
        if kinds & ONE_BY_ONE:
            each = [self.responses(part.at(row)) for row in values]
            return [
                tuple(np.array(both) for both in zip(*group, strict=True))
                for group in zip(*each, strict=True)
            ]
        return self.responses(part.at(values.T[:, :, None]))

    @property
    def mean_outputs(self) -> list[MeanOutput]:
        """Output of each record; images of a sensor that is held stand above the lines of the fit."""
        return [
            MeanOutput(r.y, r.variance, int(r.line[-1]), r.spectra.fs_hz, r.spectra.period_samples)
            for r in self.records
        ]

    @property
    def commands(self) -> list[np.ndarray]:
        """Lines of the command of each record, as given."""
        return [r.U for r in self.records]


def _lines(one: Spectra, line: np.ndarray, variance: np.ndarray, group: int, moved: np.ndarray) -> Lines:
    u, y = one.u, one.y
    mean_variance = np.maximum(variance / one.n_periods, rounding(y))
    weight = np.sqrt(2 / mean_variance[line])
    return Lines(one, u, y, line, u[line], y[line], weight, mean_variance, input_period(one, 1), group, moved)


def torque_power(error: np.ndarray, noise: np.ndarray, entry: np.ndarray) -> float:
    """Power of a white torque that makes the mean of error / (noise + power entry) 1; 0 if noise does.

    Parameters
    ----------
    error, noise, entry : (K,) ndarray
        Squared: error of the output, variance of the noise, response to a torque.
    """
    shown = entry > 0

    def excess(power: float) -> float:
        return float(np.mean(error[shown] / np.maximum(noise + power * entry, 1e-300)[shown])) - 1

    most = float(np.mean(error[shown] / entry[shown]))
    if most == 0 or excess(0.0) <= 0:
        return 0.0
    return float(brentq(excess, 0.0, 1.01 * most, rtol=1e-3))
