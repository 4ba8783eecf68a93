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
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from gsid._callable import callable_as
from gsid.errors import InputError, NotPeriodicError
from gsid.record import Record
from gsid.spectra import (
    Realisation,
    Spectra,
    common_lines,
    covariance,
    listed,
    realisations,
    rejected_lines,
    require_same,
    sample_variance,
)

if TYPE_CHECKING:
    import control
    import matplotlib.figure
    import pandas

    from gsid.local_polynomial import Unsettled
    from gsid.tones import Tone

_log = logging.getLogger("gsid.frf")

SHORTEST_WINDOW = 4  # samples: below, no line is apart from the mean and from half of the sample rate
SAME_INPUT = 0.1  # inputs of parts of one realisation differ by less, as a share


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
    hold : {"zoh", "none"} or None
        As in `gsid.record.Record`.
    u_unit, y_unit, name : str
    removed : tuple of Tone
        Periodic disturbances that were taken off the output first.
    n_dof : float
        Degrees of freedom of the variances, counted in complex numbers; default `n_periods - n_realisations`;
        infinite: they are known.
    rejected_hz : (R,) [Hz]
        Lines with an input that were left out: too weak, lost in its noise, or not in every record.
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
    hold: str | None = "none"
    u_unit: str = ""
    y_unit: str = ""
    name: str = ""
    removed: tuple[Tone, ...] = ()
    n_dof: float | None = None
    rejected_hz: np.ndarray = field(default_factory=lambda: np.empty(0))
    method: str = "periods"

    def __post_init__(self) -> None:
        if self.n_dof is None:
            self.n_dof = self.n_periods - self.n_realisations

    @property
    def coherence(self) -> np.ndarray:
        """Coherence of input and output over periods or windows, (F,), 0 .. 1 (source, eq. 5.3).

        Distortion repeats with the period, and so lowers it only where the excitation does not repeat.
        """
        rest = self.var_y + np.abs(self.g) ** 2 * self.var_u - 2 * np.real(self.cov_yu * self.g.conj())
        gain = np.abs(self.g * self.u) ** 2
        share = 1 - 1 / (self.n_dof + 1)  # of the scatter about the mean, which the data themselves have
        return gain / (gain + share * np.maximum(rest, 0))

    def at(self, use: np.ndarray) -> Frf:
        """The response at some of its lines only: use, (F,) bool."""
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
            Unequal lengths, a frequency below 0 or a response that is no finite number.
        """
        f_hz, g = np.asarray(f_hz, float), np.asarray(g, complex)
        variance = np.full(len(g), np.nan) if var_g is None else np.asarray(var_g, float)
        if f_hz.shape != g.shape or variance.shape != g.shape or g.ndim != 1:
            raise ValueError(f"f_hz, g and var_g have shapes {f_hz.shape}, {g.shape} and {variance.shape}")
        sound = np.isfinite(g) & np.isfinite(f_hz) & (f_hz >= 0)
        if not sound.all():
            bad = int(np.flatnonzero(~sound)[0])
            raise ValueError(f"line {bad} of the response is {g[bad]} at {f_hz[bad]} Hz: leave it out")
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
        with np.errstate(divide="ignore", invalid="ignore"):  # of a dead output
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
    window: int | None = None,
    merge: bool = False,
    min_input: float = 0.0,
) -> Frf:
    """Estimate the frequency response at the lines that every realisation excites.

    A record whose input does not repeat is cut into windows, with a warning: see `window`.

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
    window : int, optional
        Samples of Hann windows to average over, as is done for an input that does not repeat (H1, WIN-1);
        default then the largest power of two of which the record holds 8.
    merge : bool
        The records are parts of one realisation: put their periods together (FRF-4) instead of averaging
        their responses.
    min_input : float
        Leave out lines whose input amplitude is smaller, unit of u.

    Returns
    -------
    Frf
        FRF-1, FRF-2 (source, eqs. 4.10, 4.11, 7.29; 5.14 over realisations); LPM-1, LPM-2 with `lpm`.

    Raises
    ------
    InputError
        As `spectra`; realisations of unequal period, sample rate, hold or units; no common line in the band;
        parts of one realisation whose inputs differ.
    NotPeriodicError
        An input that does not repeat, where windows are no way out: the record is short, or `merge` is asked
        for, or there are Spectra beside it.
    ValueError
        No record; Spectra where samples are needed; a window of less than 4 samples; options that exclude
        each other; a band upside down.
    TypeError
        Something else than records, as samples or a file's name; a band that is not two numbers.
    """
    if window is not None and window < SHORTEST_WINDOW:
        raise ValueError(f"a window has {SHORTEST_WINDOW} samples at least, not {window}")
    asked = {"remove_periodic": remove_periodic, "lpm": lpm, "window": window, "merge": merge}
    asked = [name for name, value in (asked | {"min_input": min_input > 0}).items() if value]
    if reference is not None:
        if asked:
            raise ValueError(f"{asked[0]} is for open loops: in a closed one u answers y")
        from gsid.closed_loop import closed_loop_frf

        result = closed_loop_frf(records, reference, period=period, settle=settle, band=band)
        _say_rejected(result)
        return result
    if lpm + merge + (window is not None) > 1:
        raise ValueError("lpm, window and merge exclude each other")
    records = listed(records)
    has_samples = not any(isinstance(record, Spectra) for record in records)
    if not has_samples and (remove_periodic or lpm or window):
        raise ValueError(f"{asked[0]} needs the samples: give records, not their spectra")
    removed: list[Tone] = []
    if remove_periodic:
        records = [_without_tones(record, removed, period, settle) for record in records]
    parts, window = _parts(records, period, settle, lpm, window, merge)
    if window:
        from gsid.windows import windowed_frf

        result = windowed_frf(records, window, settle=settle, band=band, min_input=min_input)
    else:
        result = _at_lines(parts, band, merge, min_input)
    _say_rejected(result)
    return replace(result, removed=tuple(removed))


def _say_rejected(result: Frf) -> None:
    left_out = result.rejected_hz
    if len(left_out):
        few = ", ".join(f"{f:g}" for f in left_out[:8]) + ", ..." * (len(left_out) > 8)
        why = "too weak" if result.n_realisations == 1 else "too weak, or not in every record"
        _log.warning("lines left out, their input being %s: %d (%s Hz)", why, len(left_out), few)


def _parts(
    records: list[Record | Spectra],
    period: int | None,
    settle: int | None,
    lpm: bool,
    window: int | None,
    merge: bool,
) -> tuple[list[Realisation] | list[Unsettled], int | None]:
    """Realisations to estimate from, or none and the windows to cut the records into."""
    if window is not None:
        return [], window
    if lpm:
        from gsid.local_polynomial import unsettled

        return unsettled(records, period=period, settle=settle), None
    try:
        return realisations(records, period=period, settle=settle), None
    except NotPeriodicError:
        # periods that are merged, or were transformed before, are not to become windows
        if merge or any(isinstance(record, Spectra) for record in records):
            raise
        from gsid.windows import default_window

        window = default_window(records)
        if window is None:
            raise
        return [], window


def _at_lines(
    parts: list[Realisation] | list[Unsettled],
    band: tuple[float, float] | None,
    merge: bool,
    min_input: float,
) -> Frf:
    """Estimate at the lines that every part excites with `min_input`; those left out are kept in mind."""
    line = common_lines(parts, band)
    each = [_single(part, line) if isinstance(part, Realisation) else part.frf(line) for part in parts]
    if min_input > 0:
        strong = np.min([np.abs(one.u) for one in each], axis=0) >= min_input
        if not strong.any():
            most = max(np.abs(one.u).max() for one in each)
            hint = f"the largest has {most:.4g}"
            raise InputError("no line has that much input", each[0].name, f"{min_input:g}", hint)
        line, each = line[strong], [one.at(strong) for one in each]
    rejected = parts[0].f_hz[rejected_lines(parts, line, band)]
    average = merged if merge else _over_realisations
    return replace(each[0] if len(each) == 1 else average(each), rejected_hz=rejected)


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
    U, Y = part.input(line), part.output(line)
    u, y = U.mean(axis=0), Y.mean(axis=0)
    var_y, var_u, cov_yu = sample_variance(Y), np.zeros(len(line)), np.zeros(len(line), complex)
    if not part.u_repeats:
        var_u, cov_yu = sample_variance(U), covariance(Y, U)
    return Frf(
        line=line,
        f_hz=part.f_hz[line],
        **_response(u, y, var_u, var_y, cov_yu, part.n_periods),
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


def _response(
    u: np.ndarray, y: np.ndarray, var_u: np.ndarray, var_y: np.ndarray, cov_yu: np.ndarray, n_periods: int
) -> dict[str, np.ndarray]:
    """Eq: FRF-2"""
    g = y / u
    # eq. 7.29 times |G|^2, so that no Y stands in a denominator: an antiresonance may measure 0
    variance = (var_y + np.abs(g) ** 2 * var_u - 2 * np.real(cov_yu * g.conj())) / np.abs(u) ** 2
    var_g = np.maximum(variance, 0) / n_periods
    return {"g": g, "var_g": var_g, "u": u, "y": y, "var_u": var_u, "var_y": var_y, "cov_yu": cov_yu}


def merged(each: Sequence[Frf]) -> Frf:
    """Put parts of one realisation together, as if they had been measured one after the other (FRF-4).

    Parameters
    ----------
    each : sequence of Frf
        By periods, at the same lines.

    Returns
    -------
    Frf

    Raises
    ------
    InputError
        Their inputs differ by more than a tenth, or their periods, sample rates, holds or units differ.
    ValueError
        No part, other lines, or a response that was not estimated by periods.
    """
    if not each or any(
        one.method != "periods" or one.n_realisations != 1 or np.isinf(one.n_dof) for one in each
    ):
        raise ValueError("only responses of one realisation each, by periods, are merged")
    whole = each[0]
    for part in each[1:]:
        require_same(whole, part)
        if not np.array_equal(part.line, whole.line):
            raise ValueError("the parts have different lines")
        whole = _merged_pair(whole, part)
    return whole


def _merged_pair(a: Frf, b: Frf) -> Frf:
    if np.sum(np.abs(a.u - b.u) ** 2) > SAME_INPUT**2 * np.sum(np.abs(a.u) ** 2):
        hint = (
            "leave --merge out: realisations are averaged; parts of one begin at the same point of the period"
        )
        raise InputError("the inputs of the parts differ", b.name, None, hint)
    n_a, n_b = a.n_periods, b.n_periods
    n = n_a + n_b
    du, dy, weight = b.u - a.u, b.y - a.y, n_a * n_b / n

    def covariance_of(of_a: np.ndarray, of_b: np.ndarray, product: np.ndarray) -> np.ndarray:
        return ((n_a - 1) * of_a + (n_b - 1) * of_b + weight * product) / (n - 1)

    var_u = covariance_of(a.var_u, b.var_u, np.abs(du) ** 2)
    var_y = covariance_of(a.var_y, b.var_y, np.abs(dy) ** 2)
    cov_yu = covariance_of(a.cov_yu, b.cov_yu, dy * du.conj())
    return replace(
        a,
        **_response(a.u + du * (n_b / n), a.y + dy * (n_b / n), var_u, var_y, cov_yu, n),
        n_periods=n,
        n_spoiled=a.n_spoiled + b.n_spoiled,
        n_dof=None,
        removed=a.removed + b.removed,
        rejected_hz=np.union1d(a.rejected_hz, b.rejected_hz),
        name=", ".join(name for name in (a.name, b.name) if name),
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
