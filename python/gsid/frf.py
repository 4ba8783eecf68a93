"""Frequency response and its uncertainty from periodic records.

The mean over periods estimates the lines of input and output, their scatter the noise (source, eqs. 4.10 and
4.11):

    G = mean(Y) / mean(U)
    var G = |G|^2 [var_Y/|Y|^2 + var_U/|U|^2 - 2 Re(cov_YU / (Y conj U))] / P      (source, eq. 7.29)

With M realisations, G is the mean of theirs and its variance 1/M^2 of the sum of theirs (source, eq. 5.14).
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gsid._callable import callable_as
from gsid.record import Record
from gsid.spectra import Realisation, Spectra, common_lines, covariance, realisations

if TYPE_CHECKING:
    import control
    import matplotlib.figure
    import pandas

    from gsid.tones import Tone

_log = logging.getLogger("gsid.frf")


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
    removed : tuple of Tone
        Periodic disturbances that were taken off the output first.
    n_dof : int
        Degrees of freedom of the variances, counted in complex numbers; default `n_periods - n_realisations`.
    method : {"periods", "lpm", "windows"}
        From what the variances come: the scatter over periods, the local polynomial method, or windows over a
        record that is not periodic.
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
    removed: tuple[Tone, ...] = ()
    n_dof: int | None = None
    method: str = "periods"

    def __post_init__(self) -> None:
        if self.n_dof is None:
            self.n_dof = self.n_periods - self.n_realisations

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


def frf(
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
    band: tuple[float, float] | None = None,
    remove_periodic: bool = False,
    reference: str | None = None,
    lpm: bool = False,
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
    remove_periodic : bool
        Take periodic disturbances off the output first (`gsid.noise`); one at a line of the period looks like
        the response, and stays.
    reference : str, optional
        Of records measured in a closed loop: the column of its reference (`gsid.closed_loop`).
    lpm : bool
        Take the transient out by the local polynomial method instead of waiting for it to die out; one period
        is enough.

    Returns
    -------
    Frf
        FRF-1, FRF-2 (source, eqs. 4.10, 4.11, 7.29; 5.14 over realisations); LPM-1, LPM-2 with `lpm`.

    Raises
    ------
    InputError
        As `spectra`; realisations of unequal period, sample rate, hold or units; no common line in the band.
    ValueError
        No record; Spectra, or records of a closed loop, to take disturbances or transients off.
    """
    if reference is not None:
        if remove_periodic or lpm:
            raise ValueError(
                "disturbances and transients are taken off in open loops only: u holds them, too"
            )
        from gsid.closed_loop import closed_loop_frf

        return closed_loop_frf(records, reference, period=period, settle=settle, band=band)
    records = [records] if isinstance(records, Record | Spectra) else list(records)
    if (remove_periodic or lpm) and any(isinstance(record, Spectra) for record in records):
        raise ValueError("disturbances and transients are taken off records, not off their spectra")
    removed: list[Tone] = []
    if remove_periodic:
        records = [_without_tones(record, removed, period, settle) for record in records]
    if lpm:
        from gsid.local_polynomial import unsettled

        parts = unsettled(records, period=period, settle=settle)
    else:
        parts = realisations(records, period=period, settle=settle)
    line = common_lines(parts, band)
    each = [part.frf(line) if lpm else _single(part, line) for part in parts]
    result = each[0] if len(each) == 1 else _over_realisations(each)
    return replace(result, removed=tuple(removed))


def _without_tones(record: Record, removed: list[Tone], period: int | None, settle: int | None) -> Record:
    """The record less its periodic disturbances, which are said and added to `removed`."""
    from gsid.noise import without_tones

    cleaned, tones = without_tones(record, period=period, settle=settle)
    unit = f" {record.y_unit}" if record.y_unit else ""
    taken = ", ".join(f"{tone.name} of {tone.amplitude:.3g}{unit}" for tone in tones) or "nothing"
    _log.info("%s: taken off as periodic disturbance: %s", record.name or "record", taken)
    removed += tones
    return cleaned


def _single(part: Realisation, line: np.ndarray) -> Frf:
    """Frequency response of one realisation at these lines."""
    U, Y = part.U[:, line], part.output(line)
    u, y = U.mean(axis=0), Y.mean(axis=0)
    var_y, var_u, cov_yu = covariance(Y, Y).real, np.zeros(len(line)), np.zeros(len(line), complex)
    if len(U) > 1:
        var_u, cov_yu = covariance(U, U).real, covariance(Y, U)
    g = y / u
    # eq. 7.29 times |G|^2, so that no Y stands in a denominator: an antiresonance may measure 0
    variance = (var_y + np.abs(g) ** 2 * var_u - 2 * np.real(cov_yu * g.conj())) / np.abs(u) ** 2
    return Frf(
        line=line,
        f_hz=part.f_hz[line],
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
        n_dof=sum(one.n_dof for one in each),
        method=first.method,
    )


callable_as(frf)
