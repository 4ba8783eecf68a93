"""Best linear approximation and its total variance: noise and distortion together (BLA-1 .. BLA-3).

A linear model is fitted to the best linear approximation of an axis. Its errors are the noise and the part of
the distortion that does not repeat from line to line. A weight from the noise alone makes friction count as
dynamics: surplus poles are then significant. The total variance comes from what the records offer:

* two or more realisations: their scatter (Pintelon and Schoukens 2012, section 4.3);
* one realisation: what a local rational model of neighbouring lines leaves (McKelvey and Guerin 2012);
* lines that are not excited: the power there above the noise (Pintelon and Schoukens 2012, section 4.4).

The largest of these, of the noise and of a floor is used. `TotalVariance.sources` reports which of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import ndimage, special

from gsid.base.bands import within
from gsid.base.errors import InputError
from gsid.records.record import Record
from gsid.response.closed_loop import closed_loop_frf
from gsid.response.estimate import single_response
from gsid.response.frf import Frf
from gsid.response.local_polynomial import Unsettled, unsettled
from gsid.spectrum.lines import sample_variance
from gsid.spectrum.realisation import Realisation, listed, realisations, require_same
from gsid.spectrum.spectra import Spectra

FLOOR = 1e-4
"""Least standard deviation over the response: calibration and rounding are not known better."""
HALF_WINDOW = 8
"""Lines on each side of the running median. A variance from one realisation has 1 to 10 degrees of freedom;
17 lines reduce its scatter below 30 %, and are narrower than the slope of a noise spectrum."""
LOCAL_LINES = 13
"""Lines of a local rational model: 5 parameters and 8 degrees of freedom, narrower than most resonances."""
LOCAL_ORDERS = ((2, 2), (2, 0))
"""Degrees of numerator and denominator; the second for lines without a resonance among them."""
DETECTION_REACH = 6
"""Line spacings from an excited line to the detection lines that count for it."""
WEIGHT_FLOOR = 1e-2
"""Relative error below which a smaller noise gives a realisation no more weight: distortion is larger."""
SAME_PHASES = 0.9
"""Coherence of the phases of two realisations from which on they are the same excitation."""
SMOOTH_PHASES = 3.5
"""Times 1/sqrt(lines): correlation of the phases' second differences; random ones exceed it in 5 of 1e6."""
FEW_LINES = 3 * LOCAL_LINES
"""With fewer lines no local model is fitted."""


