"""Best linear approximation with the levels of noise and nonlinear distortion.

The robust method (DIS-1, DIS-2; thesis, eqs. 5.12 to 5.16) measures M realisations of a random-phase
multisine over P periods each. The scatter over periods is noise; the scatter over realisations is noise and
distortion. The fast method (DIS-3) needs one realisation. It measures the distortion at lines that are not
excited, separately for odd and even orders if all excited lines are odd. Both methods use the same
measurement. The core computes the sums (`gsid_distortion`), on the target and on the host.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, fdtrc, fdtri, gammaincinv

from gsid.base.plottable import Plottable

SAME_LEVEL = 0.1  # largest relative difference in amplitude of realisations with the same level
NEIGHBOURS = 4  # free odd lines used to estimate the distortion at an excited line
N_HARMONICS = 20  # number of harmonics evaluated when a single line is excited

ALARM_RATE = 0.01  # false-alarm rate of all bands together
BAND_RATIO = 2 ** (1 / 3)
LINES_PER_BAND = 4  # at least
COMPARABLE_DB = 10.0  # if the levels of odd and even distortion differ by less, both are reported
LEAST_RATIO = 1e-3  # smallest reported ratio of powers, distortion over noise
AVERAGING_HELPS_DB = 0.0  # below this level the noise is larger than the distortion
ODD_HIDDEN = (
    "Odd distortion, as of friction, cannot be separated from the response, because every odd line is "
    "excited: measure other realisations, or leave out odd lines at random."
)


@dataclass(repr=False)
class Distortion(Plottable):
    """Best linear approximation, with separate variances of noise and nonlinear distortion.

    Attributes
    ----------
    line : (F,) int
        Lines excited in every realisation.
    f_hz : (F,) [Hz]
    bla : (F,) complex
        Mean of the responses of the realisations, unit y over u (thesis, eq. 5.14).
    var_noise, var_total : (F,)
        Variance of `bla` due to noise, and due to noise and distortion together (thesis, eq. 5.14). The
        latter is NaN with one realisation.
    std_nonlinear : (F,)
        Standard deviation of the response of one realisation due to distortion (thesis, eq. 5.16). With one
        realisation it is estimated from the neighbouring odd free lines (DIS-3), and NaN if there are none.
    responses : (M, F) complex
        Response of each realisation (thesis, eq. 5.13).
    u : (F,)
        Amplitude of the input, rms over realisations.
    free_line : (D,) int
        Lines not excited in any realisation.
    free_f_hz : (D,) [Hz]
    free_order : (D,) int
        Order in units of the greatest common divisor of the excited lines; 0 at lines between these units,
        where the axis cannot respond.
    level, level_noise : (D,)
        Rms amplitude of the output at the free lines, and the part of it due to noise, unit of y.
    n_periods, n_realisations, n_spoiled, settle_samples, period_samples : int
    fs_hz : float
    u_unit, y_unit, name : str
    """

    line: np.ndarray
    f_hz: np.ndarray
    bla: np.ndarray
    var_noise: np.ndarray
    var_total: np.ndarray
    std_nonlinear: np.ndarray
    responses: np.ndarray
    u: np.ndarray
    free_line: np.ndarray
    free_f_hz: np.ndarray
    free_order: np.ndarray
    level: np.ndarray
    level_noise: np.ndarray
    n_periods: int
    n_realisations: int
    n_spoiled: int
    settle_samples: int
    period_samples: int
    fs_hz: float
    u_unit: str = ""
    y_unit: str = ""
    name: str = ""

    @property
    def odd(self) -> np.ndarray:
        """Free lines of odd order, (D,) bool."""
        return self.free_order % 2 == 1

    @property
    def even(self) -> np.ndarray:
        """Free lines of even order, (D,) bool."""
        return (self.free_order % 2 == 0) & (self.free_order > 0)

    @property
    def orders_apart(self) -> bool:
        """Whether odd and even distortion appear at different lines: all excited lines are of odd order."""
        return bool(np.all(self.line // np.gcd.reduce(self.line) % 2 == 1))

    @property
    def coherence(self) -> np.ndarray:
        """Coherence of input and output over all periods, (F,), 0 .. 1 (thesis, eq. 5.3).

        Distortion is the same in all periods of one realisation. With one realisation only noise lowers the
        coherence.
        """
        m, p = self.n_realisations, self.n_periods / self.n_realisations
        scatter = (p - 1) * m * self.var_noise
        if m > 1:
            scatter = scatter + (m - 1) * self.var_total
        gain = np.abs(self.bla) ** 2
        return gain / (gain + scatter)

    @property
    def noncausal_power_ratio(self) -> float:
        """Share of the power of the inverse transform of `bla` before t = 0 (thesis, eqs. 5.4 to 5.6).

        Only the excited lines are transformed. The edges of the band also cause a noncausal part on a linear
        axis. Compare the value therefore only with that of the same band at another input level.
        NaN of a single line: half of a sine is always before t = 0.

        Raises
        ------
        ValueError
            The responses were imported, and the grid of their lines is unknown.
        """
        if not self.period_samples:
            raise ValueError("the inverse transform needs a period, which imported responses do not have")
        n, line = self.period_samples, self.line
        if len(line) < 2:
            return np.nan
        spectrum = np.zeros(n // 2 + 1, complex)
        spectrum[line] = self.bla
        g = np.fft.irfft(spectrum, n)
        # lines k0 + i d repeat every N/d samples, except for their phase: half of that is before t = 0
        half = n // (2 * int(np.gcd.reduce(np.diff(line))))
        before, after = np.sum(g[n - half :] ** 2), np.sum(g[:half] ** 2)
        return float(before / (before + after))

    @property
    def bands(self) -> list[DistortedBand]:
        """Bands in which noise or distortion dominates; see `gsid.response.distortion`."""

        return distorted_bands(self)

    @property
    def verdict(self) -> str:
        """Summary of what limits the measurement."""

        return verdict(self)

    def intervals(self, level: float = 0.95) -> dict[str, np.ndarray]:
        """Confidence intervals of the standard deviations at each line.

        Parameters
        ----------
        level : float
            Probability, 0 .. 1.

        Returns
        -------
        dict of (2, F) arrays, lower and upper
            `std_noise`: standard deviation of `bla` due to noise. The interval is exact: chi-square with
            2 M (P - 1) degrees of freedom.
            `std_nonlinear`: standard deviation of one realisation due to distortion. This is the interval of
            Williams and Tukey for a variance component (DIS-4). It starts at 0 if noise alone explains the
            scatter. It has fewer degrees of freedom if the scatter has longer tails than a normal
            distribution (DIS-5). NaN with one realisation.

        Raises
        ------
        ValueError
            The level is not between 0 and 1.
        """
        if not 0 < level < 1:
            raise ValueError(f"the level must be between 0 and 1, not {level}")
        m = self.n_realisations
        nu_noise = 2 * (self.n_periods - m)
        tails = np.array([[(1 + level) / 2], [(1 - level) / 2]])
        noise = self.var_noise * nu_noise / (2 * gammaincinv(nu_noise / 2, tails))
        if m < 2:
            return {"std_noise": np.sqrt(noise), "std_nonlinear": np.full((2, len(self.line)), np.nan)}
        nu_total = 2 / (1 / (m - 1) + excess_kurtosis(self.responses) / m)
        ratio = fdtri(nu_total, nu_noise, tails)
        above = self.var_total - ratio * self.var_noise
        nonlinear = m * np.maximum(above, 0) * nu_total / (2 * gammaincinv(nu_total / 2, tails))
        return {"std_noise": np.sqrt(noise), "std_nonlinear": np.sqrt(nonlinear)}

    def __repr__(self) -> str:
        lines = f"{len(self.line)} lines {self.f_hz[0]:g} .. {self.f_hz[-1]:g} Hz"
        measured = f"{self.n_realisations} realisations, {self.n_periods} periods"
        return (
            f"Distortion({self.name or 'unnamed'}: {lines}, {len(self.free_line)} free, {measured}; "
            f"{self.verdict})"
        )


def excess_kurtosis(responses: np.ndarray) -> float:
    """Excess kurtosis of the scatter over realisations (DIS-5).

    Distortion is a sum of products of lines. With few lines it is not normally distributed, and its sample
    variance scatters more. One number is estimated for all lines, because M values of one line are too few.

    Parameters
    ----------
    responses : (M, F) complex array_like

    Returns
    -------
    float
        E|d|^4 / (E|d|^2)^2 - 2, at least 0; 0 with fewer than 4 realisations, which are too few to estimate
        it.
    """
    m = len(responses)
    power = np.abs(responses - np.mean(responses, axis=0)) ** 2
    total = power.sum(axis=0)
    if m < 4 or not (total > 0).any():
        return 0.0
    b = float(np.mean(np.sum(power**2, axis=0)[total > 0] / total[total > 0] ** 2))
    normal = 2 * (m - 1) / m**2
    slope = ((m - 1) ** 4 + m - 1) / (2 * m**2 * (m - 1) ** 2) - (m - 1) / m**2
    return max((b / normal - 1) / slope, 0.0)


@dataclass(frozen=True)
class DistortedBand:
    """A band in which one kind of error limits the measurement.

    Attributes
    ----------
    f_lo_hz, f_hi_hz : float
        First and last line.
    kind : {"noise", "odd", "even", "odd and even", "nonlinear"}
        Dominant error; "nonlinear" if the free lines do not separate odd and even orders.
    low_db, high_db : float
        Distortion over the noise that remains after averaging over the periods, minimum and maximum of the
        merged bands; NaN for noise.
    """

    f_lo_hz: float
    f_hi_hz: float
    kind: str
    low_db: float
    high_db: float


@dataclass(frozen=True)
class LinePower:
    """One kind of evidence: measured power, and the part of it due to noise, at each line.

    Attributes
    ----------
    f_hz, power, noise : (F,) ndarrays
    nu : (int, int)
        Degrees of freedom of the ratio of power and noise at one line.
    """

    f_hz: np.ndarray
    power: np.ndarray
    noise: np.ndarray
    nu: tuple[int, int]

    def level_db(self, lo: float, hi: float, alarm: float) -> float:
        """Distortion over noise within a band [dB]; minus infinity if noise explains the power.

        Parameters
        ----------
        lo, hi : float
            Hz.
        alarm : float
            False-alarm rate of this test.
        """
        within = (self.f_hz >= lo) & (self.f_hz <= hi) & (self.noise > 0)
        if not within.any():
            return -np.inf
        power, noise = self.power[within], self.noise[within]
        with np.errstate(divide="ignore"):
            fisher = -2 * np.sum(np.log(fdtrc(*self.nu, power / noise)))
        if chdtrc(2 * len(power), fisher) > alarm:
            return -np.inf
        return float(10 * np.log10(max(power.sum() / noise.sum() - 1, LEAST_RATIO)))


def distorted_bands(d: Distortion) -> list[DistortedBand]:
    """Find the bands in which noise or distortion dominates.

    Parameters
    ----------
    d : Distortion

    Returns
    -------
    list of DistortedBand
        In order of frequency; empty if the measurement cannot separate distortion from the response.
    """
    # The harmonics of a single sine lie above it, outside of the band of the excited lines.
    f_hz = d.f_hz if len(d.line) > 1 else np.concatenate([d.f_hz, d.free_f_hz[-1:]])
    return bands_of(_evidence(d), f_hz)


def bands_of(kinds: dict[str, LinePower], f_hz: np.ndarray, n_channels: int = 1) -> list[DistortedBand]:
    """Bands in which noise or one kind of distortion dominates.

    Parameters
    ----------
    kinds : dict of LinePower
        By kind of distortion: "odd", "even" or "nonlinear".
    f_hz : (F,) ndarray
        Excited lines [Hz].
    n_channels : int
        Number of channels that are tested; together they raise a false alarm with probability ALARM_RATE.

    Returns
    -------
    list of DistortedBand
    """
    if not kinds:
        return []
    edges = _edges(f_hz)
    alarm = ALARM_RATE / (len(edges) * len(kinds) * n_channels)
    found = []
    for lo, hi in edges:
        level = {name: kind.level_db(lo, hi, alarm) for name, kind in kinds.items()}
        found.append(DistortedBand(lo, hi, *_leading(level)))
    return _joined(found)


def verdict(d: Distortion) -> str:
    """Describe what limits the measurement.

    Parameters
    ----------
    d : Distortion

    Returns
    -------
    str
        One sentence for each band, and one for odd distortion that cannot be separated.
    """
    bands = distorted_bands(d)
    if not bands:
        return (
            "Distortion cannot be separated from the response: measure other realisations, or leave lines "
            "unexcited (odd lines of a multisine)."
        )
    hides_odd = d.orders_apart and "odd" not in _evidence(d)
    if all(band.kind == "noise" for band in bands):
        nothing = "No distortion above the noise: averaging longer helps everywhere."
        return f"No even distortion above the noise. {ODD_HIDDEN}" if hides_odd else nothing
    sentences = [_sentence(d, band) for band in bands if band.kind != "noise"]
    quiet = [span(band) for band in bands if band.kind == "noise"]
    if quiet and not hides_odd:
        sentences.append(f"{', '.join(quiet)}: noise dominates; averaging longer helps")
    return ". ".join(sentences) + (f". {ODD_HIDDEN}" if hides_odd else ".")


def _evidence(d: Distortion) -> dict[str, LinePower]:
    """Measured power and noise, by kind of line."""
    m, p = d.n_realisations, d.n_periods
    kinds = {}
    if m > 1:  # excited lines of odd order contain odd distortion only
        kinds["odd" if d.orders_apart else "nonlinear"] = LinePower(
            d.f_hz, d.var_total, d.var_noise, (2 * (m - 1), 2 * (p - m))
        )
    power, noise = d.level**2, d.level_noise**2
    names = {"odd": d.odd, "even": d.even} if d.orders_apart else {"nonlinear": d.free_order > 0}
    for name, chosen in names.items():
        within = chosen & ((d.free_f_hz >= d.f_hz[0]) & (d.free_f_hz <= d.f_hz[-1]) | (len(d.line) == 1))
        if name not in kinds and within.any():
            kinds[name] = LinePower(d.free_f_hz[within], power[within], noise[within], (2 * m, 2 * (p - m)))
    return kinds


def _edges(f_hz: np.ndarray) -> list[tuple[float, float]]:
    """Bands of at least a third of an octave and at least LINES_PER_BAND excited lines."""
    edges, start = [], 0
    for i in range(1, len(f_hz) + 1):
        is_wide = i == len(f_hz) or f_hz[i] >= BAND_RATIO * f_hz[start]
        if is_wide and (i - start >= LINES_PER_BAND or i == len(f_hz)):
            edges.append((float(f_hz[start]), float(f_hz[i - 1])))
            start = i
    if len(edges) > 1 and np.count_nonzero(f_hz >= edges[-1][0]) < LINES_PER_BAND:  # too few lines remain
        edges[-2:] = [(edges[-2][0], edges[-1][1])]
    return edges


def _leading(level: dict[str, float]) -> tuple[str, float, float]:
    """Kind and level of a band from the levels of all kinds of evidence."""
    named = {name: db for name, db in level.items() if name != "nonlinear" and np.isfinite(db)}
    whole = level.get("nonlinear", -np.inf)
    if not named:
        return ("nonlinear", whole, whole) if np.isfinite(whole) else ("noise", np.nan, np.nan)
    top = max(named.values())
    largest = [name for name in ("odd", "even") if named.get(name, -np.inf) > top - COMPARABLE_DB]
    return " and ".join(largest), top, top


def _joined(bands: list[DistortedBand]) -> list[DistortedBand]:
    joined = bands[:1]
    for band in bands[1:]:
        last = joined[-1]
        if band.kind == last.kind:
            low, high = min(last.low_db, band.low_db), max(last.high_db, band.high_db)
            joined[-1] = DistortedBand(last.f_lo_hz, band.f_hi_hz, band.kind, low, high)
        else:
            joined.append(band)
    return joined


def span(band: DistortedBand) -> str:
    """Frequencies of a band in words."""
    low, high = f"{band.f_lo_hz:.3g}", f"{band.f_hi_hz:.3g}"
    return f"{low} Hz" if low == high else f"{low} to {high} Hz"


def _sentence(d: Distortion, band: DistortedBand) -> str:
    low, high = f"{band.low_db:.0f}", f"{band.high_db:.0f}"
    size = f"{low} dB" if low == high else f"{low} to {high} dB"
    if band.kind == "even":  # does not appear at the excited lines, which are odd
        advice = "the response at the excited lines is free of it"
    elif band.high_db > AVERAGING_HELPS_DB:
        advice = "averaging longer will not help"
        if d.n_realisations < 2 and len(d.line) > 1:
            advice += ", other realisations will"
    else:
        advice = "averaging longer still helps"
    return f"{span(band)}: {band.kind} distortion {size} above noise; {advice}"
