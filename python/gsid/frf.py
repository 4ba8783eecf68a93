"""Frequency response and its uncertainty from periodic records.

The mean over periods estimates the lines of input and output, their scatter the noise (source, eqs. 4.10 and
4.11):

    G = mean(Y) / mean(U)
    var G = |G|^2 [var_Y/|Y|^2 + var_U/|U|^2 - 2 Re(cov_YU / (Y conj U))] / P      (source, eq. 7.29)

With M realisations, G is the mean of theirs and its variance 1/M^2 of the sum of theirs (source, eq. 5.14).
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsid._callable import callable_as
from gsid._lib import check, ffi, ffi32, lib, lib32
from gsid.errors import InputError
from gsid.record import Record, split_periods

if TYPE_CHECKING:
    import control
    import matplotlib.figure
    import pandas

SHARE_OF_LARGEST = 0.01  # weaker lines than this are not excited
GAP = 2.0  # ratio between neighbours, lines sorted by size, that parts excitation from by-products
ABOVE_NOISE = 16.0  # |mean|^2 over its variance; noise alone exceeds it once in exp(16) = 9e6 lines

_planner = threading.Lock()  # gsid_batch_spectra takes one caller at a time


@dataclass(repr=False)
class Spectra:
    """Lines of each good period of one record (FRF-1).

    Attributes
    ----------
    fs_hz : float
    period_samples : int
        N.
    line : (K,) int
        All lines 0 .. N/2.
    U, Y : (P, K) complex
        One row per good period, units `u_unit` and `y_unit`; |U| is the amplitude of the sine, its phase that
        of a cosine from the record's first sample on.
    n_spoiled : int
        Periods left out because samples of them were lost.
    settle_samples : int
    excited : (K,) bool
        See `excited_lines`.
    hold : {"zoh", "none"}
    u_unit, y_unit, name : str
    """

    fs_hz: float
    period_samples: int
    line: np.ndarray
    U: np.ndarray
    Y: np.ndarray
    n_spoiled: int
    settle_samples: int
    excited: np.ndarray
    hold: str = "none"
    u_unit: str = ""
    y_unit: str = ""
    name: str = ""

    @property
    def f_hz(self) -> np.ndarray:
        """Frequencies of the lines, (K,) [Hz]."""
        return self.line * (self.fs_hz / self.period_samples)

    @property
    def n_periods(self) -> int:
        """Good periods P."""
        return len(self.U)

    @property
    def u(self) -> np.ndarray:
        """Mean of U over periods, (K,) complex (source, eq. 4.10)."""
        return self.U.mean(axis=0)

    @property
    def y(self) -> np.ndarray:
        """Mean of Y over periods, (K,) complex (source, eq. 4.10)."""
        return self.Y.mean(axis=0)

    @property
    def var_u(self) -> np.ndarray:
        """Sample variance of one period's U, (K,) (source, eq. 4.11)."""
        return _covariance(self.U, self.U).real

    @property
    def var_y(self) -> np.ndarray:
        """Sample variance of one period's Y, (K,) (source, eq. 4.11)."""
        return _covariance(self.Y, self.Y).real

    @property
    def cov_yu(self) -> np.ndarray:
        """Sample covariance, mean of Y conj(U), of one period, (K,) complex (source, eq. 4.11)."""
        return _covariance(self.Y, self.U)

    def __repr__(self) -> str:
        f_hz = self.f_hz[self.excited]
        return (
            f"Spectra({self.name or 'unnamed'}: {self.n_periods} periods of {self.period_samples} at "
            f"{self.fs_hz:g} Hz, {self.n_spoiled} spoiled, settling {self.settle_samples}; "
            f"{len(f_hz)} excited lines {f_hz[0]:g} .. {f_hz[-1]:g} Hz)"
        )


