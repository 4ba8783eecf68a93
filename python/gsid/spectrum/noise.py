"""Noise of a record: its spectrum with an interval, its variance, and its periodic disturbances.

It is intended for a record with zero input (thesis, section 4.4.1), which shows the noise of the sensor and
disturbances from rotating machines nearby. For an excited record, the mean period is subtracted first.
"""

from __future__ import annotations

import json
import logging
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import gammaincinv

from gsid.base.arguments import whole_samples
from gsid.base.errors import InputError
from gsid.base.files import write_atomically
from gsid.base.json_files import read_json
from gsid.base.plottable import Plottable
from gsid.records.periods import find_period, split_periods
from gsid.records.record import Record, check_range
from gsid.records.refresh import refresh_rate_hz
from gsid.spectrum.images import mark_images
from gsid.spectrum.tones import Tone, find_tones, n_subtracted

_log = logging.getLogger(__name__)

SEGMENTS = 16  # of a record without a known period: the resolution is coarser than 1/T by this factor
FEWEST = 256  # samples
SHORTEST = 8  # samples of a window: Hann's reaches two lines, and one line must be free of 0 Hz and of fs/2
FORMAT = 1  # of the file of a noise model
CORRELATION = 1 / 36  # of the powers of Hann windows that overlap by half


@dataclass(repr=False)
class Noise(Plottable):
    """Noise of one record.

    Attributes
    ----------
    f_hz : (K,) float
        Above 0, up to half of the sample rate [Hz].
    psd : (K,) float
        One-sided power spectral density without the periodic disturbances, unit of y squared per Hz.
    n_dof : float
        Degrees of freedom of each value of `psd` (NOI-3).
    tones : list of Tone
        Periodic disturbances, the largest first.
    variance, variance_rest : float
        Variance of y about its trend or its mean period, with and without the disturbances; unit of y
        squared.
    mean, std_mean : float
        Mean output, without the disturbances, and its standard deviation; unit of y (NOI-4).
    drift, std_drift : float
        Slope of a straight line through the output, and its standard deviation; unit of y per s (NOI-4). NaN
        if the record has fewer than 3 windows.
    alpha : float
        False-alarm rate: probability of detecting a disturbance in noise that has none.
    segment_samples : int
        Length of the windows that `psd` is averaged over.
    period_samples, settle_samples : int
        Period and settling of the excitation that was subtracted; period 0: zero input.
    n_samples, n_lost : int
    fs_hz : float
    y_unit, name : str
    refresh_hz : float
        Rate at which the sensor of y is refreshed [Hz]; 0: its values do not repeat.
    """

    f_hz: np.ndarray
    psd: np.ndarray
    n_dof: float
    tones: list[Tone]
    variance: float
    variance_rest: float
    mean: float
    std_mean: float
    drift: float
    std_drift: float
    alpha: float
    segment_samples: int
    period_samples: int
    settle_samples: int
    n_samples: int
    n_lost: int
    fs_hz: float
    y_unit: str = ""
    name: str = ""
    refresh_hz: float = 0.0

    def interval(self, level: float = 0.95) -> np.ndarray:
        """Confidence interval of the density at each line.

        Parameters
        ----------
        level : float
            Probability, 0 .. 1.

        Returns
        -------
        (2, K) float
            Lower and upper bound: chi-square (NOI-3).

        Raises
        ------
        ValueError
            The level is not between 0 and 1.
        """
        if not 0 < level < 1:
            raise ValueError(f"the level must be between 0 and 1, not {level}")
        tails = np.array([[(1 + level) / 2], [(1 - level) / 2]])
        return self.psd * self.n_dof / (2 * gammaincinv(self.n_dof / 2, tails))

    def line_variance(self, period_samples: int) -> np.ndarray:
        """Variance of a line of one period, for comparison with `Frf.var_y` and for planning.

        Parameters
        ----------
        period_samples : int
            N.

        Returns
        -------
        (K,) float
            At `f_hz`, unit of y squared: 2 fs/N times the density (FRF-1).
        """
        return 2 * self.fs_hz / period_samples * self.psd

    def near_tone(self, f_hz: np.ndarray, width_hz: float) -> np.ndarray:
        """Mark the frequencies within width_hz of a disturbance, so that they can be omitted: (F,) bool."""
        tones = np.array([tone.f_hz for tone in self.tones])
        return (np.abs(np.asarray(f_hz)[:, None] - tones) <= width_hz).any(axis=1)

    def save(self, path: str | Path) -> None:
        """Write a noise model (.json), which `Noise.load` reads. An existing file is replaced atomically."""
        values = {"gsid_noise": FORMAT} | asdict(self)
        values |= {"f_hz": self.f_hz.tolist(), "psd": self.psd.tolist()}
        values |= {name: None for name in ("std_mean", "drift", "std_drift") if math.isnan(values[name])}
        text = json.dumps(values, allow_nan=False, default=lambda scalar: scalar.item()) + "\n"
        write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))

    @classmethod
    def load(cls, path: str | Path) -> Noise:
        """Read a noise model.

        Raises
        ------
        InputError
            The file cannot be read, or is not a noise model.
        """
        hint = "`gsid run --zero 50 --noise-model FILE` writes one"
        try:
            known = read_json(path)
            if known.pop("gsid_noise") != FORMAT:
                raise ValueError("of another version")
            known |= {name: math.nan for name, value in known.items() if value is None}
            known["tones"] = [Tone(**tone) for tone in known["tones"]]
            known |= {name: np.asarray(known[name], float) for name in ("f_hz", "psd")}
            made = cls(**known)
            if made.f_hz.ndim != 1 or made.f_hz.shape != made.psd.shape or not np.all(made.psd >= 0):
                raise ValueError("f_hz and psd do not match")
        except OSError as error:
            raise InputError("the noise model cannot be read", str(path), error.strerror, hint) from error
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise InputError("the file is not a noise model", str(path), error, hint) from error
        return made

    @property
    def drift_words(self) -> str:
        """Mean and drift of the output, with their standard deviations."""
        unit = f" {self.y_unit}" if self.y_unit else ""
        mean = f"mean {self.mean:.4g} +- {self.std_mean:.2g}{unit}"
        if math.isnan(self.std_drift):
            return mean
        return f"{mean}; drift {self.drift:.3g} +- {self.std_drift:.2g}{unit}/s"

    @property
    def sentence(self) -> str:
        """Summary of the periodic disturbances in one sentence."""
        unit = f" {self.y_unit}" if self.y_unit else ""
        rms = f"rms {np.sqrt(self.variance):.4g}{unit}"
        if not self.tones:
            return f"No periodic disturbance (at a false-alarm rate of {self.alpha:g}); {rms}."
        own = [tone for tone in self.tones if not tone.image_of_hz]
        named = ", ".join(f"{tone.name} of {tone.amplitude:.3g}{unit}" for tone in own[:NAMED])
        more = f" and {len(own) - NAMED} more" if len(own) > NAMED else ""
        n_images = len(self.tones) - len(own)
        of_them = f", and {n_images} of their images at the sensor's refresh rate of {self.refresh_hz:.5g} Hz"
        rest = f"{rms}, {np.sqrt(self.variance_rest):.4g}{unit} without"
        images = of_them if n_images else ""
        return f"Periodic: {named}{more}{images} (false-alarm rate {self.alpha:g}); {rest}."

    def __repr__(self) -> str:
        length = f"{self.n_samples} samples at {self.fs_hz:g} Hz"
        return f"Noise({self.name or 'unnamed'}: {length}; {self.sentence})"


