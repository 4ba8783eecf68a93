"""Frequency response and its variance from periodic records.

The mean over periods estimates the lines of input and output; the scatter over periods estimates the noise
(thesis, eqs. 4.10 and 4.11):

    G = mean(Y) / mean(U)
    var G = |G|^2 [var_Y/|Y|^2 + var_U/|U|^2 - 2 Re(cov_YU / (Y conj U))] / P      (thesis, eq. 7.29)

With M realisations, G is the mean of the M responses. Its variance is the sum of their variances divided by
M^2 (thesis, eq. 5.14).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.errors import InputError
from gsid.base.plottable import Plottable
from gsid.base.tables import Table
from gsid.spectrum.realisation import require_same

if TYPE_CHECKING:
    import control
    import pandas

    from gsid.spectrum.tones import Tone

SAME_INPUT = 0.1  # largest relative difference between the inputs of parts of one realisation


@dataclass(repr=False)
class Frf(Plottable):
    """Frequency response at the excited lines, with the variance of its mean.

    Attributes
    ----------
    line : (F,) int
    f_hz : (F,) [Hz]
    g : (F,) complex
        mean(Y)/mean(U), unit y over u (thesis, eq. 4.10); the mean over realisations (eq. 5.14).
    var_g : (F,)
        Variance E|error|^2 of g (thesis, eqs. 7.29, 5.14).
    u, y : (F,) complex
        Means over periods. With several realisations, the phases are taken relative to u before averaging, so
        that u is a mean amplitude.
    var_u, var_y, cov_yu : (F,)
        Sample (co)variances of one period (thesis, eq. 4.11), averaged over realisations.
    n_periods : int
        Good periods of all realisations.
    n_realisations, n_spoiled, settle_samples, period_samples : int
    fs_hz : float
    hold : {"zoh", "none"} or None
        As in `gsid.Record`.
    u_unit, y_unit, name : str
    removed : tuple of Tone
        Periodic disturbances that were subtracted from the output first.
    n_dof : float
        Complex degrees of freedom of the variances. Default `n_periods - n_realisations`; infinite if the
        variances are known.
    rejected_hz : (R,) [Hz]
        Lines of the input that are not used: too weak, below the noise, or not in every record.
    method : {"periods", "lpm", "windows"}
        Method that estimated the variances: scatter over periods, local polynomial method, or windows over a
        record that is not periodic.
    var_total : (F,) ndarray or None
        Variance of g by noise and distortion (`gsid.response.with_distortion`); None if it is not measured.
    smooth_phases : bool
        The excitation hides its distortion: one realisation with smooth phases (Schroeder).
    dof : (F,) ndarray or None
        Degrees of freedom of the variance of each line, where they differ between lines as in bands that were
        measured apart; None: `n_dof` holds for all lines.
    """

    line: np.ndarray
    f_hz: np.ndarray
    g: np.ndarray
    var_g: np.ndarray
    u: np.ndarray
    y: np.ndarray
    var_u: np.ndarray
    var_y: np.ndarray
    cov_yu: np.ndarray
    n_periods: int
    n_realisations: int
    n_spoiled: int
    settle_samples: int
    period_samples: int
    fs_hz: float
    hold: str | None = "none"
    u_unit: str = ""
    y_unit: str = ""
    name: str = ""
    removed: tuple[Tone, ...] = ()
    n_dof: float | None = None
    rejected_hz: np.ndarray = field(default_factory=lambda: np.empty(0))
    method: str = "periods"
    var_total: np.ndarray | None = None
    smooth_phases: bool = False
    dof: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.n_dof is None:
            self.n_dof = self.n_periods - self.n_realisations

    @property
    def coherence(self) -> np.ndarray:
        """Coherence of input and output over periods or windows, (F,), 0 .. 1 (thesis, eq. 5.3).

        Distortion is the same in all periods, and lowers the coherence only if the excitation is not
        periodic. NaN if the output is exactly zero: it has neither signal nor noise.
        """
        noise = error_variance(self.var_u, self.var_y, self.cov_yu, self.g)
        power = np.abs(self.g * self.u) ** 2
        share = 1 - 1 / (self.n_dof + 1)  # mean square about the sample mean over the variance
        total = power + share * noise
        return np.divide(power, total, out=np.full_like(total, np.nan), where=total > 0)

    def at(self, use: np.ndarray) -> Frf:
        """Select lines of the response: use, (F,) bool."""
        per_line = {
            name: value[use]
            for name, value in vars(self).items()
            if isinstance(value, np.ndarray) and name != "rejected_hz"
        }
        return replace(self, **per_line)

    def to_control(self) -> control.FRD:
        """Return the response as `control.FRD`, frequencies in rad/s."""
        import control

        return control.FRD(self.g, 2 * np.pi * self.f_hz)

    @classmethod
    def from_arrays(
        cls, f_hz: np.ndarray, g: np.ndarray, var_g: np.ndarray | None = None, *, fs_hz: float = float("nan")
    ) -> Frf:
        """Import a measured response.

        Parameters
        ----------
        f_hz : (F,) array_like
            Frequencies [Hz]; they need not lie on a grid.
        g : (F,) complex array_like
        var_g : (F,) array_like, optional
            Variance of g, assumed to be exact. Default: unknown, NaN.
        fs_hz : float, optional
            Sample rate [Hz], for models in z and inputs with a zero-order hold.

        Returns
        -------
        Frf
            With unit input: u is 1 and y is g. Lines are numbered 1 .. F and `period_samples` is 0.

        Raises
        ------
        ValueError
            The lengths differ, a frequency is negative, or a value is not finite.
        """
        f_hz, g = np.asarray(f_hz, float), np.asarray(g, complex)
        variance = np.full(len(g), np.nan) if var_g is None else np.asarray(var_g, float)
        if f_hz.shape != g.shape or variance.shape != g.shape or g.ndim != 1:
            raise ValueError(f"f_hz, g and var_g have shapes {f_hz.shape}, {g.shape} and {variance.shape}")
        sound = np.isfinite(g) & np.isfinite(f_hz) & (f_hz >= 0)
        if not sound.all():
            bad = int(np.flatnonzero(~sound)[0])
            raise ValueError(f"line {bad} of the response is {g[bad]} at {f_hz[bad]} Hz: remove it")
        zero = np.zeros(len(g))
        return cls(
            line=np.arange(1, len(g) + 1),
            f_hz=f_hz,
            g=g,
            var_g=variance,
            u=np.ones(len(g), complex),
            y=g.copy(),
            var_u=zero,
            var_y=variance.copy(),
            cov_yu=zero.astype(complex),
            n_periods=1,
            n_realisations=1,
            n_spoiled=0,
            settle_samples=0,
            period_samples=0,
            fs_hz=fs_hz,
            n_dof=np.inf,
        )

    @classmethod
    def from_control(cls, frd: control.FRD, *, var_g: np.ndarray | None = None) -> Frf:
        """Import a single-input single-output `control.FRD`.

        Parameters
        ----------
        frd : control.FRD
            Frequencies in rad/s.
        var_g : (F,) array_like, optional
            Variance of the response, which an FRD does not contain. Default: unknown, NaN.

        Returns
        -------
        Frf
            As `from_arrays`.

        Raises
        ------
        ValueError
            The FRD has several inputs or outputs, or var_g has another length.
        """
        response = np.asarray(frd(1j * frd.omega, squeeze=False))
        if response.shape[:2] != (1, 1):
            raise ValueError(f"the FRD has (outputs, inputs) {response.shape[:2]}, not (1, 1)")
        fs_hz = 1 / frd.dt if frd.dt not in (None, 0, True) else float("nan")
        return cls.from_arrays(np.asarray(frd.omega) / (2 * np.pi), response[0, 0], var_g, fs_hz=fs_hz)

    @classmethod
    def from_pandas(cls, frame: pandas.DataFrame, *, fs_hz: float = float("nan")) -> Frf:
        """Import a frame with columns f_hz, g_re, g_im and, if known, std_g.

        Parameters
        ----------
        frame : pandas.DataFrame
        fs_hz : float, optional
            Sample rate [Hz].

        Returns
        -------
        Frf
            As `from_arrays`.
        """
        variance = frame["std_g"].to_numpy() ** 2 if "std_g" in frame.columns else None
        g = frame["g_re"].to_numpy() + 1j * frame["g_im"].to_numpy()
        return cls.from_arrays(frame["f_hz"].to_numpy(), g, variance, fs_hz=fs_hz)

    def to_pandas(self) -> pandas.DataFrame:
        """Return one row per line: line, f_hz, g_re, g_im, gain_db, phase_deg, std_g."""
        import pandas

        return pandas.DataFrame(
            {
                "line": self.line,
                "f_hz": self.f_hz,
                "g_re": self.g.real,
                "g_im": self.g.imag,
                "gain_db": 20 * np.log10(np.abs(self.g)),
                "phase_deg": np.degrees(np.angle(self.g)),
                "std_g": np.sqrt(self.var_g),
            }
        )

    def _summary(self) -> dict[str, str]:
        with np.errstate(divide="ignore", invalid="ignore"):  # if the output is zero
            error = np.sqrt(self.var_g) / np.abs(self.g)
        gain_unit = f" {self.y_unit or '1'}/{self.u_unit or '1'}" if self.y_unit or self.u_unit else ""
        peak = int(np.argmax(np.abs(self.g)))
        piece = "window" if self.method == "windows" else "period"
        return {
            "lines": f"{len(self.line)}, {self.f_hz[0]:g} .. {self.f_hz[-1]:g} Hz",
            f"{piece}s": f"{self.n_periods} good, {self.n_spoiled} spoiled",
            piece: f"{self.period_samples} samples at {self.fs_hz:g} Hz",
            "realisations": f"{self.n_realisations}",
            "settling": f"{self.settle_samples} samples",
            "largest gain": f"{abs(self.g[peak]):.4g}{gain_unit} at {self.f_hz[peak]:g} Hz",
            "std / gain": f"median {np.median(error):.2g}, largest {error.max():.2g}",
        }

    def __repr__(self) -> str:
        rows = "\n".join(f"  {key:26}{value}" for key, value in self._summary().items())
        return f"Frf {self.name or 'unnamed'}\n{rows}"

    def _repr_html_(self) -> str:
        return Table((), list(self._summary().items()), title=f"Frf {self.name or 'unnamed'}").html()


_COMPLEX = ("g", "y", "u", "cov_yu")
_REAL = ("var_g", "var_y", "var_u")


def response_of(
    u: np.ndarray, y: np.ndarray, var_u: np.ndarray, var_y: np.ndarray, cov_yu: np.ndarray, n_periods: int
) -> dict[str, np.ndarray]:
    """Response and its variance from means, variances and covariance over periods.  Eq: FRF-2

    Parameters
    ----------
    u, y : (F,) complex ndarray
        Means.
    var_u, var_y : (F,) ndarray
    cov_yu : (F,) complex ndarray
        Of one period.
    n_periods : int
        In the means.

    Returns
    -------
    dict of (F,) ndarrays
        g, var_g and the arrays given, by the names of `Frf`.
    """
    means = {"u": u, "y": y, "var_u": var_u, "var_y": var_y, "cov_yu": cov_yu}
    out, arrays = _to_c(means | {"g": np.empty(len(u), complex), "var_g": np.empty(len(u))})
    check(lib.gsid_batch_frf_divide(len(u), n_periods, out), "frequency response")
    return arrays


def error_variance(var_u: np.ndarray, var_y: np.ndarray, cov_yu: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Variance of Y - g U of one period.  Eq: FRF-2

    Parameters
    ----------
    var_u, var_y : (F,) ndarray
    cov_yu : (F,) complex ndarray
        Of one period.
    g : (F,) complex ndarray
        Any response, such as that of a model.

    Returns
    -------
    (F,) ndarray, not negative.

    Raises
    ------
    ValueError
        Arrays of different lengths.
    """
    out, arrays = _to_c({"var_u": var_u, "var_y": var_y, "cov_yu": cov_yu, "g": g})
    variance = np.empty(len(arrays["g"]))
    pointers = ffi.from_buffer("gsid_cplx[]", arrays["g"]), ffi.from_buffer("double[]", variance)
    check(lib.gsid_batch_frf_error_variance(len(variance), out, *pointers), "variance of the error")
    return variance


