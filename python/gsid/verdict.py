"""What limits a response, in words: noise, which averaging lowers, or distortion, which it does not.

The lines are taken together in bands of a third of an octave or wider. In each, the scatter over
realisations and the levels at the lines left free are compared with what noise alone would leave. A
line's ratio of the two follows F when there is only noise; the p-values of a band's lines are combined
as Fisher does, so that the rate of false alarms holds for few periods too, all bands together. Bands of
one kind that touch are joined.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import combine_pvalues
from scipy.stats import f as f_distribution

if TYPE_CHECKING:
    from gsid.distortion import Distortion

ALARM_RATE = 0.01  # of all bands together, when there is only noise
BAND_RATIO = 2 ** (1 / 3)
LINES_PER_BAND = 4  # at least
ALIKE_DB = 10.0  # odd and even distortion nearer than this are both named
LEAST_RATIO = 1e-3  # of powers, distortion over noise: what is below is not told
AVERAGING_HELPS_DB = 0.0  # below this the noise is the larger part


@dataclass(frozen=True)
class DistortedBand:
    """A band in which one thing limits the measurement.

    Attributes
    ----------
    f_lo_hz, f_hi_hz : float
        First and last line.
    kind : {"noise", "odd", "even", "odd and even", "nonlinear"}
        Of the distortion that leads; "nonlinear" where no free lines tell orders apart.
    low_db, high_db : float
        Distortion over the noise left by averaging over the periods, least and largest of the bands joined;
        NaN for noise.
    """

    f_lo_hz: float
    f_hi_hz: float
    kind: str
    low_db: float
    high_db: float


@dataclass(frozen=True)
class _Kind:
    """One sort of evidence: power measured and what noise alone leaves of it, line by line."""

    f_hz: np.ndarray
    power: np.ndarray
    noise: np.ndarray
    nu: tuple[int, int]  # degrees of freedom of the ratio at one line

    def level_db(self, lo: float, hi: float, alarm: float) -> float:
        """Distortion over noise within a band [dB]; minus infinity where noise explains it."""
        within = (self.f_hz >= lo) & (self.f_hz <= hi) & (self.noise > 0)
        if not within.any():
            return -np.inf
        power, noise = self.power[within], self.noise[within]
        if combine_pvalues(f_distribution.sf(power / noise, *self.nu), "fisher").pvalue > alarm:
            return -np.inf
        return float(10 * np.log10(max(power.sum() / noise.sum() - 1, LEAST_RATIO)))


def distorted_bands(d: Distortion) -> list[DistortedBand]:
    """Find the bands in which noise or distortion leads.

    Parameters
    ----------
    d : Distortion

    Returns
    -------
    list of DistortedBand
        In order of frequency; empty where nothing was measured that could tell.
    """
    kinds = _evidence(d)
    if not kinds:
        return []
    edges = _edges(d.f_hz)
    alarm = ALARM_RATE / (len(edges) * len(kinds))
    found = []
    for lo, hi in edges:
        level = {name: kind.level_db(lo, hi, alarm) for name, kind in kinds.items()}
        found.append(DistortedBand(lo, hi, *_leading(level)))
    return _joined(found)


def verdict(d: Distortion) -> str:
    """Say what limits the measurement.

    Parameters
    ----------
    d : Distortion

    Returns
    -------
    str
        One sentence for each band.
    """
    bands = distorted_bands(d)
    if not bands:
        return (
            "Distortion cannot be told from the response: measure other realisations, or leave lines free "
            "(odd lines of a multisine)."
        )
    if all(band.kind == "noise" for band in bands):
        return "No distortion above the noise: averaging longer helps everywhere."
    sentences = [_sentence(d, band) for band in bands if band.kind != "noise"]
    quiet = [_span(band) for band in bands if band.kind == "noise"]
    if quiet:
        sentences.append(f"{', '.join(quiet)}: noise leads; averaging longer helps")
    return ". ".join(sentences) + "."


def _evidence(d: Distortion) -> dict[str, _Kind]:
    """Ratios of what is measured to noise, by kind of line."""
    m, p = d.n_realisations, d.n_periods
    kinds = {}
    if m > 1:  # on excited lines of odd order only odd distortion falls
        kinds["odd" if d.orders_apart else "nonlinear"] = _Kind(
            d.f_hz, d.var_total, d.var_noise, (2 * (m - 1), 2 * (p - m))
        )
    power, noise = d.level**2, d.level_noise**2
    names = {"odd": d.odd, "even": d.even} if d.orders_apart else {"nonlinear": d.free_order > 0}
    for name, chosen in names.items():
        within = chosen & ((d.free_f_hz >= d.f_hz[0]) & (d.free_f_hz <= d.f_hz[-1]) | (len(d.line) == 1))
        if name not in kinds and within.any():
            kinds[name] = _Kind(d.free_f_hz[within], power[within], noise[within], (2 * m, 2 * (p - m)))
    return kinds


def _edges(f_hz: np.ndarray) -> list[tuple[float, float]]:
    """Bands of a third of an octave at least, and of LINES_PER_BAND excited lines at least."""
    edges, start = [], 0
    for i in range(1, len(f_hz) + 1):
        is_wide = i == len(f_hz) or f_hz[i] >= BAND_RATIO * f_hz[start]
        if is_wide and (i - start >= LINES_PER_BAND or i == len(f_hz)):
            edges.append((float(f_hz[start]), float(f_hz[i - 1])))
            start = i
    if len(edges) > 1 and np.count_nonzero(f_hz >= edges[-1][0]) < LINES_PER_BAND:  # too few lines were left
        edges[-2:] = [(edges[-2][0], edges[-1][1])]
    return edges


def _leading(level: dict[str, float]) -> tuple[str, float, float]:
    """Kind and level of a band from the levels of all kinds of evidence."""
    named = {name: db for name, db in level.items() if name != "nonlinear" and np.isfinite(db)}
    whole = level.get("nonlinear", -np.inf)
    if not named:
        return ("nonlinear", whole, whole) if np.isfinite(whole) else ("noise", np.nan, np.nan)
    top = max(named.values())
    alike = [name for name in ("odd", "even") if named.get(name, -np.inf) > top - ALIKE_DB]
    return " and ".join(alike), top, top


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


def _span(band: DistortedBand) -> str:
    low, high = f"{band.f_lo_hz:.3g}", f"{band.f_hi_hz:.3g}"
    return f"{low} Hz" if low == high else f"{low} to {high} Hz"


def _sentence(d: Distortion, band: DistortedBand) -> str:
    low, high = f"{band.low_db:.0f}", f"{band.high_db:.0f}"
    size = f"{low} dB" if low == high else f"{low} to {high} dB"
    if band.kind == "even":  # does not fall on the excited lines, which are odd
        advice = "the response at the excited lines is free of it"
    elif band.high_db > AVERAGING_HELPS_DB:
        advice = "averaging longer will not help"
        if d.n_realisations < 2:
            advice += ", other realisations will"
    else:
        advice = "averaging longer helps still"
    return f"{_span(band)}: {band.kind} distortion {size} above noise; {advice}"