NAMED = 8  # disturbances in a sentence


def noise(
    record: Record, *, alpha: float = 0.01, period: int | None = None, settle: int | None = None
) -> Noise:
    """Analyse the noise of the output.

    Parameters
    ----------
    record : Record
        With zero input, or with a periodic input, whose response is subtracted.
    alpha : float
        Probability of detecting a periodic disturbance in noise that has none.
    period, settle : int, optional
        Period and settling [samples]. Default: the values of the record, else found from the data. With zero
        input the period is the length of the windows: the spectrum has the lines of a measurement with that
        period.

    Returns
    -------
    Noise
        NOI-1 to NOI-5.

    Raises
    ------
    InputError
        There are fewer than 256 samples, or u does not have the given period.
    ValueError
        alpha is not between 0 and 1.
    TypeError
        The argument is not one Record.
    """
    if not 0 < alpha < 1:
        raise ValueError(f"alpha must be between 0 and 1, not {alpha}")
    if not isinstance(record, Record):
        raise TypeError(f"noise analyses one Record at a time, got {type(record).__name__}")
    part, period_samples, segment, turn = _noise_alone(record, period, settle)
    y, valid = record.y[part], record.valid[part]
    if len(y) < FEWEST:
        raise InputError(
            "too few samples to estimate the noise", record.name, f"{len(y)}", f"record at least {FEWEST}"
        )
    if segment < SHORTEST:
        hint = f"give a period of at least {SHORTEST} samples; a multiple of the period is also a period"
        raise InputError("the period is too short for a spectrum", record.name, f"{segment} samples", hint)
    y = y - turn * np.arange(len(y)) / segment if turn else y
    tones, rest = find_tones(y, record.fs_hz, valid=valid, period=period_samples, alpha=alpha)
    refresh_hz = refresh_rate_hz(record) or 0.0
    tones = mark_images(tones, refresh_hz, record.fs_hz, record.fs_hz / len(y))
    tones = [_from_first_sample(tone, part.start / record.fs_hz) for tone in tones]
    f_hz, psd, n_dof = spectrum(rest, record.fs_hz, valid, segment)
    n_valid = np.count_nonzero(valid)
    share = _share_of_noise(valid, period_samples)
    variance_rest = float(np.mean(rest[valid] ** 2)) / share
    t_s = np.arange(part.start, part.stop)[valid] / record.fs_hz
    periodic = sum((tone.at(t_s) for tone in tones), np.zeros(n_valid))
    level = _level(_without(tones, record)[part], valid, segment, record.fs_hz)
    return Noise(
        f_hz=f_hz,
        psd=psd / (share if period_samples else 1),
        n_dof=n_dof * (share if period_samples else 1),
        tones=tones,
        variance=variance_rest + float(np.mean(periodic**2)),
        variance_rest=variance_rest,
        mean=level[0],
        std_mean=level[1],
        drift=level[2],
        std_drift=level[3],
        alpha=alpha,
        segment_samples=segment,
        period_samples=period_samples,
        settle_samples=part.start,
        n_samples=len(y),
        n_lost=len(y) - n_valid,
        fs_hz=record.fs_hz,
        y_unit=record.y_unit,
        name=record.name,
        refresh_hz=refresh_hz,
    )