@dataclass(eq=False)
class TotalVariance:
    """Best linear approximation of an axis at the union of the realisations' lines.

    Attributes
    ----------
    line : (F,) int
        Lines of the period that at least one realisation excites.
    f_hz : (F,) [Hz]
    g : (F,) complex
        Mean over the realisations that excite the line.
    var_noise : (F,)
        Variance of `g` by noise, smoothed over frequency.
    var_total : (F,)
        Variance of `g` by noise and distortion: the largest of the sources.
    n_realisations : (F,) int
        Realisations that excite the line.
    share : (M, F)
        Weight of each realisation in `g`; 0 where it does not excite the line. They sum to 1.
    sources : dict of (F,) arrays
        Variance from each source: "noise", "realisations", "local_model", "detection_lines", "floor".
    smooth_phases : bool
        The phases of the excitation are a smooth function of the line (Schroeder), and there is one
        realisation only. Its distortion is then smooth over frequency too, and no source measures it.
    fs_hz : float
    period_samples : int
    hold : {"zoh", "none"} or None
    u_unit, y_unit, name : str
    settle_samples : int
    sensor_rate_hz : float or None
        Refresh rate [Hz] of a sensor whose hold has been removed from `g`.
    rejected_hz : (R,) [Hz]
        Lines that were left out because their input is too weak.
    """

    line: np.ndarray
    f_hz: np.ndarray
    g: np.ndarray
    var_noise: np.ndarray
    var_total: np.ndarray
    n_realisations: np.ndarray
    share: np.ndarray
    sources: dict[str, np.ndarray]
    smooth_phases: bool
    fs_hz: float
    period_samples: int
    hold: str | None
    u_unit: str = ""
    y_unit: str = ""
    name: str = ""
    settle_samples: int = 0
    sensor_rate_hz: float | None = None
    rejected_hz: np.ndarray = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.line)

    @property
    def largest_source(self) -> str:
        """Source of the total variance at most lines."""
        names = list(self.sources)
        first = np.argmax([self.sources[name] for name in names], axis=0)
        return names[int(np.bincount(first, minlength=len(names)).argmax())]

    def frf(self, relative_error: float = 0.0) -> Frf:
        """A response whose variance is the total variance, known exactly, for `gsid.fit`.

        Parameters
        ----------
        relative_error : float
            Error that a linear model is allowed over the response; its square is added to the variance.

        Returns
        -------
        Frf
            With unit input, and the records' hold, period and units.
        """
        variance = self.var_total + relative_error**2 * response_level(self.g)
        known = Frf.from_arrays(self.f_hz, self.g, variance, fs_hz=self.fs_hz)
        return replace(
            known,
            line=self.line,
            hold=self.hold,
            period_samples=self.period_samples,
            settle_samples=self.settle_samples,
            u_unit=self.u_unit,
            y_unit=self.y_unit,
            name=self.name,
        )

    def at(self, use: np.ndarray) -> TotalVariance:
        """At some of its lines only: use, (F,) bool."""
        names = ("line", "f_hz", "g", "var_noise", "var_total", "n_realisations")
        picked = {name: getattr(self, name)[use] for name in names}
        sources = {name: var[use] for name, var in self.sources.items()}
        return replace(self, **picked, share=self.share[:, use], sources=sources)

    def over(self, response: np.ndarray) -> TotalVariance:
        """Divided by a known response, (F,) complex, such as that of a sensor."""
        size2 = np.abs(response) ** 2
        sources = {name: var / size2 for name, var in self.sources.items()}
        var_noise, var_total = self.var_noise / size2, self.var_total / size2
        return replace(self, g=self.g / response, var_noise=var_noise, var_total=var_total, sources=sources)

    def __repr__(self) -> str:
        share = np.sqrt(np.median(self.var_total / np.abs(self.g) ** 2))
        return (
            f"TotalVariance {self.name or 'unnamed'}: {len(self)} lines, {self.f_hz[0]:g} .. "
            f"{self.f_hz[-1]:g} Hz, "
            f"at most {self.n_realisations.max()} realisations, std / gain {share:.2g} "
            f"from {self.largest_source}"
        )


def total_variance(
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
    band: tuple[float, float] | None = None,
    reference: str | None = None,
) -> TotalVariance:
    """Estimate the best linear approximation and its total variance.

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
        One per realisation. Their excited lines may differ: each line is averaged over the realisations that
        excite it.
    period, settle : int, optional
        Samples; default: what each record states, else what its data show. Not used for Spectra.
    band : (lo, hi), optional
        Only lines within [Hz].
    reference : str, optional
        Of records measured in a closed loop: the column of its reference (`gsid.response.closed_loop`).

    Returns
    -------
    TotalVariance
        BLA-1 over realisations, BLA-2 by local models, BLA-3 by detection lines.

    Raises
    ------
    InputError
        As `gsid.frf`; no excited line in the band.
    ValueError
        No record.
    """
    if reference is not None:
        each, excess = _in_closed_loop(listed(records), reference, period, settle, band), None
        phases = [np.ones(len(one.line), complex) for one in each]  # turned to those of the reference
    else:
        each, excess = _in_open_loop(listed(records), period, settle, band)
        phases = [one.u / np.abs(one.u) for one in each]
    return _combined(each, excess, phases, is_open=reference is None)