@dataclass(repr=False)
class Frf:
    """Frequency response at the excited lines, with the variance of its mean.

    Attributes
    ----------
    line : (F,) int
    f_hz : (F,) [Hz]
    g : (F,) complex
        mean(Y)/mean(U), unit y over u (source, eq. 4.10); the mean over realisations (eq. 5.14).
    var_g : (F,)
        Variance E|error|^2 of g (source, eqs. 7.29, 5.14).
    u, y : (F,) complex
        Means over periods; with several realisations averaged after turning each by the phase of its u, so
        that u is a mean amplitude.
    var_u, var_y, cov_yu : (F,)
        Sample (co)variances of one period (source, eq. 4.11), averaged over realisations.
    n_periods : int
        Good periods of all realisations.
    n_realisations, n_spoiled, settle_samples, period_samples : int
    fs_hz : float
    hold : {"zoh", "none"}
        "zoh": u is a command that was held over each sample.
    u_unit, y_unit, name : str
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
    hold: str = "none"
    u_unit: str = ""
    y_unit: str = ""
    name: str = ""

    def to_control(self) -> control.FRD:
        """Return the response as `control.FRD`, frequencies in rad/s."""
        import control

        return control.FRD(self.g, 2 * np.pi * self.f_hz)

    @classmethod
    def from_arrays(
        cls, f_hz: np.ndarray, g: np.ndarray, var_g: np.ndarray | None = None, *, fs_hz: float = float("nan")
    ) -> Frf:
        """Take a response measured elsewhere.

        Parameters
        ----------
        f_hz : (F,) array_like
            Hz; need not be on a grid.
        g : (F,) complex array_like
        var_g : (F,) array_like, optional
            Variance of g, taken as known exactly; default: not known, NaN.
        fs_hz : float, optional
            Sample rate [Hz], for models in z and held inputs.

        Returns
        -------
        Frf
            With unit input: u is 1 and y is g. Lines are numbered 1 .. F and `period_samples` is 0.

        Raises
        ------
        ValueError
            Unequal lengths.
        """
        f_hz, g = np.asarray(f_hz, float), np.asarray(g, complex)
        variance = np.full(len(g), np.nan) if var_g is None else np.asarray(var_g, float)
        if f_hz.shape != g.shape or variance.shape != g.shape or g.ndim != 1:
            raise ValueError(f"f_hz, g and var_g have shapes {f_hz.shape}, {g.shape} and {variance.shape}")
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
        )

    @classmethod
    def from_control(cls, frd: control.FRD, *, var_g: np.ndarray | None = None) -> Frf:
        """Take a single-input single-output `control.FRD`.

        Parameters
        ----------
        frd : control.FRD
            Frequencies in rad/s.
        var_g : (F,) array_like, optional
            Variance of the response, which an FRD does not carry; default: not known, NaN.

        Returns
        -------
        Frf
            As `from_arrays`.

        Raises
        ------
        ValueError
            More than one input or output, or var_g of another length.
        """
        response = np.asarray(frd(1j * frd.omega, squeeze=False))
        if response.shape[:2] != (1, 1):
            raise ValueError(f"the FRD has (outputs, inputs) {response.shape[:2]}, not (1, 1)")
        fs_hz = 1 / frd.dt if frd.dt not in (None, 0, True) else float("nan")
        return cls.from_arrays(np.asarray(frd.omega) / (2 * np.pi), response[0, 0], var_g, fs_hz=fs_hz)

    @classmethod
    def from_pandas(cls, frame: pandas.DataFrame, *, fs_hz: float = float("nan")) -> Frf:
        """Take a frame with columns f_hz, g_re, g_im and, where it is known, std_g.

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

    def plot(self) -> matplotlib.figure.Figure:
        """Gain and phase over frequency, with the noise's standard deviation in the same dB axis."""
        from gsid import plots

        return plots.frf(self)

    def _summary(self) -> dict[str, str]:
        error = np.sqrt(self.var_g) / np.abs(self.g)
        gain_unit = f" {self.y_unit or '1'}/{self.u_unit or '1'}" if self.y_unit or self.u_unit else ""
        peak = int(np.argmax(np.abs(self.g)))
        return {
            "lines": f"{len(self.line)}, {self.f_hz[0]:g} .. {self.f_hz[-1]:g} Hz",
            "periods": f"{self.n_periods} good, {self.n_spoiled} spoiled",
            "period": f"{self.period_samples} samples at {self.fs_hz:g} Hz",
            "realisations": f"{self.n_realisations}",
            "settling": f"{self.settle_samples} samples",
            "largest gain": f"{abs(self.g[peak]):.4g}{gain_unit} at {self.f_hz[peak]:g} Hz",
            "std / gain": f"median {np.median(error):.2g}, largest {error.max():.2g}",
        }

    def __repr__(self) -> str:
        rows = "\n".join(f"  {key:26}{value}" for key, value in self._summary().items())
        return f"Frf {self.name or 'unnamed'}\n{rows}"

    def _repr_html_(self) -> str:
        from html import escape

        summary = self._summary().items()
        rows = "".join(f"<tr><th>{key}</th><td>{escape(value)}</td></tr>" for key, value in summary)
        return f"<table><caption>Frf {escape(self.name or 'unnamed')}</caption>{rows}</table>"