def without_tones(
    record: Record, *, alpha: float = 0.01, period: int | None = None, settle: int | None = None
) -> tuple[Record, list[Tone]]:
    """Subtract the periodic disturbances from the output by a fit of sines.

    Parameters
    ----------
    record, alpha, period, settle
        As `noise`.

    Returns
    -------
    record : Record
        A copy without the disturbances.
    tones : list of Tone
        The subtracted disturbances.

    Raises
    ------
    InputError, ValueError
        As `noise`.
    """
    tones = noise(record, alpha=alpha, period=period, settle=settle).tones
    return replace(record, y=_without(tones, record)), tones


def _without(tones: list[Tone], record: Record) -> np.ndarray:
    """The output without periodic disturbances, (n,) float."""
    return record.y - sum((tone.at(record.t_s) for tone in tones), 0.0)


def _level(y: np.ndarray, valid: np.ndarray, segment: int, fs_hz: float) -> tuple[float, float, float, float]:
    """Mean and slope with their standard deviations, from the means of windows (NOI-4)."""
    n = len(y) // segment
    rows = slice(0, n * segment)
    count = valid[rows].reshape(n, segment).sum(axis=1)
    keep = np.flatnonzero(count > 0.5 * segment)  # a window with few samples has a mean of larger variance
    if len(keep) < 3:
        return float(np.mean(y[valid])), math.nan, math.nan, math.nan
    means = (np.where(valid, y, 0.0)[rows].reshape(n, segment).sum(axis=1)[keep]) / count[keep]
    t_s = (keep - keep.mean()) * segment / fs_hz
    slope = float(t_s @ means / (t_s @ t_s))
    rest = means - means.mean() - slope * t_s
    variance = float(rest @ rest) / (len(keep) - 2)
    errors = math.sqrt(variance / len(keep)), math.sqrt(variance / float(t_s @ t_s))
    return float(means.mean()), errors[0], slope, errors[1]