def _in_open_loop(
    records: list[Record | Spectra],
    period: int | None,
    settle: int | None,
    band: tuple[float, float] | None,
) -> tuple[list[Frf], list[np.ndarray] | None]:
    """Response and detected distortion of each realisation; local polynomials for single periods."""
    if any(is_one_period(record, period, settle) for record in records):
        unsettled_parts = unsettled(records, period=period, settle=settle)
        return [part.frf(_excited(part, band)) for part in unsettled_parts], None
    parts = realisations(records, period=period, settle=settle)
    each = [single_response(part, _excited(part, band)) for part in parts]
    return each, [_detected(part, one) for part, one in zip(parts, each, strict=True)]


def is_one_period(record: Record | Spectra, period: int | None, settle: int | None) -> bool:
    """Whether a record states its period and has fewer than two of them.

    Parameters
    ----------
    record : Record or Spectra
    period, settle : int or None
        Samples; None: what the record states.
    """
    if isinstance(record, Spectra):
        return False
    period = record.period_samples if period is None else period
    settle = (record.settle_samples or 0) if settle is None else settle
    return period is not None and period <= len(record) - settle < 2 * period


def _excited(part: Realisation | Unsettled, band: tuple[float, float] | None) -> np.ndarray:
    line = np.flatnonzero(part.excited & within(part.f_hz, band))
    if not len(line):
        where = "" if band is None else f" within {band[0]:g}:{band[1]:g} Hz"
        f_hz = part.f_hz[part.excited]
        hint = f"it has lines {f_hz[0]:g} .. {f_hz[-1]:g} Hz"
        raise InputError(f"no line{where} is excited", part.name, None, hint)
    return line


def _in_closed_loop(
    records: list[Record | Spectra],
    reference: str,
    period: int | None,
    settle: int | None,
    band: tuple[float, float] | None,
) -> list[Frf]:
    each = [
        closed_loop_frf([record], reference, period=period, settle=settle, band=band) for record in records
    ]
    for other in each[1:]:
        require_same(each[0], other)
    return each


def _combined(
    each: list[Frf], excess: list[np.ndarray] | None, phases: list[np.ndarray], *, is_open: bool
) -> TotalVariance:
    """Put the responses of the realisations together."""
    line = np.unique(np.concatenate([one.line for one in each]))
    where = [np.searchsorted(line, one.line) for one in each]
    noises = [_relative_median(one.var_g, one.g, one.n_dof) for one in each]
    weight, g, noise, extra = (np.zeros((len(each), len(line)), t) for t in (float, complex, float, float))
    for m, (one, at, var) in enumerate(zip(each, where, noises, strict=True)):
        weight[m, at], g[m, at], noise[m, at] = 1 / (var + WEIGHT_FLOOR**2), one.g, var
        if excess is not None:
            extra[m, at] = excess[m]
    weight /= weight.sum(axis=0)
    mean = np.sum(weight * g, axis=0)
    size2, n_each = np.abs(mean) ** 2, np.count_nonzero(weight, axis=0)
    own = np.array([_spread(line, at, one.g, len(line)) for one, at in zip(each, where, strict=True)])
    noise = np.sum(weight**2 * noise, axis=0) * response_level(mean)
    sources = {"noise": noise, "floor": FLOOR**2 * size2}
    by_scatter = _same_excitation(line, where, phases) is False and np.any(n_each > 1)
    if by_scatter:
        sources["realisations"] = _scatter(line, weight, g, mean)
    elif own.any():
        sources["local_model"] = np.max(own, axis=0) * (1.0 if len(each) == 1 else 1 / n_each)
    if excess is not None and extra.any() and not by_scatter:
        sources["detection_lines"] = np.sum(weight**2 * extra, axis=0)
    first = each[0]
    return TotalVariance(
        line=line,
        f_hz=line * (first.fs_hz / first.period_samples),
        g=mean,
        var_noise=np.maximum(noise, np.finfo(float).tiny),
        var_total=np.max(list(sources.values()), axis=0),
        n_realisations=n_each,
        share=weight,
        sources=sources,
        smooth_phases=is_open and not by_scatter and all(map(_is_smooth, phases)),
        fs_hz=first.fs_hz,
        period_samples=first.period_samples,
        hold=first.hold,
        u_unit=first.u_unit,
        y_unit=first.y_unit,
        name=", ".join(one.name for one in each if one.name),
        settle_samples=first.settle_samples,
        rejected_hz=np.unique(np.concatenate([one.rejected_hz for one in each])),
    )