def spectra(record: Record, *, period: int | None = None, settle: int | None = None) -> Spectra:
    """Transform each good period of a record.

    Parameters
    ----------
    record : Record
    period, settle : int, optional
        Samples; default: what the record states, else what the data show.

    Returns
    -------
    Spectra

    Raises
    ------
    InputError
        u does not repeat, fewer than two good periods, or u without any line of its own.
    """
    periods = split_periods(record, period=period, settle=settle)
    line = np.arange(periods.period_samples // 2 + 1, dtype=np.uint32)
    U, Y = (period_lines(x, line, periods.settle_samples) for x in (periods.u, periods.y))
    excited = excited_lines(U, periods.period_samples)
    if not excited.any():
        what = "u has no line that stands out of its own noise"
        raise InputError(what, record.name, hint="excite the axis more, or name the input with --u")
    return Spectra(
        fs_hz=record.fs_hz,
        period_samples=periods.period_samples,
        line=line.astype(int),
        U=U,
        Y=Y,
        n_spoiled=periods.n_spoiled,
        settle_samples=periods.settle_samples,
        excited=excited,
        hold=record.hold,
        u_unit=record.u_unit,
        y_unit=record.y_unit,
        name=record.name,
    )


def excited_lines(U: np.ndarray, n_period: int) -> np.ndarray:
    """Tell the excited lines from what a bench adds to them.

    A current loop answers the excited lines with harmonics that repeat as well as the lines do, so that noise
    alone does not tell them apart. But a designed spectrum is smooth and its by-products lie a step below:
    lines are sorted by size, and the excitation ends where two neighbours are most apart, the upper above 1 %
    of the largest and by a factor of 2 at least. Without such a step every line above 1 % counts. The mean
    must stand 12 dB out of its own noise besides.

    Parameters
    ----------
    U : (P, K) complex
        Lines 0 .. N/2 of the input, one row per period.
    n_period : int
        N, samples.

    Returns
    -------
    (K,) bool; never lines 0 and N/2, which have no phase
    """
    mean = U.mean(axis=0)
    size = np.abs(mean)
    size[0] = 0
    size[n_period / 2 == np.arange(len(size))] = 0
    ordered = np.sort(size)[::-1]
    n_strong = np.count_nonzero(ordered > SHARE_OF_LARGEST * ordered[0])
    if n_strong == 0:
        return np.zeros(len(size), bool)
    step = ordered[:n_strong] / np.maximum(ordered[1 : n_strong + 1], np.finfo(float).tiny)
    last = int(np.argmax(step))
    smallest = ordered[last] if step[last] >= GAP else ordered[n_strong - 1]
    excited = size >= smallest
    strong = U[:, excited]
    variance_of_mean = _covariance(strong, strong).real / len(U)
    excited[excited] = size[excited] ** 2 > ABOVE_NOISE * variance_of_mean
    return excited


def frf(
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
    band: tuple[float, float] | None = None,
) -> Frf:
    """Estimate the frequency response at the lines that every realisation excites.

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
        One per realisation.
    period, settle : int, optional
        Samples; default: what each record states, else what its data show. Not looked at for Spectra.
    band : (lo, hi), optional
        Only lines within [Hz].

    Returns
    -------
    Frf
        FRF-1, FRF-2 (source, eqs. 4.10, 4.11, 7.29; 5.14 over realisations).

    Raises
    ------
    InputError
        As `spectra`; realisations of unequal period, sample rate, hold or units; no common line in the band.
    ValueError
        No record.
    """
    records = [records] if isinstance(records, Record | Spectra) else list(records)
    if not records:
        raise ValueError("no record to estimate a frequency response from")
    parts = [r if isinstance(r, Spectra) else spectra(r, period=period, settle=settle) for r in records]
    first = parts[0]
    for part in parts[1:]:
        require_same(first, part)
    chosen = np.logical_and.reduce([part.excited for part in parts])
    if band is not None:
        chosen &= (first.f_hz >= band[0]) & (first.f_hz <= band[1])
    if not chosen.any():
        where = "" if band is None else f" within {band[0]:g}:{band[1]:g} Hz"
        f_hz = first.f_hz[first.excited]
        raise InputError(
            f"no line{where} is excited in every record",
            first.name,
            None,
            f"{first.name or 'the first record'} has lines {f_hz[0]:g} .. {f_hz[-1]:g} Hz",
        )
    each = [_single(part, chosen) for part in parts]
    return each[0] if len(each) == 1 else _over_realisations(each)


FEW_LINES = 10  # summing them at every sample is as quick as transforming
"""Up to so many lines `StreamingFrf` sums at every sample by itself."""


class StreamingFrf:
    """The measurement as it runs beside a controller: the C core, sample by sample, in fixed memory.

    Parameters
    ----------
    fs_hz : float
        Sample rate [Hz].
    period_samples : int
        N.
    line : (F,) int
        1 <= line < N/2.
    settle_samples : int
        Thrown away first.
    u_known : (F,) complex, optional
        Lines of the input when it is known exactly; default: the input is measured.
    precision : {"double", "single"}
        Build of the core.
    engine : {"auto", "direct", "spread"}
        How the lines of a period are made: summed at every sample, or by a transform spread over the samples
        of the next period (N even, N/2 without prime factors above 7). They agree to rounding. "auto" takes
        the transform where it is possible and there are more than `FEW_LINES` lines.

    Raises
    ------
    ValueError
        An unknown precision or engine, or u_known of another length than line.
    GsidError
        The core refuses the configuration.
    """

    def __init__(
        self,
        fs_hz: float,
        period_samples: int,
        line: np.ndarray,
        *,
        settle_samples: int = 0,
        u_known: np.ndarray | None = None,
        precision: str = "double",
        engine: str = "auto",
    ) -> None:
        if precision not in ("double", "single"):
            raise ValueError(f"precision must be double or single, not {precision!r}")
        if engine not in ("auto", "direct", "spread"):
            raise ValueError(f"engine must be auto, direct or spread, not {engine!r}")
        is_double = precision == "double"
        self._ffi, self._lib = (ffi, lib) if is_double else (ffi32, lib32)
        self._real, self._cplx = (np.float64, np.complex128) if is_double else (np.float32, np.complex64)
        self.fs_hz = float(fs_hz)
        self.line = np.ascontiguousarray(line, np.uint32)
        self._known = None if u_known is None else np.ascontiguousarray(u_known, self._cplx)
        if self._known is not None and self._known.shape != self.line.shape:
            raise ValueError(f"u_known has shape {self._known.shape}, line {self.line.shape}")
        self._twiddle = np.empty(period_samples, self._cplx)
        status = self._lib.gsid_twiddle_fill(period_samples, self._pointer(self._twiddle))
        check(status, "making the twiddle table")
        cfg = self._ffi.new("gsid_frf_cfg *")
        cfg.n_period, cfg.n_lines, cfg.n_settle = period_samples, len(self.line), settle_samples
        cfg.line = self._ffi.from_buffer("uint32_t[]", self.line)
        cfg.twiddle = self._pointer(self._twiddle)
        cfg.u_known = self._ffi.NULL if self._known is None else self._pointer(self._known)
        spread_size = self._lib.gsid_frf_spread_mem_size(cfg)  # 0: not possible
        if engine == "auto":
            engine = "spread" if spread_size > 0 and len(self.line) > FEW_LINES else "direct"
        self.engine = engine
        size = spread_size if engine == "spread" else self._lib.gsid_frf_mem_size(cfg)
        self._memory = np.zeros(size // 16 + 1, complex)
        self._frf = self._ffi.new("gsid_frf *")
        memory = self._ffi.from_buffer(self._memory)
        init = self._lib.gsid_frf_init_spread if engine == "spread" else self._lib.gsid_frf_init
        check(init(self._frf, cfg, memory, len(memory)), "setting up the measurement")

    @property
    def n_periods(self) -> int:
        """Good periods in the mean so far."""
        return self._frf.n_periods

    @property
    def n_spoiled(self) -> int:
        """Periods left out because samples of them were lost."""
        return self._frf.n_spoiled

    def step(self, u: np.ndarray, y: np.ndarray, valid: np.ndarray | None = None) -> int:
        """Take the next samples.

        Parameters
        ----------
        u, y : (n,) array_like
            Input and output at the same instants, finite where valid; u is not looked at when it is known.
        valid : (n,) bool, optional
            False: the sample was lost, and its period is left out.

        Returns
        -------
        int
            Good periods in the mean so far.

        Raises
        ------
        ValueError
            Unequal lengths.
        GsidError
            A sample is not finite: none of the block was taken.
        """
        u = np.atleast_1d(np.ascontiguousarray(u, np.float64))
        y = np.atleast_1d(np.ascontiguousarray(y, np.float64))
        good = None if valid is None else np.atleast_1d(np.ascontiguousarray(valid, bool)).view(np.uint8)
        if u.shape != y.shape or (good is not None and good.shape != u.shape):
            shapes = [x.shape for x in (u, y, good) if x is not None]
            raise ValueError(f"u, y and valid must be of one length, not {shapes}")
        if self._lib is lib:
            flags = ffi.NULL if good is None else ffi.from_buffer("uint8_t[]", good)
            block = ffi.from_buffer("double[]", u), ffi.from_buffer("double[]", y)
            check(lib.gsid_batch_frf_step(self._frf, len(u), *block, flags), "taking a block of samples")
        else:
            self._step_single(u, y, good)
        check(
            self._lib.gsid_frf_finish(self._frf), "adding the last period"
        )  # there is no tick to keep short
        return self.n_periods

    def _step_single(self, u: np.ndarray, y: np.ndarray, good: np.ndarray | None) -> None:
        counts = np.ones(len(u), bool) if good is None else good.astype(bool)
        needed = [y] if self._known is not None else [u, y]
        with np.errstate(over="ignore"):
            is_finite = all(np.isfinite(x.astype(np.float32)[counts]).all() for x in needed)
        if not is_finite:
            check(lib.GSID_E_NONFINITE, "taking a block of samples")
        for u_n, y_n, is_good in zip(u.tolist(), y.tolist(), counts.tolist(), strict=True):
            if is_good:
                lib32.gsid_frf_step(self._frf, u_n, y_n)
            else:
                lib32.gsid_frf_skip(self._frf, 1)

    def result(self) -> Frf:
        """Read the measurement so far.

        Returns
        -------
        Frf

        Raises
        ------
        GsidError
            Fewer than 2 good periods.
        """
        n = len(self.line)
        complex_fields = {name: np.empty(n, self._cplx) for name in ("g", "y", "u", "cov_yu")}
        real_fields = {name: np.empty(n, self._real) for name in ("var_g", "var_y", "var_u")}
        out = self._ffi.new("gsid_frf_out *")
        for name, array in complex_fields.items():
            setattr(out, name, self._pointer(array))
        for name, array in real_fields.items():
            setattr(out, name, self._ffi.from_buffer("gsid_real[]", array))
        check(self._lib.gsid_frf_result(self._frf, out), "reading the frequency response")
        cfg = self._frf.cfg
        return Frf(
            line=self.line.astype(int),
            f_hz=self.line * (self.fs_hz / cfg.n_period),
            n_periods=self.n_periods,
            n_realisations=1,
            n_spoiled=self.n_spoiled,
            settle_samples=cfg.n_settle,
            period_samples=cfg.n_period,
            fs_hz=self.fs_hz,
            **{name: array.astype(np.complex128) for name, array in complex_fields.items()},
            **{name: array.astype(np.float64) for name, array in real_fields.items()},
        )

    def _pointer(self, array: np.ndarray):
        return self._ffi.from_buffer("gsid_cplx[]", array)

    def __repr__(self) -> str:
        periods = f"{self.n_periods} good periods, {self.n_spoiled} spoiled"
        return f"StreamingFrf({len(self.line)} lines, {periods}, {self.engine} engine)"


def period_lines(periods: np.ndarray, line: np.ndarray, settle_samples: int) -> np.ndarray:
    """Lines (uint32) of each row of `periods` (P, N), referred to the record's first sample, (P, K)."""
    n_periods, n_period = periods.shape
    periods = np.ascontiguousarray(periods, np.float64)
    lines = np.empty((n_periods, len(line)), complex)
    with _planner:
        status = lib.gsid_batch_spectra(
            n_periods,
            n_period,
            ffi.from_buffer("double[]", periods),
            len(line),
            ffi.from_buffer("uint32_t[]", line),
            ffi.from_buffer("gsid_cplx[]", lines),
        )
    check(status, "transforming the periods")
    shift = settle_samples % n_period
    if shift:  # settling not a whole number of periods; the angle is reduced with integers
        lines *= np.exp(-2j * np.pi * (line.astype(np.int64) * shift % n_period) / n_period)
    return lines


def _covariance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sample covariance of a and conj(b) over their first axis (source, eq. 4.11)."""
    return np.einsum("pk,pk->k", a - a.mean(axis=0), (b - b.mean(axis=0)).conj()) / (len(a) - 1)


def require_same(first: Spectra, other: Spectra) -> None:
    """Refuse to average records of unequal period, rate, hold or units (InputError)."""
    for what in ("period_samples", "fs_hz", "hold", "u_unit", "y_unit"):
        ours, theirs = getattr(first, what), getattr(other, what)
        if ours != theirs:
            raise InputError(
                f"the records differ in {what}",
                other.name,
                f"{theirs!r}, not {ours!r} as in {first.name or 'the first'}",
                "average realisations of one experiment only",
            )


def _single(part: Spectra, chosen: np.ndarray) -> Frf:
    """Frequency response of one realisation at the chosen lines."""
    U, Y = part.U[:, chosen], part.Y[:, chosen]
    u, y = U.mean(axis=0), Y.mean(axis=0)
    var_u, var_y, cov_yu = _covariance(U, U).real, _covariance(Y, Y).real, _covariance(Y, U)
    g = y / u
    # eq. 7.29 times |G|^2, so that no Y stands in a denominator: an antiresonance may measure 0
    variance = (var_y + np.abs(g) ** 2 * var_u - 2 * np.real(cov_yu * g.conj())) / np.abs(u) ** 2
    return Frf(
        line=part.line[chosen],
        f_hz=part.f_hz[chosen],
        g=g,
        var_g=np.maximum(variance, 0) / part.n_periods,
        u=u,
        y=y,
        var_u=var_u,
        var_y=var_y,
        cov_yu=cov_yu,
        n_periods=part.n_periods,
        n_realisations=1,
        n_spoiled=part.n_spoiled,
        settle_samples=part.settle_samples,
        period_samples=part.period_samples,
        fs_hz=part.fs_hz,
        hold=part.hold,
        u_unit=part.u_unit,
        y_unit=part.y_unit,
        name=part.name,
    )


def _over_realisations(each: list[Frf]) -> Frf:
    """Mean of the responses and of their levels (source, eq. 5.14)."""
    first, m = each[0], len(each)
    turn = [np.exp(-1j * np.angle(one.u)) for one in each]
    return Frf(
        line=first.line,
        f_hz=first.f_hz,
        g=sum(one.g for one in each) / m,
        var_g=sum(one.var_g for one in each) / m**2,
        u=sum(one.u * t for one, t in zip(each, turn, strict=True)) / m,
        y=sum(one.y * t for one, t in zip(each, turn, strict=True)) / m,
        var_u=sum(one.var_u for one in each) / m,
        var_y=sum(one.var_y for one in each) / m,
        cov_yu=sum(one.cov_yu for one in each) / m,
        n_periods=sum(one.n_periods for one in each),
        n_realisations=m,
        n_spoiled=sum(one.n_spoiled for one in each),
        settle_samples=first.settle_samples,
        period_samples=first.period_samples,
        fs_hz=first.fs_hz,
        hold=first.hold,
        u_unit=first.u_unit,
        y_unit=first.y_unit,
        name=", ".join(one.name for one in each if one.name),
    )


callable_as(frf)