def _noise_alone(record: Record, period: int | None, settle: int | None) -> tuple[slice, int, int, float]:
    """Return samples to analyse, period to subtract (0: zero input), window length and gain in a period."""
    stated = record.period_samples if period is None else whole_samples("period", period)
    start = (record.settle_samples or 0) if settle is None else whole_samples("settle", settle)
    if not record.valid.any():
        raise InputError("no valid samples", record.name, "valid is 0 everywhere", "measure again")
    check_range(record)
    if np.ptp(record.u[record.valid]) == 0:
        return slice(start, len(record)), 0, stated or max(1, (len(record) - start) // SEGMENTS), 0.0
    try:
        found = stated or find_period(record.u, valid=record.valid, name=record.name)
    except InputError:
        name = record.name or "record"
        _log.warning("%s: u is neither zero nor periodic: assumed to be zero with measurement noise", name)
        return slice(start, len(record)), 0, max(1, (len(record) - start) // SEGMENTS), 0.0
    periods = split_periods(record, period=found, settle=settle)
    n_periods = (len(record) - periods.settle_samples) // found
    stop = periods.settle_samples + n_periods * found
    return slice(periods.settle_samples, stop), found, found, periods.turn


def _share_of_noise(valid: np.ndarray, period_samples: int) -> float:
    """Share of the noise variance that remains after mean and trend, or the mean period, are subtracted."""
    return 1 - n_subtracted(valid, period_samples) / np.count_nonzero(valid)


def _from_first_sample(tone: Tone, start_s: float) -> Tone:
    phase = tone.phase_rad - 2 * np.pi * tone.f_hz * start_s
    return replace(tone, phase_rad=float(np.angle(np.exp(1j * phase))))


def spectrum(
    x: np.ndarray, fs_hz: float, valid: np.ndarray, segment: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Estimate the power spectral density with Hann windows that overlap by half (NOI-3).

    Parameters
    ----------
    x : (n,) float
    fs_hz : float
    valid : (n,) bool
        A window with a lost sample is omitted.
    segment : int
        Length of a window, samples.

    Returns
    -------
    f_hz, psd : (K,) float
        Without 0 Hz and half of the sample rate.
    n_dof : float
        Degrees of freedom of each value.

    Raises
    ------
    InputError
        Every window has a lost sample.
    """
    rows = hann_windows(x, valid, segment)
    n_rows = len(rows)
    if n_rows == 0:
        what = "no segment without lost samples is as long as a window"
        raise InputError(what, "", f"{segment} samples", "give a shorter --period, or measure again")
    inner = slice(1, (segment + 1) // 2)
    psd = np.mean(np.abs(rows[:, inner]) ** 2, axis=0) * segment / (2 * fs_hz)
    f_hz = np.arange(rows.shape[1])[inner] * fs_hz / segment
    return f_hz, psd, 2 * n_rows / (1 + 2 * CORRELATION * (n_rows - 1) / n_rows)


def hann_windows(x: np.ndarray, valid: np.ndarray, length: int) -> np.ndarray:
    """Transform Hann windows that overlap by half, after subtracting the mean of each.

    Parameters
    ----------
    x : (n,) float
    valid : (n,) bool
        A window with a lost sample is omitted.
    length : int
        Length of a window, samples.

    Returns
    -------
    (M, length // 2 + 1) complex
        For noise, the mean square of each line equals that of FRF-1, which has no window.
    """
    if len(x) < length:
        return np.empty((0, length // 2 + 1), complex)
    step = max(1, length // 2)
    rows = np.lib.stride_tricks.sliding_window_view(x, length)[::step]
    good = np.lib.stride_tricks.sliding_window_view(valid, length)[::step].all(axis=1)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)
    rows = rows[good]
    rows = (rows - rows.mean(axis=1, keepdims=True)) * window
    return np.fft.rfft(rows, axis=1) * (2 / np.sqrt(length * np.sum(window**2)))