def _to_c(arrays: Mapping[str, np.ndarray]) -> tuple[Any, dict[str, np.ndarray]]:
    """Lines of a response for the C library, and the copies of the arrays that it points to.

    Raises
    ------
    ValueError
        The arrays cannot be brought to the same shape: the library reads all of them to the same length.
    """
    out, kept = ffi.new("gsid_frf_out *"), {}
    shape = np.broadcast_shapes(*map(np.shape, arrays.values()))
    for name, values in arrays.items():
        kind, c_type = (complex, "gsid_cplx[]") if name in _COMPLEX else (float, "double[]")
        kept[name] = np.array(np.broadcast_to(values, shape), kind, order="C")
        setattr(out, name, ffi.from_buffer(c_type, kept[name]))
    return out, kept


def merged(each: Sequence[Frf]) -> Frf:
    """Merge parts of one realisation, as if they had been measured consecutively (FRF-4).

    Parameters
    ----------
    each : sequence of Frf
        Estimated from periods, at the same lines.

    Returns
    -------
    Frf

    Raises
    ------
    InputError
        Their inputs differ by more than 10 %, or their periods, sample rates, holds or units differ.
    ValueError
        The sequence is empty, the lines differ, or a response was not estimated from periods.
    """
    if not each or any(
        one.method != "periods" or one.n_realisations != 1 or np.isinf(one.n_dof) for one in each
    ):
        raise ValueError("each response to merge must be of one realisation and estimated from periods")
    whole = each[0]
    for part in each[1:]:
        require_same(whole, part)
        if not np.array_equal(part.line, whole.line):
            raise ValueError("the parts have different lines")
        whole = _merged_pair(whole, part)
    return whole


