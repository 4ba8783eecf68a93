"""A simulated gimbal of four axes with inertial, gyroscopic and kinematic coupling.

Four rigid bodies follow each other on revolute joints: roll (x), outer elevation (y), inner azimuth (z) and
inner elevation (y), the order of the thesis (eq. 2.1). All axes meet in one point, the centre of mass of each
body, so that gravity has no torque. The base stands still. A motor turns each body against the one before it;
each gyro measures the inertial rate of its body about its joint (GIM-1, GIM-2).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm

from gsid.base.errors import InputError, choose
from gsid.records.csv import read_columns
from gsid.records.mimo import MimoRecord

AXES = ("roll", "outer_elevation", "inner_azimuth", "inner_elevation")
N_AXES = len(AXES)
JOINTS = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0]])  # in the body's own frame
CROSS = np.cross(np.eye(3)[None], JOINTS[:, None])  # v @ CROSS[i] is v x JOINTS[i]
NEXT = (1, 2, 0)  # a turn about axis k mixes the coordinates NEXT[k] and NEXT[NEXT[k]]
CHANNELS_U = [f"u{i + 1}" for i in range(N_AXES)]
CHANNELS_Y = [f"y{i + 1}" for i in range(N_AXES)]
FARTHEST_DEG = 1e4  # an angle beyond this means that the integration diverged

# Principal moments and products of inertia of each body [kg m^2]: xx, yy, zz, xy, xz, yz.
_INERTIA = (
    (0.90, 0.80, 0.80, 0.010, -0.020, 0.010),
    (0.35, 0.40, 0.35, 0.008, 0.006, -0.010),
    (0.06, 0.06, 0.07, 0.002, -0.003, 0.002),
    (0.03, 0.04, 0.04, -0.001, 0.002, 0.001),
)


@dataclass(frozen=True)
class Gimbal:
    """Simulated gimbal of four axes; each value is a sequence in the order of `AXES`.

    Attributes
    ----------
    inertia_kg_m2 : sequence of 6 numbers each
        xx, yy, zz, xy, xz, yz of each body about its centre of mass.
    viscous_nm_s : sequence of float
        Viscous friction of each joint [N m s/rad].
    stiffness_nm : sequence of float
        Stiffness of the cables about the working position [N m/rad].
    friction_nm : sequence of float
        Dry friction of each joint [N m]: friction tanh(rate / friction_rate_deg_s).
    friction_rate_deg_s : float
        Rate within which dry friction changes its sign [deg/s].
    angle_deg : sequence of float
        Working position [deg].
    noise_deg_s : sequence of float
        Rms noise of each gyro [deg/s].
    fs_hz : float
        Commands and samples per second [Hz].
    seed : int
        Seed of the noise.
    """

    inertia_kg_m2: Sequence[Sequence[float]] = _INERTIA
    viscous_nm_s: Sequence[float] = (6.0, 4.0, 0.8, 0.4)
    stiffness_nm: Sequence[float] = (0.0, 400.0, 200.0, 150.0)
    friction_nm: Sequence[float] = (0.0, 0.0, 0.0, 0.0)
    friction_rate_deg_s: float = 0.2
    angle_deg: Sequence[float] = (10.0, -30.0, 2.0, 3.0)
    noise_deg_s: Sequence[float] = (0.05, 0.05, 0.05, 0.05)
    fs_hz: float = 500.0
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("viscous_nm_s", "stiffness_nm", "friction_nm", "angle_deg", "noise_deg_s"):
            values = np.asarray(getattr(self, name), float)
            if values.shape != (N_AXES,) or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} must be {N_AXES} finite numbers, one for each axis, not {values}")
            if name != "angle_deg" and np.any(values < 0):
                raise ValueError(f"{name} must not be negative, got {values.tolist()}")
        for name in ("fs_hz", "friction_rate_deg_s"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be a positive number, not {getattr(self, name)}")
        inertia = np.asarray(self.inertia_kg_m2, float)
        if inertia.shape != (N_AXES, 6) or not np.all(np.isfinite(inertia)):
            raise ValueError(f"inertia_kg_m2 must be {N_AXES} rows of 6 finite numbers, not {inertia.shape}")
        if np.any(np.linalg.eigvalsh(self._tensors) <= 0):
            raise ValueError("inertia_kg_m2: the tensor of each body must be positive definite")

    @property
    def _tensors(self) -> np.ndarray:
        """(4, 3, 3) tensors of inertia."""
        xx, yy, zz, xy, xz, yz = np.asarray(self.inertia_kg_m2, float).T
        return np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), -1, 0)

    # ---- mechanics ---------------------------------------------------------------------------------------

    def jacobians(self, angle: np.ndarray) -> list[np.ndarray]:
        """Angular velocity of each body over the joint rates, in the frame of the body.  Eq: GIM-1

        Parameters
        ----------
        angle : (..., 4) ndarray
            rad.

        Returns
        -------
        list of (..., 3, 4) ndarrays
        """
        found, jacobian = [], np.zeros((*angle.shape[:-1], 3, N_AXES))
        for i, joint in enumerate(JOINTS):
            jacobian = _turned(jacobian, angle[..., i, None], int(np.argmax(joint)))
            jacobian[..., i] += joint
            found.append(jacobian)
        return found

    def mass_matrix(self, angle: np.ndarray) -> np.ndarray:
        """Matrix of inertia, (..., 4, 4) [kg m^2], at angles (..., 4) [rad].  Eq: GIM-1"""
        pairs = zip(self.jacobians(angle), self._tensors, strict=True)
        return sum(np.swapaxes(j, -1, -2) @ tensor @ j for j, tensor in pairs)

    def acceleration(self, angle: np.ndarray, rate: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Joint accelerations (..., 4) [rad/s^2].  Eq: GIM-1

        Parameters
        ----------
        angle, rate : (..., 4) ndarray
            rad and rad/s.
        torque : (..., 4) ndarray
            Torques of the motors [N m].
        """
        mass: np.ndarray | float = 0.0
        gyroscopic: np.ndarray | float = 0.0
        columns = np.zeros((*angle.shape[:-1], 3, N_AXES + 1))  # Jacobian, and acceleration at constant rates
        for i, (joint, tensor) in enumerate(zip(JOINTS, self._tensors, strict=True)):
            columns = _turned(columns, angle[..., i, None], int(np.argmax(joint)))
            columns[..., i] += joint
            jacobian = columns[..., :N_AXES]
            spin = (jacobian @ rate[..., None])[..., 0]
            columns[..., N_AXES] += spin @ CROSS[i] * rate[..., i, None]
            moment = columns[..., N_AXES] @ tensor + _cross(spin, spin @ tensor)
            transposed = np.swapaxes(jacobian, -1, -2)
            mass = mass + transposed @ tensor @ jacobian
            gyroscopic = gyroscopic + (transposed @ moment[..., None])[..., 0]
        rest = torque - gyroscopic - self._passive(angle, rate)
        return np.linalg.solve(mass, rest[..., None])[..., 0]

    def _passive(self, angle: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Torques of friction and springs against the motion [N m]."""
        passive = rate * self.viscous_nm_s + (angle - np.radians(self.angle_deg)) * self.stiffness_nm
        if np.any(self.friction_nm):
            passive = passive + self.friction_nm * np.tanh(rate / np.radians(self.friction_rate_deg_s))
        return passive

    def gyros(self, angle: np.ndarray) -> np.ndarray:
        """What the gyros measure over the joint rates, (..., 4, 4): the kinematic coupling.  Eq: GIM-2"""
        rows = [joint @ jacobian for joint, jacobian in zip(JOINTS, self.jacobians(angle), strict=True)]
        return np.stack(rows, axis=-2)

    # ---- measurement -------------------------------------------------------------------------------------

    def simulate(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Move from rest at the working position; several experiments run side by side.

        Parameters
        ----------
        u : (..., n, 4) array_like
            Torques of the motors [N m], held over each tick.

        Returns
        -------
        y : (..., n, 4) ndarray
            Rates at the gyros without noise [deg/s], at the instant from which the torque is applied.
        angle_deg : (..., n, 4) ndarray
            Joint angles [deg].

        Raises
        ------
        InputError
            The angles diverge: the torques are too large for the integration at this rate.
        """
        u = np.asarray(u, float)
        if u.ndim < 2 or u.shape[-1] != N_AXES or not np.all(np.isfinite(u)):
            raise ValueError(f"u must be finite, with {N_AXES} columns, not of shape {u.shape}")
        angle = np.broadcast_to(np.radians(self.angle_deg), (*u.shape[:-2], N_AXES)).copy()
        rate = np.zeros_like(angle)
        angles, rates = np.empty_like(u), np.empty_like(u)
        for n in range(u.shape[-2]):
            angles[..., n, :], rates[..., n, :] = angle, rate
            angle, rate = self._step(angle, rate, u[..., n, :])
            if not np.all(np.abs(angle) < np.radians(FARTHEST_DEG)):
                hint = "lower the torques, or raise the sample rate"
                raise InputError("the simulated gimbal diverges", f"tick {n}", None, hint)
        y = (self.gyros(angles) @ rates[..., None])[..., 0]
        return np.degrees(y), np.degrees(angles)

    def _step(self, angle: np.ndarray, rate: np.ndarray, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One tick, by the classical Runge-Kutta method of order 4."""
        h = 1.0 / self.fs_hz
        a1 = self.acceleration(angle, rate, torque)
        r2 = rate + h / 2 * a1
        a2 = self.acceleration(angle + h / 2 * rate, r2, torque)
        r3 = rate + h / 2 * a2
        a3 = self.acceleration(angle + h / 2 * r2, r3, torque)
        r4 = rate + h * a3
        a4 = self.acceleration(angle + h * r3, r4, torque)
        return angle + h / 6 * (rate + 2 * r2 + 2 * r3 + r4), rate + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)

    def measure(self, periods: np.ndarray, n_periods: int, n_settle: int = 2) -> list[MimoRecord]:
        """Records of periodic torques, with the noise of the gyros.

        Parameters
        ----------
        periods : (E, N, 4) array_like
            One period of each experiment [N m].
        n_periods, n_settle : int
            Periods to measure, and periods before them in which the motion settles.

        Returns
        -------
        list of MimoRecord
            One for each experiment, with independent noise.

        Raises
        ------
        ValueError
            Fewer than 2 periods to measure, which have no scatter.
        InputError
            As `simulate`.
        """
        if n_periods < 2 or n_settle < 0:
            raise ValueError(f"measure at least 2 periods after settling, not {n_periods} after {n_settle}")
        periods = np.asarray(periods, float)
        u = np.tile(periods, (1, n_settle + n_periods, 1))
        y, _ = self.simulate(u)
        y = y + np.random.default_rng(self.seed).standard_normal(y.shape) * self.noise_deg_s
        n = periods.shape[1]
        how: dict[str, Any] = {"period_samples": n, "settle_samples": n_settle * n, "hold": "zoh"}
        how |= {"u_units": ["N m"] * N_AXES, "y_units": ["deg/s"] * N_AXES}
        how |= {"inputs": CHANNELS_U, "outputs": CHANNELS_Y}
        return [MimoRecord(*one, self.fs_hz, **how) for one in zip(u, y, strict=True)]

    # ---- truth -------------------------------------------------------------------------------------------

    def linear_response(self, f_hz: np.ndarray) -> np.ndarray:
        """Response to small held torques about the working position, without dry friction.  Eq: GIM-3

        Parameters
        ----------
        f_hz : (F,) array_like
            Hz, above 0.

        Returns
        -------
        (F, 4, 4) complex ndarray
            deg/s over N m, outputs by inputs.

        Raises
        ------
        ValueError
            A frequency is not above 0, where an axis without a spring has no response.
        """
        if not np.all(np.asarray(f_hz) > 0):
            raise ValueError("the frequencies must be above 0 Hz")
        angle = np.radians(self.angle_deg)
        inverse, zero = np.linalg.inv(self.mass_matrix(angle)), np.zeros((N_AXES, N_AXES))
        a = np.block(
            [[zero, np.eye(N_AXES)], [-inverse * self.stiffness_nm, -inverse * np.asarray(self.viscous_nm_s)]]
        )
        b = np.vstack([zero, inverse])
        whole = expm(np.block([[a, b], [np.zeros((N_AXES, 3 * N_AXES))]]) / self.fs_hz)
        held, driven = whole[: 2 * N_AXES, : 2 * N_AXES], whole[: 2 * N_AXES, 2 * N_AXES :]
        z = np.exp(2j * np.pi * np.atleast_1d(f_hz) / self.fs_hz)
        state = np.linalg.solve(z[:, None, None] * np.eye(2 * N_AXES) - held, driven)
        return np.rad2deg(1.0) * self.gyros(angle) @ state[:, N_AXES:]

    def truth(self) -> dict[str, Any]:
        """Parameters, and matrices of the linear equations at the working position, for a JSON file."""
        angle = np.radians(self.angle_deg)
        parameters = {name: np.asarray(value).tolist() for name, value in asdict(self).items()}
        mass, gyros = self.mass_matrix(angle).tolist(), self.gyros(angle).tolist()
        return {"axes": list(AXES), "parameters": parameters, "mass_kg_m2": mass, "gyros": gyros}


def read_periods(paths: Sequence[str | os.PathLike]) -> tuple[np.ndarray, float]:
    """Read one period of each experiment from CSV files with the columns u1 .. u4.

    Parameters
    ----------
    paths : sequence of path_like

    Returns
    -------
    (E, N, 4) ndarray
        N m.
    float
        Sample rate [Hz].

    Raises
    ------
    InputError
        A file cannot be read, has no sample rate, or differs from the first in rate or length.
    """
    periods, rates = [], []
    for path in map(Path, paths):
        columns, keys = read_columns(path, CHANNELS_U)
        try:
            rates.append(float(str(keys["fs_hz"])))
        except (KeyError, ValueError):
            hint = "write `# fs_hz: HZ` above the names of the columns"
            raise InputError("the file states no sample rate", str(path), None, hint) from None
        periods.append(np.column_stack([columns[name] for name in CHANNELS_U]))
        if not np.all(np.isfinite(periods[-1])):
            raise InputError("a command is not a finite number", str(path), None, "repair the row")
        if rates[-1] != rates[0] or len(periods[-1]) != len(periods[0]):
            size = f"{len(periods[-1])} samples at {rates[-1]:g} Hz"
            raise InputError("the experiments differ in rate or length", str(path), size)
    return np.array(periods), rates[0]


def by_axis(values: Mapping[str, float], default: Sequence[float]) -> tuple[float, ...]:
    """Values for each axis, of which some are given by name.

    Raises
    ------
    ValueError
        No such axis.
    """
    for name in values:
        if name not in AXES:
            raise ValueError(f"no axis {name}; {choose(name, AXES)}")
    return tuple(values.get(axis, own) for axis, own in zip(AXES, default, strict=True))


def _turned(vectors: np.ndarray, angle: np.ndarray, axis: int) -> np.ndarray:
    """Columns of (..., 3, m) in the frame that is turned by (..., 1) about a coordinate axis."""
    p, q = NEXT[axis], NEXT[NEXT[axis]]
    cos, sin = np.cos(angle), np.sin(angle)
    turned = vectors.copy()
    turned[..., p, :] = cos * vectors[..., p, :] + sin * vectors[..., q, :]
    turned[..., q, :] = cos * vectors[..., q, :] - sin * vectors[..., p, :]
    return turned


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product over the last axis; np.cross takes ten times as long for few vectors."""
    p, q = [1, 2, 0], [2, 0, 1]
    return a[..., p] * b[..., q] - a[..., q] * b[..., p]
