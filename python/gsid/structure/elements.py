"""Structures of physical elements, and their response (STR-1).

    G = exp(-s T) hold(s) s^-q / prod(1 + tau_j s) [g_0 B + sum g_i s / (s^2 + 2 z_i w_i s + w_i^2) + g_R s]

B is the rigid body from torque to rate: 1/s free, 1/(s + c) viscous, s/(s^2 + c s + k) sprung. q is -1 where
the output is the acceleration, 0 for the rate, 1 for the angle. g_R stands for the modes above the band.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.cached import cached_property
from gsid.base.zero_order_hold import hold_factor

OUTPUTS = ("rate", "angle", "acceleration")
BODIES = ("free", "viscous", "sprung")
INTEGRATIONS = {"acceleration": -1, "rate": 0, "angle": 1}


@dataclass(frozen=True)
class Structure:
    """Which elements an axis has.

    Parameters
    ----------
    output : {"rate", "angle", "acceleration"}
    body : {"free", "viscous", "sprung"}
    n_modes, n_lags : int
    residual : bool
        Whether modes above the band contribute (g_R).
    """

    output: str
    body: str
    n_modes: int
    n_lags: int
    residual: bool

    @property
    def n_body(self) -> int:
        """Parameters of the body beside its gain: rate, stiffness."""
        return BODIES.index(self.body)

    @property
    def n_columns(self) -> int:
        """Gains, in which the response is linear."""
        return 1 + self.n_modes + self.residual

    @property
    def n_nonlinear(self) -> int:
        """Parameters in which it is not: body, frequency and damping of modes, lags, delay."""
        return self.n_body + 2 * self.n_modes + self.n_lags + 1

    @property
    def n_parameters(self) -> int:
        """All parameters."""
        return self.n_columns + self.n_nonlinear

    @property
    def order(self) -> tuple[int, int]:
        """Poles and zeros of the transfer function."""
        q = INTEGRATIONS[self.output]
        body = 2 if self.body == "sprung" else 1 + max(q, 0)
        if self.body == "free":
            body = 1 + q
        poles = body + 2 * self.n_modes + self.n_lags
        excess = (-1 if self.residual else 1) + q + self.n_lags
        return poles, poles - excess

    @cached_property
    def c(self):
        """The structure as the C library takes it."""
        q = INTEGRATIONS[self.output]
        return ffi.new("gsid_structure *", [q, self.n_body, self.n_modes, self.n_lags, self.residual])

    def text(self) -> str:
        """The structure in words, for tables and messages."""
        parts = [self.output, f"{self.body} body"]
        for n, what in ((self.n_modes, "mode"), (self.n_lags, "lag")):
            if n:
                parts.append(f"{n} {what}{'s' * (n > 1)}")
        return ", ".join([*parts, *(["modes above the band"] if self.residual else [])])


@dataclass(frozen=True, eq=False)
class Values:
    """Nonlinear parameters of a structure: positive ones as logarithms.

    Parameters
    ----------
    structure : Structure
    theta : (n_nonlinear,) ndarray
        ln rate [1/s], ln stiffness [1/s^2] of the body; ln w [rad/s], ln z of each mode; ln tau [s] of each
        lag; delay [s].
    """

    structure: Structure
    theta: np.ndarray

    @property
    def rate(self) -> float:
        """Viscous friction [1/s]; 0 where the body has none."""
        return float(np.exp(self.theta[0])) if self.structure.n_body else 0.0

    @property
    def stiffness(self) -> float:
        """Spring [1/s^2]; 0 where the body has none."""
        return float(np.exp(self.theta[1])) if self.structure.n_body == 2 else 0.0

    @property
    def modes(self) -> np.ndarray:
        """(n_modes, 2): angular frequency [rad/s] and damping ratio."""
        first = self.structure.n_body
        return np.exp(self.theta[first : first + 2 * self.structure.n_modes]).reshape(-1, 2)

    @property
    def lags(self) -> np.ndarray:
        """(n_lags,) time constants [s]."""
        first = self.structure.n_body + 2 * self.structure.n_modes
        return np.exp(self.theta[first : first + self.structure.n_lags])

    @property
    def delay_s(self) -> float:
        """Delay [s]."""
        return float(self.theta[-1])

    @classmethod
    def of(
        cls,
        output: str,
        body: tuple[float, ...],
        modes: list[tuple[float, float]],
        lags: list[float],
        delay_s: float,
        residual: bool,
    ) -> Values:
        """Make values from numbers.

        Parameters
        ----------
        output : str
        body : tuple of float
            (), (rate,) or (rate, stiffness).
        modes : list of (w, z)
            rad/s and damping ratio.
        lags : list of float
            s.
        delay_s : float
        residual : bool
        """
        structure = Structure(output, BODIES[len(body)], len(modes), len(lags), residual)
        positive = [*body, *(x for mode in modes for x in mode), *lags]
        return cls(structure, np.array([*np.log(positive), delay_s]))

    def numbers(self) -> dict:
        """The arguments of :meth:`of`."""
        body = (self.rate, self.stiffness)[: self.structure.n_body]
        return {
            "output": self.structure.output,
            "body": body,
            "modes": [(float(w), float(z)) for w, z in self.modes],
            "lags": [float(tau) for tau in self.lags],
            "delay_s": self.delay_s,
            "residual": self.structure.residual,
        }

    def relabelled(self, zeta_max: float) -> Values:
        """The same function with an overdamped mode as the sprung body and the body as a mode.

        A body and a mode are the same term: a refinement may exchange them.

        Parameters
        ----------
        zeta_max : float
            Damping ratio up to which a pole pair is a mode.
        """
        numbers = self.numbers()
        damped = [i for i, (_, z) in enumerate(numbers["modes"]) if z > zeta_max]
        w_body = np.sqrt(self.stiffness)
        if not damped or self.structure.body != "sprung" or self.rate > 2 * zeta_max * w_body:
            return self
        w, z = numbers["modes"][damped[0]]
        numbers["modes"][damped[0]] = (float(w_body), float(self.rate / (2 * w_body)))
        return Values.of(**{**numbers, "body": (2 * z * w, w**2)})


@dataclass(eq=False)
class Lines:
    """Frequencies at which a structure is evaluated.

    Parameters
    ----------
    f_hz : (F,) ndarray
        Hz, above 0.
    fs_hz : float
    held : bool
        Whether the command is held over each sample.
    images : bool
        Whether the images of the hold are evaluated.
    fractions : list of (float, (F,) complex ndarray), optional
        Of a sensor that is refreshed between samples: `gsid.response.sample_hold.lag_fractions`.
    torque : (F,) complex ndarray, optional
        Torque along the measured motion over the command: adds a column (STR-6).
    """

    f_hz: np.ndarray
    fs_hz: float
    held: bool
    images: bool = True
    fractions: list[tuple[float, np.ndarray]] | None = None
    torque: np.ndarray | None = None

    def __post_init__(self) -> None:
        self.w = 2 * np.pi * self.f_hz
        self.s = 1j * self.w
        self.hold = hold_factor(self.f_hz, self.fs_hz) if self.held else np.ones(len(self.w), complex)
        fractions = self.fractions or []
        self._later = np.array([part for part, _ in fractions], float)
        self._share = np.array([share for _, share in fractions], complex)
        torque = None if self.torque is None else np.ascontiguousarray(self.torque, complex)
        self.c = ffi.new(
            "gsid_structure_lines *",
            {
                "n": len(self.w),
                "w": ffi.from_buffer("double[]", self.w),
                "hold": ffi.from_buffer("gsid_cplx[]", self.hold),
                "sample_s": 1 / self.fs_hz,
                "has_images": self.held and self.images,
                "n_fractions": len(fractions),
                "later": ffi.from_buffer("double[]", self._later),
                "share": ffi.from_buffer("gsid_cplx[]", self._share),
                "torque": ffi.NULL if torque is None else ffi.from_buffer("gsid_cplx[]", torque),
            },
        )
        self._torque = torque  # keeps its memory

    def n_columns(self, structure: Structure) -> int:
        """Columns of a structure at these lines, with that of the torque.

        Parameters
        ----------
        structure : Structure
        """
        return structure.n_columns + (self.torque is not None)


def columns(values: Values, lines: Lines) -> np.ndarray:
    """Response of each gain: body, modes, residual term, torque along the motion, (F, n_columns) complex.

    Parameters
    ----------
    values : Values
    lines : Lines
    """
    found = np.empty((lines.n_columns(values.structure), len(lines.w)), complex)
    theta = ffi.from_buffer("double[]", np.ascontiguousarray(values.theta))
    status = lib.gsid_structure_columns(
        values.structure.c, lines.c, theta, ffi.from_buffer("gsid_cplx[]", found)
    )
    check(status, "response of a structure")
    return found.T


def delay_and_lags(values: Values, lines: Lines) -> np.ndarray:
    """What all columns share: delay, hold, integration and lags, (F,) complex.

    Parameters
    ----------
    values : Values
    lines : Lines
    """
    s = lines.s
    common = np.exp(-s * values.delay_s) * lines.hold * s ** -INTEGRATIONS[values.structure.output]
    for tau in values.lags:
        common = common / (1 + tau * s)
    return common
