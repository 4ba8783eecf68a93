"""Rational transfer functions with delay and their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gsid._lib import check, ffi, lib, version
from gsid.base.errors import InputError
from gsid.base.json_files import LARGEST, flag, how_fitted, listed, moderate, number, text
from gsid.base.model_file import FORMAT, read_model_file, write_model_file
from gsid.base.plottable import Plottable
from gsid.base.tables import Table, paragraphs
from gsid.base.zero_order_hold import hold_factor
from gsid.models.fit_warning import FitWarning
from gsid.models.polynomial import roots_of
from gsid.response.frf import Frf, check_response

if TYPE_CHECKING:
    import control
    import matplotlib.figure
    from scipy import signal


@dataclass(eq=False, repr=False)
class RationalModel(Plottable):
    """A rational transfer function with delay: G = exp(-j w delay) num/den (thesis, eqs. 6.4 and 6.5; MOD-1).

    Parameters
    ----------
    num : (m + 1,) array_like
        Numerator. Domain "s": highest power of s first. Domain "z": coefficients of 1, z^-1, z^-2, ...
    den : (n + 1,) array_like
        Denominator in the same order; den[0] = 1.
    delay_s : float
        Delay [s], any fraction of a sample.
    domain : "s" or "z"
    fs_hz : float or None
        Sampling frequency [Hz]; needed in domain "z" and with a hold.
    hold : "zoh" or "none"
        "zoh": the input is held over each sample, and :meth:`response` is that of hold and model together.
    hold_assumed : bool
        True if the records of the fit do not state their hold; then `hold` is the likelier of the two.
    other_delay_s : float or None
        Delay [s] of the same fit with the other hold. None if the hold is stated or that fit failed.
    cov : (p, p) array_like or None
        Covariance of (den[1:], num, delay if free), in the units of those numbers.
        Where the errors of the fit exceed the noise it is that of the errors left (STR-5).
    cov_noise : (p, p) array_like or None
        Covariance from the noise alone where `cov` is that of the errors left, else None.
    undetermined : tuple of int
        Indices in `cov` of parameters that the data do not determine: their standard deviation is infinite.
    free_delay : bool
        Whether the delay was estimated. If so, `cov` includes it.
    method, cost, cost_expected, n_lines, converged, band_hz
        Properties of the fit; None for a model that was not fitted. `cost` is V of eq. 7.28, and
        `cost_expected` is its mean if only what the weights contain remains.
    weights : "noise" or "total"
        Variance that weighted the lines: of the noise, or of noise and distortion.
    warnings : tuple of FitWarning
        Reasons why the confidence intervals of the fit are not valid, and what to use instead.
    u_unit, y_unit : str
        Units of input and output.
    """

    num: np.ndarray
    den: np.ndarray
    delay_s: float = 0.0
    domain: str = "s"
    fs_hz: float | None = None
    hold: str = "none"
    hold_assumed: bool = False
    other_delay_s: float | None = None
    cov: np.ndarray | None = None
    cov_noise: np.ndarray | None = None
    undetermined: tuple[int, ...] = ()
    free_delay: bool = False
    method: str | None = None
    cost: float | None = None
    cost_expected: float | None = None
    n_lines: int | None = None
    converged: bool | None = None
    band_hz: tuple[float, float] | None = None
    weights: str = "noise"
    warnings: tuple[FitWarning, ...] = ()
    u_unit: str = ""
    y_unit: str = ""

    def __post_init__(self) -> None:
        self.num = np.atleast_1d(np.asarray(self.num, dtype=float))
        self.den = np.atleast_1d(np.asarray(self.den, dtype=float))
        for name, values in (("num", self.num), ("den", self.den)):
            if values.ndim != 1 or not np.all(np.isfinite(values)):
                raise ValueError(f"{name} must be a row of finite numbers, got {values!r}")
            if len(values) > lib.GSID_ORDER_MAX + 1:
                raise ValueError(f"{name} has degree {len(values) - 1}; at most {lib.GSID_ORDER_MAX}")
        if self.den[0] == 0:
            raise ValueError("den[0] must not be zero")
        if self.domain not in ("s", "z"):
            raise ValueError(f"domain must be 's' or 'z', got {self.domain!r}")
        if self.hold not in ("none", "zoh"):
            raise ValueError(f"hold must be 'none' or 'zoh', got {self.hold!r}")
        if (self.domain == "z" or self.hold == "zoh") and not (self.fs_hz and self.fs_hz > 0):
            raise ValueError("fs_hz is needed in domain 'z' and with a hold")
        if self.domain == "z" and self.hold == "zoh":
            raise ValueError("a model in z already includes the hold: hold must be 'none'")
        with np.errstate(over="ignore"):
            self.num, self.den = self.num / self.den[0], self.den / self.den[0]
        if not (np.all(np.isfinite(self.num)) and np.all(np.isfinite(self.den))):
            raise ValueError("den[0] is too small: the other coefficients divided by it are not finite")
        self.delay_s = float(self.delay_s)
        if not np.isfinite(self.delay_s):
            raise ValueError(f"delay_s must be a finite number of seconds, got {self.delay_s}")
        p = self.n_parameters
        for name in ("cov", "cov_noise"):
            cov = getattr(self, name)
            if cov is not None:
                setattr(self, name, np.asarray(cov, dtype=float))
                if getattr(self, name).shape != (p, p):
                    raise ValueError(f"{name} must have shape {(p, p)}, got {getattr(self, name).shape}")
        self.undetermined = tuple(self.undetermined)
        if not all(type(i) is int and 0 <= i < p for i in self.undetermined):
            raise ValueError(f"undetermined must be indices of parameters, got {self.undetermined!r}")
        if self.weights not in ("noise", "total"):
            raise ValueError(f"weights must be 'noise' or 'total', got {self.weights!r}")

    # ---- properties --------------------------------------------------------------------------------------

    @property
    def n_poles(self) -> int:
        """Number of poles."""
        return len(self.den) - 1

    @property
    def n_zeros(self) -> int:
        """Number of zeros."""
        return len(self.num) - 1

    @property
    def n_parameters(self) -> int:
        """Free parameters: den[1:], num, and the delay when it was estimated."""
        return self.n_poles + len(self.num) + int(self.free_delay)

    @property
    def poles(self) -> np.ndarray:
        """(n,) complex: rad/s in domain "s", z in domain "z"."""
        return roots_of(self.den)

    @property
    def zeros(self) -> np.ndarray:
        """(<= m,) complex: rad/s in domain "s", z in domain "z"."""
        return roots_of(self.num)

    @property
    def stable(self) -> bool:
        """Whether all poles are stable."""
        if self.domain == "s":
            return bool(np.all(self.poles.real < 0))
        return bool(np.all(np.abs(self.poles) < 1))

    @property
    def delay_hold_uncertainty_s(self) -> float | None:
        """Difference of the delay between the two holds [s]; None if the hold is stated."""
        return None if self.other_delay_s is None else abs(self.delay_s - self.other_delay_s)

    def _to_c(self) -> Any:
        c = ffi.new("gsid_rational *")
        if self.domain == "s":
            # Scaled by the largest pole, the coefficients stay within range at any order.
            scale = max(float(np.max(np.abs(self.poles), initial=0.0)), 1.0)
            rate, num, den = scale, self.num[::-1], self.den[::-1]
            num = num * scale ** np.arange(len(num))
            den = den * scale ** np.arange(len(den))
            num, den = num / den[-1], den / den[-1]
        else:
            assert self.fs_hz is not None
            rate, num, den = 1.0 / self.fs_hz, self.num, self.den
        domain = lib.GSID_DOMAIN_S if self.domain == "s" else lib.GSID_DOMAIN_Z
        check(lib.gsid_rational_init(c, domain, len(den) - 1, len(num) - 1, rate), "model")
        c.num[0 : len(num)] = num.tolist()
        c.den[0 : len(den)] = den.tolist()
        c.delay_s = self.delay_s
        return c

    def response(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Frequency response, with the hold when `hold` is "zoh" (MOD-1, MOD-2).

        Parameters
        ----------
        f_hz : (k,) array_like
            Frequencies [Hz]; below fs/2 with a hold.

        Returns
        -------
        (k,) complex ndarray, output unit per input unit.

        Raises
        ------
        GsidError
            A frequency lies on a pole, or a model with a hold has more zeros than poles.
        """
        f = np.ascontiguousarray(np.atleast_1d(f_hz), dtype=float)
        g = np.empty(len(f), dtype=complex)
        f_c, g_c = ffi.from_buffer("double[]", f), ffi.cast("gsid_cplx *", ffi.from_buffer(g))
        if self.hold == "zoh":
            assert self.fs_hz is not None
            check(
                lib.gsid_hold_response(self._to_c(), 1.0 / self.fs_hz, len(f), f_c, g_c), "response with hold"
            )
        else:
            check(lib.gsid_rational_eval(self._to_c(), len(f), f_c, g_c), "response")
        return g

    # ---- uncertainty -------------------------------------------------------------------------------------

    def gradient(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Derivatives of the response without hold by (den[1:], num, delay if free).

        Parameters
        ----------
        f_hz : (k,) array_like
            Hz.

        Returns
        -------
        (k, p) complex ndarray

        Raises
        ------
        GsidError
            A frequency lies on a pole.
        """
        f = np.ascontiguousarray(np.atleast_1d(f_hz), dtype=float)
        c, n_den = self._to_c(), self.n_poles
        g = np.empty(len(f), dtype=complex)
        by = np.empty((len(f), n_den + len(self.num) + 1), dtype=complex)
        arrays = ffi.from_buffer("double[]", f), *(ffi.from_buffer("gsid_cplx[]", x) for x in (g, by))
        check(lib.gsid_batch_rational_gradient(c, len(f), *arrays), "derivatives of the response")
        by_den, by_num, by_delay = np.split(by, [n_den, n_den + len(self.num)], axis=1)
        if self.domain == "s":  # coefficients of s / scale, in ascending powers
            scale = float(c.scale_rad_s)
            by_den = (by_den * scale ** np.arange(-n_den, 0.0))[:, ::-1]
            by_num = (by_num * scale ** (np.arange(len(self.num)) - float(n_den)))[:, ::-1]
        return np.hstack([by_den, by_num, by_delay] if self.free_delay else [by_den, by_num])

    def response_std(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Standard deviation of the complex response from the covariance of the parameters: sqrt(E|dG|^2).

        With a hold it is that of the model times the magnitude of the hold; aliases from above fs/2 are
        neglected.

        Parameters
        ----------
        f_hz : (k,) array_like
            Hz.

        Returns
        -------
        (k,) ndarray, unit of the response. Zero for a model without covariance.
        """
        f = np.atleast_1d(np.asarray(f_hz, dtype=float))
        if self.cov is None:
            return np.zeros(len(f))
        x = self.gradient(f)
        std = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", x, self.cov, x.conj()).real, 0))
        return std * np.abs(hold_factor(f, self.fs_hz)) if self.hold == "zoh" else std

    def deviations(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Change of the response by one standard deviation along each independent direction of `cov`.

        Parameters
        ----------
        f_hz : (k,) array_like
            Hz; below fs/2 with a hold.

        Returns
        -------
        (k, r) complex ndarray, unit of the response
            The product with its conjugate transpose is the covariance of the response. r is at most the
            number of parameters, and 0 for a model without covariance.
        """
        f = np.atleast_1d(np.asarray(f_hz, dtype=float))
        if self.cov is None:
            return np.zeros((len(f), 0), complex)
        half = half_of(self.cov)
        if self.hold == "none":
            return self.gradient(f) @ half
        # By finite differences, because the aliases from above fs/2 change too.
        moved = []
        for column in half.T:
            step = self._small_step(column, f)
            plus, minus = (self._moved(sign * step * column).response(f) for sign in (1, -1))
            moved.append((plus - minus) / (2 * step))
        return np.array(moved).reshape(-1, len(f)).T

    def derivatives(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Derivatives of the response, with its hold, by (den[1:], num, delay if free).

        Parameters
        ----------
        f_hz : (k,) array_like
            Hz; below fs/2 with a hold. Changes of aliases from above fs/2 are neglected.

        Returns
        -------
        (k, p) complex ndarray

        Raises
        ------
        GsidError
            A frequency lies on a pole.
        """
        f = np.atleast_1d(np.asarray(f_hz, dtype=float))
        by = self.gradient(f)
        return by * hold_factor(f, self.fs_hz)[:, None] if self.hold == "zoh" else by

    def _small_step(self, by: np.ndarray, f_hz: np.ndarray) -> float:
        """Factor that makes a change of the parameters small enough for a finite difference.

        The response is linear in its numerator. Denominator and phase change by at most 1e-3 at each line.
        """
        inverse = RationalModel([1.0], self.den, domain=self.domain, fs_hz=self.fs_hz)  # 1 / den
        change = inverse.gradient(f_hz)[:, : self.n_poles] @ by[: self.n_poles]
        den = np.abs(change / inverse.response(f_hz))
        phase = 2 * np.pi * f_hz * abs(by[-1]) if self.free_delay else np.zeros(1)
        return 1e-3 / max(float(np.max(den, initial=0.1)), float(np.max(phase, initial=0.0)))

    def _moved(self, by: np.ndarray) -> RationalModel:
        """The model with its free parameters changed, in the order of `cov`."""
        den, num = np.split(by[: self.n_poles + len(self.num)], [self.n_poles])
        return replace(
            self,
            den=self.den + np.concatenate([[0.0], den]),
            num=self.num + num,
            delay_s=self.delay_s + (by[-1] if self.free_delay else 0.0),
        )

    def _std(self) -> np.ndarray:
        return self._std_by(self.cov)

    def _std_by(self, cov: np.ndarray | None) -> np.ndarray:
        if cov is None:
            return np.full(self.n_parameters, np.nan)
        std = np.sqrt(np.maximum(np.diag(cov), 0))
        std[list(self.undetermined)] = np.inf
        return std

    @property
    def std_den(self) -> np.ndarray:
        """(n + 1,) standard deviation of den; 0 for den[0], inf if not determined, nan without covariance."""
        return np.concatenate([[0.0], self._std()[: self.n_poles]])

    @property
    def std_num(self) -> np.ndarray:
        """(m + 1,) standard deviation of num; inf if not determined, nan without covariance."""
        return self._std()[self.n_poles : self.n_poles + len(self.num)]

    @property
    def std_delay_s(self) -> float:
        """Standard deviation of the delay [s]; 0 if given, inf if not determined, nan without `cov`."""
        if not self.free_delay:
            return 0.0
        return float(self._std()[-1])

    def noise_only(self) -> RationalModel:
        """The model with the covariance of the noise alone, for intervals beside those of all errors."""
        return replace(self, cov=self.cov if self.cov_noise is None else self.cov_noise, cov_noise=None)

    @property
    def pole_cov(self) -> np.ndarray:
        """(n, 2, 2) covariance of each pole's (real, imaginary) part; nan without covariance."""
        return self._root_cov(self.den, self.poles, slice(0, self.n_poles), 1)

    @property
    def zero_cov(self) -> np.ndarray:
        """(len(zeros), 2, 2) covariance of each zero's (real, imaginary) part; nan without covariance."""
        return self._root_cov(self.num, self.zeros, slice(self.n_poles, self.n_poles + len(self.num)), 0)

    def _root_cov(self, coef: np.ndarray, roots: np.ndarray, where: slice, first: int) -> np.ndarray:
        """First order: a root moves by -x^j / coef'(x) when the coefficient of x^j moves."""
        if self.cov is None:
            return np.full((len(roots), 2, 2), np.nan)
        powers = np.arange(len(coef) - 1, -1, -1)[first:]
        with np.errstate(divide="ignore", invalid="ignore"):
            by = -(roots[:, None] ** powers) / np.polyval(np.polyder(coef), roots)[:, None]
            parts = np.stack([by.real, by.imag], axis=1)
            return parts @ self.cov[where, where] @ np.swapaxes(parts, 1, 2)

    # ---- files and other libraries -----------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The model as the JSON of a model file."""
        rational = {
            "domain": self.domain,
            "num": self.num.tolist(),
            "den": self.den.tolist(),
            "delay_s": self.delay_s,
            "hold": self.hold,
            "hold_assumed": self.hold_assumed,
            "other_delay_s": self.other_delay_s,
            "free_delay": self.free_delay,
            "covariance": None if self.cov is None else self.cov.tolist(),
            "covariance_noise_only": None if self.cov_noise is None else self.cov_noise.tolist(),
            "undetermined": list(self.undetermined),
        }
        fit = {
            "method": self.method,
            "cost": self.cost,
            "cost_expected": self.cost_expected,
            "n_lines": self.n_lines,
            "converged": self.converged,
            "band_hz": None if self.band_hz is None else list(self.band_hz),
            "weights": self.weights,
            "warnings": [warning.to_dict() for warning in self.warnings],
        }
        return {
            "gsid_model": FORMAT,
            "made_by": f"gsid {version()}",
            "fs_hz": self.fs_hz,
            "u_unit": self.u_unit,
            "y_unit": self.y_unit,
            "rational": rational,
            "fit": fit,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any], where: str = "") -> RationalModel:
        """Make a model from the JSON of a model file.

        Parameters
        ----------
        data : dict
            As :meth:`to_dict` returns it.
        where : str
            File name, for messages.

        Raises
        ------
        InputError
            Something is missing or has the wrong form.
        """
        if not isinstance(data, dict) or data.get("gsid_model") != FORMAT:
            raise InputError(
                "not a model file",
                where,
                None,
                f'a model file is JSON with "gsid_model": {FORMAT}; `gsid start` or `gsid fit` writes one',
            )
        if "rational" not in data:
            hint = 'a fitted transfer function ("rational") is required here'
            raise InputError("the model file has no transfer function", where, ", ".join(data), hint)
        rational = data["rational"]
        try:
            model = cls(
                num=moderate(rational["num"], "num"),
                den=moderate(rational["den"], "den"),
                delay_s=moderate(number(rational, "delay_s", 0.0), "delay_s"),
                domain=text(rational, "domain", "s"),
                fs_hz=number(data, "fs_hz"),
                hold=text(rational, "hold", "none"),
                hold_assumed=flag(rational, "hold_assumed"),
                other_delay_s=number(rational, "other_delay_s"),
                cov=moderate(rational.get("covariance"), "covariance", LARGEST**2),
                cov_noise=moderate(
                    rational.get("covariance_noise_only"), "covariance_noise_only", LARGEST**2
                ),
                undetermined=tuple(listed(rational, "undetermined")),
                weights=text(data.get("fit") or {}, "weights", "noise"),
                free_delay=flag(rational, "free_delay"),
                u_unit=text(data, "u_unit"),
                y_unit=text(data, "y_unit"),
                warnings=tuple(
                    FitWarning.from_dict(warning) for warning in listed(data.get("fit"), "warnings")
                ),
                **how_fitted(data),
            )
            for name in ("num", "den"):  # again, now that den[0] is 1
                moderate(getattr(model, name), name)
            return model
        except KeyError as error:
            raise InputError(
                "a key is missing in the model file", where, error.args[0], "give num and den"
            ) from error
        except (AttributeError, TypeError, ValueError) as error:
            raise InputError(
                f"the model file is not usable: {error}", where, None, "write it again by `gsid fit -o`"
            ) from error

    def save(self, path: str | Path) -> None:
        """Write a model file (.json). An existing file is replaced atomically."""
        write_model_file(path, self.to_dict())

    @classmethod
    def load(cls, path: str | Path) -> RationalModel:
        """Read a model file.

        Raises
        ------
        InputError
            The file cannot be read, is not JSON, or is not a model.
        """
        return cls.from_dict(read_model_file(path), str(path))

    def to_control(self, pade_order: int | None = None) -> control.TransferFunction:
        """Convert to a transfer function of python-control, which has neither delay nor hold.

        `control.ss` makes a state space of it, and `from_control` accepts both.

        Parameters
        ----------
        pade_order : int, optional
            Domain "s": order of a Pade approximation of the delay. With order 6 or more the phase error is
            at most 0.1 degree up to pade_order / (2 pi delay_s) Hz. Default: the result lacks the delay,
            `delay_s`. Domain "z": not used; the delay must be a whole number of samples.

        Returns
        -------
        control.TransferFunction
            Without the hold, if the model has one.

        Raises
        ------
        ValueError
            Domain "z", and a delay that is not a whole number of samples.
        """
        import control

        if self.domain == "s":
            system = control.tf(self.num, self.den)
            if self.delay_s == 0 or pade_order is None:
                return system
            return system * control.tf(*control.pade(self.delay_s, pade_order))
        assert self.fs_hz is not None
        samples = self.delay_s * self.fs_hz
        if abs(samples - round(samples)) > 1e-9:
            raise ValueError(
                f"a delay of {samples} samples has no transfer function in z; it must be a whole number"
            )
        degree = max(self.n_poles, self.n_zeros)
        num = np.concatenate([self.num, np.zeros(degree - self.n_zeros)])
        den = np.concatenate([self.den, np.zeros(degree - self.n_poles + round(samples))])
        return control.tf(num, den, 1.0 / self.fs_hz)

    @classmethod
    def from_control(
        cls, system: control.TransferFunction | control.StateSpace, delay_s: float = 0.0
    ) -> RationalModel:
        """Make a model from a system of python-control with one input and one output.

        Parameters
        ----------
        system : control.TransferFunction or control.StateSpace
            Continuous, or discrete with a sample time.
        delay_s : float
            Delay to add [s].

        Returns
        -------
        RationalModel

        Raises
        ------
        ValueError
            Several inputs or outputs, a discrete system without sample time, or one that is not causal.
        """
        if system.ninputs != 1 or system.noutputs != 1:
            raise ValueError(
                f"one input and one output are required, got {system.ninputs} and {system.noutputs}"
            )
        if system.dt is True:
            raise ValueError("the discrete system has no sample time: set its dt")
        if hasattr(system, "A"):
            import control

            system = control.tf(system)
        return cls._of_descending(
            system.num[0][0], system.den[0][0], delay_s, None if system.isctime() else system.dt
        )

    def to_scipy(self) -> signal.TransferFunction:
        """Convert to a transfer function of scipy.signal, which has neither delay nor hold.

        Its methods `to_ss` and `to_zpk` give the other forms, and `from_scipy` accepts them.

        Returns
        -------
        scipy.signal.TransferFunction
            Domain "s": without the delay, `delay_s`. Domain "z": with `dt`, and with the delay, which must be
            a whole number of samples.

        Raises
        ------
        ValueError
            Domain "z", and a delay that is not a whole number of samples.
        """
        from scipy import signal

        system = self.to_control()
        sample_time = {} if self.domain == "s" else {"dt": system.dt}
        return signal.TransferFunction(system.num[0][0], system.den[0][0], **sample_time)

    @classmethod
    def from_scipy(cls, system: signal.lti | signal.dlti, delay_s: float = 0.0) -> RationalModel:
        """Make a model from a system of scipy.signal with one input and one output.

        Parameters
        ----------
        system : scipy.signal.lti or scipy.signal.dlti
            `TransferFunction`, `ZerosPolesGain` or `StateSpace`; discrete with a sample time.
        delay_s : float
            Delay to add [s].

        Returns
        -------
        RationalModel

        Raises
        ------
        ValueError
            Several inputs or outputs, a discrete system without sample time, or one that is not causal.
        """
        inputs, outputs = getattr(system, "inputs", 1), getattr(system, "outputs", 1)
        if (inputs or 1, outputs or 1) != (1, 1):
            raise ValueError(f"one input and one output are required, got {inputs} and {outputs}")
        if system.dt is True:
            raise ValueError("the discrete system has no sample time: set its dt")
        as_ratio = system.to_tf()
        return cls._of_descending(np.atleast_2d(as_ratio.num)[0], as_ratio.den, delay_s, system.dt)

    @classmethod
    def _of_descending(
        cls, num: np.ndarray, den: np.ndarray, delay_s: float, sample_s: float | None
    ) -> RationalModel:
        """Make a model from coefficients of s, or with `sample_s` [s] of z, highest power first."""
        num, den = np.trim_zeros(num, "f"), np.trim_zeros(den, "f")
        if sample_s is None:
            return cls(num, den, delay_s)
        lag = len(den) - len(num)
        if lag < 0:
            orders = f"{len(num) - 1} zeros, {len(den) - 1} poles"
            raise ValueError(f"the discrete system is not causal: {orders}")
        return cls(np.concatenate([np.zeros(lag), num]), den, delay_s, "z", 1.0 / sample_s)

    def plot(self, frf: Frf | None = None) -> matplotlib.figure.Figure:
        """Bode diagram with 95 % bands, over the measured response if one is given."""
        if frf is not None:
            check_response(frf)
        return self._figure(frf)

    # ---- print -------------------------------------------------------------------------------------------

    def __repr__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> list[str]:
        variable = "s" if self.domain == "s" else "z^-1"
        lines = [
            f"RationalModel {self.n_poles} poles, {self.n_zeros} zeros, in {variable}"
            + (", input held over each sample" if self.hold == "zoh" else ""),
            f"  num    {_with_std(self.num, self.std_num)}",
            f"  den    {_with_std(self.den, self.std_den)}",
            f"  delay  {_with_std([1e3 * self.delay_s], [1e3 * self.std_delay_s])} ms",
            f"  {'stable' if self.stable else 'UNSTABLE'}",
        ]
        if self.cost is not None:
            left = "noise" if self.weights == "noise" else "noise and distortion"
            expected = (
                ""
                if self.cost_expected is None
                else f", {self.cost_expected:.1f} expected when only {left} is left"
            )
            lines.append(f"  {self.method}: cost {self.cost:.1f} over {self.n_lines} lines{expected}")
        return lines + [f"  warning: {warning.text}" for warning in self.warnings]

    def _repr_html_(self) -> str:
        delay_ms = _with_std([1e3 * self.delay_s], [1e3 * self.std_delay_s])
        rows = [
            ("num", _with_std(self.num, self.std_num)),
            ("den", _with_std(self.den, self.std_den)),
            ("delay [ms]", delay_ms),
            ("y / u", f"{self.y_unit or '1'} / {self.u_unit or '1'}"),
        ]
        title, _num, _den, _delay, *rest = self._lines()
        return Table((), rows, title=title).html() + paragraphs(*(line.strip() for line in rest))


def half_of(cov: np.ndarray) -> np.ndarray:
    """C^(1/2), whose columns are one standard deviation along each independent direction.

    Parameters
    ----------
    cov : (p, p) ndarray
        Covariance. It may be singular, and rows of known parameters are 0.

    Returns
    -------
    (p, r) ndarray
        The product with its transpose is `cov`; r <= p.
    """
    size = np.sqrt(np.maximum(np.diag(cov), 0.0))
    scale = np.where(size > 0, size, 1.0)
    squares, directions = np.linalg.eigh(cov / np.outer(scale, scale))
    there = squares > np.finfo(float).eps * max(len(cov), 1)
    return scale[:, None] * directions[:, there] * np.sqrt(squares[there])


def _with_std(values: Any, stds: Any) -> str:
    return ", ".join(
        f"{value:.6g}" + (f" +- {std:.2g}" if np.isfinite(std) and std > 0 else "")
        for value, std in zip(values, stds, strict=True)
    )