def _spread(line: np.ndarray, at: np.ndarray, g: np.ndarray, n_lines: int) -> np.ndarray:
    """Variance by the local model at the lines of one realisation, 0 at the others."""
    out = np.zeros(n_lines)
    out[at] = local_variance(line[at], g)
    return out


def response_level(g: np.ndarray) -> np.ndarray:
    """|g|^2, and at antiresonances that of the lines beside: distortion does not fall with the response.

    An antiresonance has larger responses on both sides. On a slope, and towards the ends of the band, the
    level is that of the line itself: behind a spring the response falls towards the first lines, and the
    distortion with it.

    Parameters
    ----------
    g : (F,) complex

    Returns
    -------
    (F,) ndarray
    """
    size2 = np.abs(g) ** 2
    n = min(HALF_WINDOW, (len(size2) - 1) // 2)
    before, after = (
        ndimage.median_filter(size2, n + 1, mode="nearest", origin=shift) for shift in (n // 2, -(n // 2))
    )
    return np.maximum(np.maximum(size2, np.minimum(before, after)), np.finfo(float).tiny)


def _running_median(x: np.ndarray) -> np.ndarray:
    n = min(2 * HALF_WINDOW + 1, 2 * ((len(x) - 1) // 2) + 1)
    return ndimage.median_filter(x, n, mode="nearest")


def _relative_median(variance: np.ndarray, g: np.ndarray, dof: float) -> np.ndarray:
    """Running median of the variance over the level of g."""
    return unbiased_median(variance / response_level(g), dof)


def unbiased_median(variance: np.ndarray, dof: float) -> np.ndarray:
    """Running median of variances over the lines, without the median's bias.

    Parameters
    ----------
    variance : (F,) ndarray
    dof : float
        Complex numbers that each variance was estimated from.
    """
    bias = 1.0 if np.isinf(dof) else special.gammaincinv(dof, 0.5) / dof
    return _running_median(variance) / bias


def _scatter(line: np.ndarray, weight: np.ndarray, g: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Variance of the mean by the scatter over realisations; lines of one realisation take their neighbours'.

    Eq: BLA-1
    """
    n_each = np.count_nonzero(weight, axis=0)
    several = n_each > 1
    away = np.sum(weight**2 * np.abs(g - mean) ** 2, axis=0)
    share = np.sum(weight**2, axis=0)
    expected = share + share**2 - 2 * np.sum(weight**3, axis=0)  # of `away`, over the variance of one
    unbiased = away / np.where(several, expected, 1.0)
    dof = float(np.median(n_each[several])) - 1
    one = _relative_median(unbiased[several], mean[several], dof)
    everywhere = np.exp(np.interp(line, line[several], np.log(np.maximum(one, np.finfo(float).tiny))))
    return everywhere * response_level(mean) * share


def local_variance(line: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Variance of a response by what a local rational model of neighbouring lines leaves (BLA-2).

    Parameters
    ----------
    line : (F,) int
        Lines, ascending.
    g : (F,) complex

    Returns
    -------
    (F,) ndarray
        Smoothed over lines; zeros with fewer than 39 lines.
    """
    if len(line) < FEW_LINES:
        return np.zeros(len(line))
    first = np.clip(np.arange(len(line)) - LOCAL_LINES // 2, 0, len(line) - LOCAL_LINES)
    beside = first[:, None] + np.arange(LOCAL_LINES)
    x = (line[beside] - line[beside[:, LOCAL_LINES // 2], None]).astype(float)
    x /= np.abs(x).max(axis=1, keepdims=True)
    level = response_level(g)
    weight = 1 / np.sqrt(level[beside])
    found = [_rational_residual(x, g[beside], weight, *orders) for orders in LOCAL_ORDERS]
    dof = LOCAL_LINES - 1 - max(sum(orders) for orders in LOCAL_ORDERS)
    return unbiased_median(np.min(found, axis=0), dof) * level


def _rational_residual(
    x: np.ndarray, g: np.ndarray, weight: np.ndarray, n_num: int, n_den: int
) -> np.ndarray:
    """Weighted residual variance of B(x)/A(x) around each line, A(0) = 1, by linear least squares."""
    scaled = g * weight
    num = weight[:, :, None] * x[:, :, None] ** np.arange(n_num + 1) + 0j
    den = -scaled[:, :, None] * x[:, :, None] ** np.arange(1, n_den + 1)
    q, r = np.linalg.qr(np.concatenate([num, den], axis=2))
    projected = np.einsum("krc,kr->kc", q.conj(), scaled)
    rest = scaled - np.einsum("krc,kc->kr", q, projected)
    if n_den:
        coefficient = np.linalg.solve(r, projected[:, :, None])[:, n_num + 1 :, 0]
        rest = rest / (1 + np.einsum("krc,kc->kr", x[:, :, None] ** np.arange(1, n_den + 1), coefficient))
    dof = x.shape[1] - n_num - n_den - 1
    return np.sum(np.abs(rest) ** 2, axis=1) / dof


def _detected(part: Realisation, response: Frf) -> np.ndarray:
    """Power at detection lines above the noise, over that of the input at the excited line (BLA-3).

    Lines of the same parity only: odd distortion is what falls on odd lines, where the excitation is odd.
    """
    line = response.line
    candidate = np.arange(max(line[0] - DETECTION_REACH, 1), line[-1] + 1)
    spacing = int(np.median(np.diff(line))) if len(line) > 1 else 1
    parity = line % 2 == line[0] % 2
    if not parity.all():
        free = candidate[~part.large[candidate]]
    else:
        free = candidate[~part.large[candidate] & (candidate % 2 == line[0] % 2)]
    if not len(free):
        return np.zeros(len(line))
    Y, U = part.output(free), part.input(free)
    g = np.interp(free, line, response.g.real) + 1j * np.interp(free, line, response.g.imag)
    rest = Y - g * U
    noise = sample_variance(rest) / len(rest) if len(rest) > 1 else np.zeros(len(free))
    power = np.abs(rest.mean(axis=0)) ** 2 - noise
    cumulated, count = (np.concatenate([[0.0], np.cumsum(a)]) for a in (power, np.ones(len(free))))
    lo = np.searchsorted(free, line - DETECTION_REACH * spacing)
    hi = np.searchsorted(free, line + DETECTION_REACH * spacing, side="right")
    n = count[hi] - count[lo]
    mean = np.where(n > 0, (cumulated[hi] - cumulated[lo]) / np.maximum(n, 1), 0.0)
    return np.maximum(mean, 0) / np.abs(response.u) ** 2


def _same_excitation(line: np.ndarray, where: list[np.ndarray], phases: list[np.ndarray]) -> bool:
    """Whether all realisations have the phases of the first: their scatter is then noise alone."""
    if len(phases) == 1:
        return True
    lines = [line[at] for at in where]
    for other, phase in zip(lines[1:], phases[1:], strict=True):
        _, mine, theirs = np.intersect1d(lines[0], other, return_indices=True)
        if not len(mine) or abs(np.mean(phases[0][mine].conj() * phase[theirs])) < SAME_PHASES:
            return False
    return True


def _is_smooth(phase: np.ndarray) -> bool:
    """Whether the phases' second differences are alike from line to line, as those of Schroeder's are."""
    if len(phase) < FEW_LINES:
        return False
    step = phase[1:] * phase[:-1].conj()
    bend = step[1:] * step[:-1].conj()
    return bool(abs(np.mean(bend[1:] * bend[:-1].conj())) > SMOOTH_PHASES / np.sqrt(len(phase)))