def _merged_pair(a: Frf, b: Frf) -> Frf:
    if np.sum(np.abs(a.u - b.u) ** 2) > SAME_INPUT**2 * np.sum(np.abs(a.u) ** 2):
        hint = "omit --merge to average realisations; parts of one begin at the same point of the period"
        raise InputError("the inputs of the parts differ", b.name, None, hint)
    parts = [_to_c({name: getattr(part, name) for name in (*_COMPLEX, *_REAL)}) for part in (a, b)]
    (whole, arrays), (other, _kept) = parts
    n_a, n_b = a.n_periods, b.n_periods
    check(lib.gsid_batch_frf_merge(len(a.line), n_a, whole, n_b, other), "merging two responses")
    return replace(
        a,
        **arrays,
        n_periods=n_a + n_b,
        n_spoiled=a.n_spoiled + b.n_spoiled,
        n_dof=None,
        removed=a.removed + b.removed,
        rejected_hz=np.union1d(a.rejected_hz, b.rejected_hz),
        name=", ".join(name for name in (a.name, b.name) if name),
    )


def check_response(frf: object) -> None:
    """Refuse an argument that is not a measured response (TypeError)."""
    if not all(hasattr(frf, name) for name in ("f_hz", "g", "var_g", "cov_yu")):
        hint = "fit_mimo takes a matrix of responses" if hasattr(frf, "f_hz") else "frf(record) estimates it"
        raise TypeError(f"expected an Frf, got {type(frf).__name__}; {hint}")
