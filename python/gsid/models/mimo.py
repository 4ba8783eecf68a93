"""Models of several inputs and outputs that share their poles, and their uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gsid._lib import check, ffi, lib, version
from gsid.base.errors import InputError
from gsid.base.json_files import LARGEST, flag, how_fitted, moderate, number, text, texts
from gsid.base.model_file import FORMAT, read_model_file, write_model_file
from gsid.base.plottable import Plottable
from gsid.base.zero_order_hold import hold_factor
from gsid.models.confidence import NORMAL_95, root_quantities
from gsid.models.rational import RationalModel, half_of

if TYPE_CHECKING:
    import matplotlib.figure

    from gsid.response.mimo import MimoFrf


@dataclass(eq=False, repr=False)
class MimoModel(Plottable):
    """A matrix of transfer functions with one denominator, as a sum over its sections (MIM-1).

        G_ij = exp(-j w delay_ij) (sum of N_ijk(v) / S_k(v) + d_ij),   v = s, or z in domain "z"

    Parameters
    ----------
    sections : (n,) array_like
        q0 and q1 of each S_k = v^2 + q1 v + q0; the last one is v + q0 when n is odd. Together they are the
        denominator, of n poles.
    num : (n_y, n_u, n) or (n_y, n_u, n + 1) array_like
        b0 and b1 of each N_k = b1 v + b0, in the order of `sections`; then d, if there are as many zeros as
        poles.
    delay_s : (n_y, n_u) array_like
        Delays [s].
    domain : "s" or "z"
    hold : "zoh" or "none"
        "zoh": the inputs are held over each sample, and :meth:`response` is that of hold and model together.
    hold_assumed : bool
        True if the records of the fit do not state their hold; then `hold` is the likelier of the two.
    other_delay_s : (n_y, n_u) array_like or None
        Delays [s] of the same fit with the other hold. None if the hold is stated or that fit failed.
    fs_hz : float or None
        Sampling frequency [Hz]; needed in domain "z" and with a hold.
    cov : (p, p) array_like or None
        Covariance of (num, row by row of the matrix, sections, free delays).
    delay_of : (n_y, n_u) int array_like or None
        Index of the free delay of each channel; None if the delays were given.
    delay_range_s : (n_y, n_u, 2) array_like or None
        Least and largest delay [s] of the minima that the data do not reject (MIM-5); None: `delay_s` only.
    method, cost, cost_expected, n_lines, converged, band_hz
        Properties of the fit, as in `RationalModel`; costs are sums over all channels.
    inputs, outputs, u_units, y_units : list of str
        Names and units of the channels.
    """

    sections: np.ndarray
    num: np.ndarray
    delay_s: np.ndarray
    domain: str = "s"
    hold: str = "none"
    hold_assumed: bool = False
    other_delay_s: np.ndarray | None = None
    fs_hz: float | None = None
    cov: np.ndarray | None = None
    delay_of: np.ndarray | None = None
    delay_range_s: np.ndarray | None = None
    method: str | None = None
    cost: float | None = None
    cost_expected: float | None = None
    n_lines: int | None = None
    converged: bool | None = None
    band_hz: tuple[float, float] | None = None
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    u_units: list[str] = field(default_factory=list)
    y_units: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        for name in ("sections", "num", "delay_s"):
            values = np.asarray(getattr(self, name), dtype=float)
            if not np.all(np.isfinite(values)):
                raise ValueError(f"{name} must be finite")
            setattr(self, name, values)
        if self.num.ndim != 3 or self.num.shape[2] - self.n_poles not in (0, 1) or self.n_poles == 0:
            raise ValueError(
                f"num must have shape (n_y, n_u, n) or (n_y, n_u, n + 1), n >= 1 the length of sections, "
                f"got {self.num.shape} and n = {self.n_poles}"
            )
        if self.n_poles > lib.GSID_MIMO_POLES_MAX:
            raise ValueError(f"sections has {self.n_poles} poles; at most {lib.GSID_MIMO_POLES_MAX}")
        if self.delay_s.shape != self.num.shape[:2]:
            raise ValueError(f"delay_s must have shape {self.num.shape[:2]}, got {self.delay_s.shape}")
        if self.domain not in ("s", "z"):
            raise ValueError(f"domain must be 's' or 'z', got {self.domain!r}")
        if self.hold not in ("none", "zoh") or (
            self.hold == "zoh" and (self.domain == "z" or self.n_zeros >= self.n_poles)
        ):
            raise ValueError(f"hold {self.hold!r} needs domain 's' and one zero fewer than poles")
        if (self.domain == "z" or self.hold == "zoh") and not (self.fs_hz and self.fs_hz > 0):
            raise ValueError("fs_hz is needed in domain 'z' and with a hold")
        if self.delay_of is not None:
            self.delay_of = np.asarray(self.delay_of, dtype=int)
            n_delays = self.delay_s.size
            if self.delay_of.shape != self.delay_s.shape or not np.all(
                (self.delay_of >= 0) & (self.delay_of < n_delays)
            ):
                raise ValueError(f"delay_of must be indices from 0, in the shape {self.delay_s.shape}")
        if self.delay_range_s is None:
            self.delay_range_s = np.stack([self.delay_s, self.delay_s], axis=-1)
        self.delay_range_s = np.asarray(self.delay_range_s, dtype=float)
        if self.delay_range_s.shape != (*self.delay_s.shape, 2):
            raise ValueError(
                f"delay_range_s must have shape {(*self.delay_s.shape, 2)}, got {self.delay_range_s.shape}"
            )
        if self.cov is not None:
            self.cov = np.asarray(self.cov, dtype=float)
            if self.cov.shape != (self.n_parameters, self.n_parameters):
                raise ValueError(f"cov must have shape {(self.n_parameters,) * 2}, got {self.cov.shape}")
        self.inputs = list(self.inputs) or [f"u{j + 1}" for j in range(self.n_u)]
        self.outputs = list(self.outputs) or [f"y{i + 1}" for i in range(self.n_y)]
        self.u_units = list(self.u_units) or [""] * self.n_u
        self.y_units = list(self.y_units) or [""] * self.n_y
        names = (self.inputs, self.u_units, self.outputs, self.y_units)
        if [len(each) for each in names] != [self.n_u, self.n_u, self.n_y, self.n_y]:
            raise ValueError(f"the names and units do not match {self.n_y} x {self.n_u} responses: {names}")

    # ---- properties --------------------------------------------------------------------------------------

    @property
    def n_poles(self) -> int:
        """Number of poles."""
        return len(self.sections)

    @property
    def n_zeros(self) -> int:
        """Degree of the numerators."""
        return self.num.shape[2] - 1

    @property
    def n_y(self) -> int:
        """Number of outputs."""
        return self.num.shape[0]

    @property
    def n_u(self) -> int:
        """Number of inputs."""
        return self.num.shape[1]

    @property
    def n_parameters(self) -> int:
        """Free parameters: numerators, sections, and the delays that were estimated."""
        return self.num.size + self.n_poles + self._n_delays

    @property
    def _n_delays(self) -> int:
        return 0 if self.delay_of is None else int(self.delay_of.max()) + 1

    @property
    def poles(self) -> np.ndarray:
        """(n,) complex: rad/s in domain "s", z in domain "z"; two per section, in the order of `sections`."""
        roots = []
        for first in range(0, self.n_poles, 2):
            q0, q1 = self.sections[first], self.sections[first + 1 : first + 2]
            if len(q1) == 0:
                roots.append(-q0)
                continue
            half, rest = -q1[0] / 2, q1[0] ** 2 / 4 - q0
            if rest < 0:
                roots += [half + 1j * np.sqrt(-rest), half - 1j * np.sqrt(-rest)]
            else:  # avoids cancellation in the smaller root
                far = half + np.copysign(np.sqrt(rest), half)
                roots += [far, q0 / far if far != 0 else 0.0]
        return np.array(roots, dtype=complex)

    @property
    def stable(self) -> bool:
        """Whether all poles are stable."""
        return bool(np.all(self.poles.real < 0 if self.domain == "s" else np.abs(self.poles) < 1))

    def _channel(self, i: int, j: int) -> tuple[Any, list[np.ndarray]]:
        """The response from input j to output i for the C library, and the arrays that it points to."""
        kept = [np.ascontiguousarray(self.sections), np.ascontiguousarray(self.num[i, j])]
        c = ffi.new("gsid_mimo_channel *")
        c.domain = lib.GSID_DOMAIN_S if self.domain == "s" else lib.GSID_DOMAIN_Z
        c.rate = 1.0 if self.domain == "s" else 1.0 / self.fs_hz
        c.n_poles, c.direct, c.delay_s = self.n_poles, self.n_zeros == self.n_poles, self.delay_s[i, j]
        c.section, c.num = (ffi.from_buffer("double[]", values) for values in kept)
        return c, kept

    @staticmethod
    def _of_channel(what: str, i: int, j: int) -> str:
        return f"{what} from input {j} to output {i} at the given frequencies, of which one may lie on a pole"

    def _each_channel(self, f: np.ndarray, response_of: Callable[[Any, np.ndarray], int]) -> np.ndarray:
        """Responses at f, (F, n_y, n_u); `response_of` fills that of one channel and returns a status."""
        g = np.empty((self.n_y, self.n_u, len(f)), dtype=complex)
        for i, j in np.ndindex(self.n_y, self.n_u):
            c, _kept = self._channel(i, j)
            check(response_of(c, ffi.from_buffer("gsid_cplx[]", g[i, j])), self._of_channel("response", i, j))
        return np.moveaxis(g, -1, 0)

    def response(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Matrix of frequency responses, with the hold when `hold` is "zoh" (MIM-1, MOD-2).

        Parameters
        ----------
        f_hz : (F,) array_like
            Frequencies [Hz]; below fs/2 with a hold.

        Returns
        -------
        (F, n_y, n_u) complex ndarray, output unit per input unit.

        Raises
        ------
        GsidError
            A frequency lies on a pole.
        """
        if self.hold == "none":
            return self.behind_hold(f_hz)
        f = np.ascontiguousarray(np.atleast_1d(f_hz), dtype=float)
        f_c = ffi.from_buffer("double[]", f)
        return self._each_channel(
            f, lambda c, g: lib.gsid_mimo_hold_response(c, 1.0 / self.fs_hz, len(f), f_c, g)
        )

    def behind_hold(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Matrix of frequency responses without the hold (MIM-1).

        Parameters
        ----------
        f_hz : (F,) array_like
            Hz.

        Returns
        -------
        (F, n_y, n_u) complex ndarray

        Raises
        ------
        GsidError
            A frequency lies on a pole.
        """
        f = np.ascontiguousarray(np.atleast_1d(f_hz), dtype=float)
        f_c = ffi.from_buffer("double[]", f)
        return self._each_channel(f, lambda c, g: lib.gsid_mimo_response(c, len(f), f_c, g))

    def channel(self, i: int, j: int) -> RationalModel:
        """Response from input j to output i as a separate transfer function, without covariance.

        Raises
        ------
        ValueError
            More poles than a `RationalModel` can have.
        """
        if self.n_poles > lib.GSID_ORDER_MAX:
            raise ValueError(f"a RationalModel has at most {lib.GSID_ORDER_MAX} poles, got {self.n_poles}")
        factors = [
            np.concatenate([[1.0], self.sections[first : first + 2][::-1]])
            for first in range(0, self.n_poles, 2)
        ]
        den = _product(factors)
        num = np.zeros(len(den))
        for k in range(len(factors)):
            others = _product(factors[:k] + factors[k + 1 :])
            part = np.polymul(self.num[i, j, 2 * k : min(2 * k + 2, self.n_poles)][::-1], others)
            num[len(num) - len(part) :] += part
        if self.n_zeros == self.n_poles:
            num += self.num[i, j, -1] * den
        units = {"u_unit": self.u_units[j], "y_unit": self.y_units[i], "fs_hz": self.fs_hz}
        if self.domain == "s" and self.n_zeros < self.n_poles:
            num = num[1:]
        return RationalModel(num, den, self.delay_s[i, j], self.domain, hold=self.hold, **units)

    # ---- uncertainty -------------------------------------------------------------------------------------

    def _where(self, i: int, j: int) -> np.ndarray:
        """Indices in `cov` of the parameters of the response from input j to output i."""
        n_num, channel = self.num.shape[2], i * self.n_u + j
        places = [np.arange(channel * n_num, (channel + 1) * n_num), self.num.size + np.arange(self.n_poles)]
        if self.delay_of is not None:
            places.append([self.num.size + self.n_poles + self.delay_of[i, j]])
        return np.concatenate(places).astype(int)

    def gradient(self, f_hz: np.ndarray, i: int, j: int) -> np.ndarray:
        """Derivatives of one response, without hold, by its numerator, the sections, and its delay if free.

        Parameters
        ----------
        f_hz : (F,) ndarray
            Hz.
        i, j : int
            Output and input.

        Returns
        -------
        (F, m) complex ndarray

        Raises
        ------
        GsidError
            A frequency lies on a pole.
        """
        f = np.ascontiguousarray(np.atleast_1d(f_hz), dtype=float)
        n = self.num.shape[2] + self.n_poles
        gradient = np.empty((len(f), n + 1), dtype=complex)
        c, _kept = self._channel(i, j)
        arrays = ffi.from_buffer("double[]", f), ffi.from_buffer("gsid_cplx[]", gradient)
        check(
            lib.gsid_mimo_gradient(c, len(f), *arrays), self._of_channel("derivatives of the response", i, j)
        )
        return gradient if self.delay_of is not None else gradient[:, :n]

    def response_std(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Standard deviation of each complex response from the covariance of the parameters: sqrt(E|dG|^2).

        Parameters
        ----------
        f_hz : (F,) array_like
            Hz.

        Returns
        -------
        (F, n_y, n_u) ndarray, unit of the response. Zero for a model without covariance.
        """
        f = np.atleast_1d(np.asarray(f_hz, dtype=float))
        std = np.zeros((len(f), self.n_y, self.n_u))
        for i, j in np.ndindex(self.n_y, self.n_u) if self.cov is not None else ():
            x, where = self.gradient(f, i, j), self._where(i, j)
            variance = np.einsum("ka,ab,kb->k", x, self.cov[np.ix_(where, where)], x.conj(), optimize=True)
            std[:, i, j] = np.sqrt(np.maximum(variance.real, 0))
        return std * np.abs(hold_factor(f, self.fs_hz))[:, None, None] if self.hold == "zoh" else std

    def deviations(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Change of the responses by one standard deviation along each independent direction of `cov`.

        Parameters
        ----------
        f_hz : (F,) array_like
            Hz.

        Returns
        -------
        (F, n_y, n_u, r) complex ndarray, unit of the response. r is 0 for a model without covariance.
        """
        f = np.atleast_1d(np.asarray(f_hz, dtype=float))
        if self.cov is None:
            return np.zeros((len(f), self.n_y, self.n_u, 0), complex)
        half = half_of(self.cov)
        moved = np.empty((len(f), self.n_y, self.n_u, half.shape[1]), complex)
        for i, j in np.ndindex(self.n_y, self.n_u):
            moved[:, i, j] = self.gradient(f, i, j) @ half[self._where(i, j)]
        return moved * hold_factor(f, self.fs_hz)[:, None, None, None] if self.hold == "zoh" else moved

    @property
    def std_delay_s(self) -> np.ndarray:
        """(n_y, n_u) standard deviation of the delays [s]; 0 if they were given, nan without cov.

        It holds for one minimum only: see :attr:`ill_determined_delays`.
        """
        if self.delay_of is None:
            return np.zeros(self.delay_s.shape)
        return self._std()[self.num.size + self.n_poles + self.delay_of]

    @property
    def ill_determined_delays(self) -> np.ndarray:
        """(n_y, n_u) bool: whether the data accept several minima over the delay (MIM-5)."""
        return self.delay_range_s[..., 1] > self.delay_range_s[..., 0]

    @property
    def delay_interval_s(self) -> np.ndarray:
        """(n_y, n_u, 2) 95 % intervals of the delays [s], over all minima where they are ill-determined."""
        return self.delay_range_s + NORMAL_95 * self.std_delay_s[..., None] * [-1, 1]

    def _std(self) -> np.ndarray:
        if self.cov is None:
            return np.full(self.n_parameters, np.nan)
        return np.sqrt(np.maximum(np.diag(self.cov), 0))

    @property
    def std_num(self) -> np.ndarray:
        """Standard deviation of num, in its shape; nan without covariance."""
        return self._std()[: self.num.size].reshape(self.num.shape)

    @property
    def std_sections(self) -> np.ndarray:
        """(n,) standard deviation of the sections; nan without covariance."""
        return self._std()[self.num.size :][: self.n_poles]

    @property
    def modes(self) -> list[tuple[float, float, float, float]]:
        """Frequency [Hz], damping, and the standard deviations of both, of each real pole or pole pair."""
        found = [
            root_quantities(pole, cov, domain=self.domain, fs_hz=self.fs_hz)
            for pole, cov in zip(self.poles, self.pole_cov, strict=True)
            if pole.imag >= 0
        ]
        return sorted(found)

    @property
    def pole_cov(self) -> np.ndarray:
        """(n, 2, 2) covariance of each pole's (real, imaginary) part; nan without covariance."""
        if self.cov is None:
            return np.full((self.n_poles, 2, 2), np.nan)
        first = self.num.size + 2 * (np.arange(self.n_poles) // 2)
        covariances = []
        for k, pole in enumerate(self.poles):
            is_pair = 2 * (k // 2) + 1 < self.n_poles
            q1 = self.sections[2 * (k // 2) + 1] if is_pair else np.nan
            by = -np.array([1, pole]) / (2 * pole + q1) if is_pair else np.array([-1.0 + 0j])
            parts = np.stack([by.real, by.imag])
            where = slice(first[k], first[k] + len(by))
            covariances.append(parts @ self.cov[where, where] @ parts.T)
        return np.array(covariances)

    @property
    def delay_hold_uncertainty_s(self) -> np.ndarray | None:
        """Difference of each delay between the two holds [s], (n_y, n_u); None if the hold is stated."""
        return None if self.other_delay_s is None else np.abs(self.delay_s - np.asarray(self.other_delay_s))

    # ---- files and pictures ------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The model as the JSON of a model file."""
        common = {
            "domain": self.domain,
            "hold": self.hold,
            "hold_assumed": self.hold_assumed,
            "other_delay_s": None if self.other_delay_s is None else np.asarray(self.other_delay_s).tolist(),
            "sections": self.sections.tolist(),
            "num": self.num.tolist(),
            "delay_s": self.delay_s.tolist(),
            "delay_range_s": self.delay_range_s.tolist(),
            "delay_of": None if self.delay_of is None else self.delay_of.tolist(),
            "covariance": None if self.cov is None else self.cov.tolist(),
        }
        fit = {name: getattr(self, name) for name in _FIT_KEYS}
        return {
            "gsid_model": FORMAT,
            "made_by": f"gsid {version()}",
            "fs_hz": self.fs_hz,
            "inputs": self.inputs,
            "outputs": self.outputs,
            "u_units": self.u_units,
            "y_units": self.y_units,
            "common_denominator": common,
            "fit": fit | {"band_hz": None if self.band_hz is None else list(self.band_hz)},
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any], where: str = "") -> MimoModel:
        """Make a model from the JSON of a model file.

        Raises
        ------
        InputError
            Something is missing or has the wrong form.
        """
        hint = "write it again by `gsid fit -o` with several inputs"
        if not isinstance(data, dict) or "common_denominator" not in data:
            raise InputError("not a model of several inputs and outputs", where, None, hint)
        common = data["common_denominator"]
        try:
            return cls(
                **{name: moderate(common[name], name) for name in ("sections", "num", "delay_s")},
                domain=text(common, "domain", "s"),
                hold=text(common, "hold", "none"),
                hold_assumed=flag(common, "hold_assumed"),
                other_delay_s=common.get("other_delay_s"),
                fs_hz=number(data, "fs_hz"),
                cov=moderate(common.get("covariance"), "covariance", LARGEST**2),
                delay_of=common.get("delay_of"),
                delay_range_s=moderate(common.get("delay_range_s"), "delay_range_s"),
                **{name: texts(data, name) for name in ("inputs", "outputs", "u_units", "y_units")},
                **how_fitted(data),
            )
        except KeyError as error:
            raise InputError("a key is missing in the model file", where, error.args[0], hint) from error
        except (AttributeError, IndexError, TypeError, ValueError) as error:
            raise InputError(f"the model file is not usable: {error}", where, None, hint) from error

    def save(self, path: str | Path) -> None:
        """Write a model file (.json). An existing file is replaced atomically."""
        write_model_file(path, self.to_dict())

    @classmethod
    def load(cls, path: str | Path) -> MimoModel:
        """Read a model file.

        Raises
        ------
        InputError
            The file cannot be read, is not JSON, or is not a model of several inputs and outputs.
        """
        return cls.from_dict(read_model_file(path), str(path))

    def plot(self, frf: MimoFrf | None = None) -> matplotlib.figure.Figure:
        """Bode diagram of each response with 95 % bands, over the measured responses if they are given."""
        return self._figure(frf)

    def __repr__(self) -> str:
        lines = [
            f"MimoModel {self.n_y} x {self.n_u}, {self.n_poles} common poles, {self.n_zeros} zeros, "
            f"in {self.domain}{'' if self.stable else ', UNSTABLE'}",
            f"  inputs   {', '.join(self.inputs)}",
            f"  outputs  {', '.join(self.outputs)}",
            f"  delays   {1e3 * self.delay_s.min():.4g} .. {1e3 * self.delay_s.max():.4g} ms",
        ]
        if self.cost is not None:
            lines.append(f"  {self.method}: cost {self.cost:.5g} over {self.n_lines} lines")
        return "\n".join(lines)


_FIT_KEYS = ("method", "cost", "cost_expected", "n_lines", "converged")


def _product(factors: list[np.ndarray]) -> np.ndarray:
    product = np.ones(1)
    for factor in factors:
        product = np.polymul(product, factor)
    return product
