"""Noise and nonlinear distortion of several inputs and outputs (DIS-7).

A realisation is one experiment for each input, best with orthogonal multisines (EXC-13). With the matrix G of
all experiments, the error of period p of experiment e is E[e, p] = Y[e, p] - G U[e, p]. Its scatter over the
periods is noise. The scatter of its means over the experiments is noise and distortion; what is linear, cross
coupling included, is in G. Without distortion the ratio of both follows an F distribution exactly, whatever
the inputs of the experiments are.

A linear coupling takes the distortion of one axis to all outputs. Where there are as many outputs as inputs,
the errors are therefore also referred to the inputs: E_u = G^-1 E. A nonlinear torque of one joint acts like
a command of that joint's motor, so that it is found at this input only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gsid.base.bands import within
from gsid.base.errors import InputError
from gsid.records.mimo import MimoRecord
from gsid.response.distortion import DistortedBand, LinePower, bands_of, span
from gsid.response.mimo import (
    CONDITION_MAX,
    LEAST_KEPT,
    ExperimentLines,
    adjoint,
    experiment_lines,
    means_of,
)


@dataclass(frozen=True, repr=False)
class ChannelDistortion:
    """Distortion at one output, or referred to one input.

    Attributes
    ----------
    name, unit : str
    side : {"output", "input"}
    f_hz : (F,) [Hz]
        Excited lines.
    level, level_noise : (F,)
        Rms amplitude of the distortion of one experiment, and of the noise that is left in its mean over the
        periods. The former is 0 where noise explains the scatter, and NaN with one realisation.
    bands : list of DistortedBand
    """

    name: str
    unit: str
    side: str
    f_hz: np.ndarray
    level: np.ndarray
    level_noise: np.ndarray
    bands: list[DistortedBand]

    @property
    def is_distorted(self) -> bool:
        """Whether noise does not explain the scatter in some band."""
        return any(band.kind != "noise" for band in self.bands)

    @property
    def sentence(self) -> str:
        """Distorted bands in words."""
        parts = [f"{span(band)} {band.kind} {_size(band)}" for band in self.bands if band.kind != "noise"]
        return ", ".join(parts) or "noise only"

    def __repr__(self) -> str:
        return f"ChannelDistortion({self.side} {self.name}: {self.sentence})"


@dataclass(frozen=True, repr=False)
class MimoDistortion:
    """Matrix of best linear approximations with separate variances of noise and nonlinear distortion.

    Attributes
    ----------
    f_hz : (F,) [Hz]
    bla : (F, n_y, n_u) complex
        As `gsid.frf_mimo`.
    var_noise, var_total : (F, n_y, n_u)
        Variance of `bla` due to noise, and due to noise and distortion; the latter is the scatter over the
        realisations, NaN with one.
    std_nonlinear : (F, n_y, n_u)
        Standard deviation of the response of one realisation due to distortion; NaN with one.
    outputs : list of ChannelDistortion
    inputs : list of ChannelDistortion
        Referred to the inputs; empty where G has no inverse.
    n_experiments, n_realisations, n_periods : int
        n_periods counts the periods of all experiments together.
    fs_hz : float
    period_samples : int
    """

    f_hz: np.ndarray
    bla: np.ndarray
    var_noise: np.ndarray
    var_total: np.ndarray
    std_nonlinear: np.ndarray
    outputs: list[ChannelDistortion]
    inputs: list[ChannelDistortion]
    n_experiments: int
    n_realisations: int
    n_periods: int
    fs_hz: float
    period_samples: int
    masked_hz: np.ndarray = field(default_factory=lambda: np.empty(0))

    @property
    def distorted_inputs(self) -> list[str]:
        """Inputs to which distortion is referred."""
        return [channel.name for channel in self.inputs if channel.is_distorted]

    @property
    def distorted_outputs(self) -> list[str]:
        """Outputs at which distortion is found."""
        return [channel.name for channel in self.outputs if channel.is_distorted]

    @property
    def verdict(self) -> str:
        """What is distorted, in one or two sentences."""
        if not (self.distorted_inputs or self.distorted_outputs):
            return "No distortion above the noise at any channel: averaging longer helps everywhere."
        at = ", ".join(self.distorted_outputs)
        seen = f"Distortion above the noise at the output {at}." if at else ""
        if not self.inputs:
            return f"{seen} It cannot be referred to the inputs: there are not as many of them as outputs."
        sources = [f"{one.name} ({one.sentence})" for one in self.inputs if one.is_distorted]
        source = (
            f"It enters at the input {'; '.join(sources)}." if sources else "No single input explains it."
        )
        return f"{seen} {source}".strip()

    def __repr__(self) -> str:
        n_y, n_u = self.bla.shape[1:]
        measured = f"{self.n_realisations} realisations, {self.n_periods} periods"
        return f"MimoDistortion({n_y} x {n_u}: {len(self.f_hz)} lines, {measured}; {self.verdict})"


def distortion_mimo(
    records: Sequence[MimoRecord], *, band: tuple[float, float] | None = None
) -> MimoDistortion:
    """Separate noise, nonlinear distortion and linear coupling of several inputs and outputs.  Eq: DIS-7

    Parameters
    ----------
    records : sequence of MimoRecord
        Realisations of as many experiments as inputs, one realisation after the other, all with the same
        input level.
    band : (lo, hi), optional
        Use only lines within this band [Hz].

    Returns
    -------
    MimoDistortion

    Raises
    ------
    InputError
        As `gsid.frf_mimo`; or the number of experiments is not a multiple of that of the inputs; or there is
        one realisation, and all lines are excited.
    ValueError
        The band contains no line.
    """
    lines = experiment_lines(records, band=band)
    n_u, n_e, first = len(lines.first.inputs), len(lines.us), lines.first
    if n_e % n_u:
        hint = "give as many experiments as inputs for each realisation, one realisation after the other"
        raise InputError("the experiments are not whole realisations", first.name, f"{n_e} for {n_u}", hint)
    free = lines.free & within(lines.f_hz, band)
    if n_e == n_u and not free.any():
        hint = "measure two realisations, or leave out lines: `gsid design orthogonal --lines odd-random`"
        raise InputError("one realisation does not show distortion", first.name, None, hint)
    us, ys = _at(lines.us, lines.excited), _at(lines.ys, lines.excited)
    mean_u, mean_y, weight = means_of(us), means_of(ys), lines.weight
    spread = np.linalg.inv((mean_u * weight) @ adjoint(mean_u))
    g = (mean_y * weight) @ adjoint(mean_u) @ spread
    f_hz = lines.f_hz[lines.excited]
    at_excited = _Errors.of(us, ys, g, np.flatnonzero(lines.excited))
    g_free = _interpolated(lines.f_hz[free], f_hz, g)
    at_free = _Errors.of(_at(lines.us, free), _at(lines.ys, free), g_free, np.flatnonzero(free))
    sides = {"output": (at_excited, at_free)}
    referred = at_excited.referred(), at_free.referred()
    if None not in referred:
        sides["input"] = referred
    n_channels = len(first.outputs) + (len(first.inputs) if "input" in sides else 0)
    tested = {side: _Tested(lines, *parts, n_channels) for side, parts in sides.items()}
    return MimoDistortion(
        f_hz=f_hz,
        bla=g,
        **_entries(mean_u, mean_y, at_excited.noise, spread),
        outputs=tested["output"].channels("output", first.outputs, first.y_units),
        inputs=tested["input"].channels("input", first.inputs, first.u_units) if "input" in tested else [],
        n_experiments=n_e,
        n_realisations=n_e // n_u,
        n_periods=int(weight.sum()),
        fs_hz=first.fs_hz,
        period_samples=lines.n_period,
        masked_hz=lines.masked_hz,
    )


@dataclass(frozen=True)
class _Errors:
    """Errors of every period of each experiment, (P, channels, F), at some lines."""

    errors: list[np.ndarray]
    g: np.ndarray
    line: np.ndarray

    @classmethod
    def of(cls, us: list[np.ndarray], ys: list[np.ndarray], g: np.ndarray, line: np.ndarray) -> _Errors:
        """Y - G U."""
        return cls([y - np.einsum("kij,pjk->pik", g, u) for u, y in zip(us, ys, strict=True)], g, line)

    @property
    def noise(self) -> np.ndarray:
        """(F, channels) variance of one period by the scatter over the periods."""
        total = sum(np.sum(np.abs(e - e.mean(axis=0)) ** 2, axis=0) for e in self.errors)
        return total.T / sum(len(e) - 1 for e in self.errors)

    @property
    def power(self) -> np.ndarray:
        """(F, channels) sum over the experiments of |mean error|^2, each times its periods."""
        return sum(len(e) * np.abs(e.mean(axis=0)) ** 2 for e in self.errors).T

    def referred(self) -> _Errors | None:
        """The errors referred to the inputs, at the lines where G has an inverse; None if they are few."""
        if self.g.shape[1] != self.g.shape[2]:
            return None
        size = np.linalg.norm(self.g, axis=2, keepdims=True)
        usable = np.ones(len(self.g), bool)
        if len(self.g):
            usable = np.linalg.cond(self.g / np.where(size > 0, size, 1)) <= CONDITION_MAX
            if np.mean(usable) < LEAST_KEPT:
                return None
        inverse = np.linalg.inv(self.g[usable])
        referred = [np.einsum("kij,pjk->pik", inverse, e[..., usable]) for e in self.errors]
        return _Errors(referred, self.g[usable], self.line[usable])


@dataclass(frozen=True)
class _Tested:
    """Errors of the outputs, or referred to the inputs, at the excited and at the free lines."""

    lines: ExperimentLines
    excited: _Errors
    free: _Errors
    n_channels: int  # outputs and inputs that are tested together

    def channels(self, side: str, names: list[str], units: list[str]) -> list[ChannelDistortion]:
        """Level and bands of each channel."""
        n_e, n_u = len(self.lines.us), len(self.lines.first.inputs)
        noise, f_hz = self.excited.noise, self.lines.f_hz[self.excited.line]
        unknown = np.full(noise.shape, np.nan)
        total = self.excited.power / (n_e - n_u) if n_e > n_u else unknown
        per_mean = self.lines.weight.mean()
        return [
            ChannelDistortion(
                name=name,
                unit=unit,
                side=side,
                f_hz=f_hz,
                level=np.sqrt(np.maximum(total[:, i] - noise[:, i], 0) / per_mean),
                level_noise=np.sqrt(noise[:, i] / per_mean),
                bands=bands_of(self._evidence(i, total[:, i], noise[:, i]), f_hz, self.n_channels),
            )
            for i, (name, unit) in enumerate(zip(names, units, strict=True))
        ]

    def _evidence(self, i: int, total: np.ndarray, noise: np.ndarray) -> dict[str, LinePower]:
        """Measured power and noise of a channel, by kind of line; orders are those of DIS-3."""
        n_e, n_u, f_hz = len(self.lines.us), len(self.lines.first.inputs), self.lines.f_hz
        nu_noise = 2 * int(self.lines.weight.sum() - n_e)
        line, free = self.excited.line, self.free.line
        unit = int(np.gcd.reduce(line))
        is_odd = bool(np.all(line // unit % 2 == 1))
        kinds = {}
        if n_e > n_u:
            name = "odd" if is_odd else "nonlinear"
            kinds[name] = LinePower(f_hz[line], total, noise, (2 * (n_e - n_u), nu_noise))
        order = np.where(free % unit == 0, free // unit, 0)
        chosen = {"even": (order > 0) & (order % 2 == 0), "odd": order % 2 == 1}
        for name, use in (chosen if is_odd else {"nonlinear": order > 0}).items():
            if name not in kinds and use.any():
                powers = self.free.power[use, i] / n_e, self.free.noise[use, i]
                kinds[name] = LinePower(f_hz[free[use]], *powers, (2 * n_e, nu_noise))
        return kinds


def _at(parts: list[np.ndarray], use: np.ndarray) -> list[np.ndarray]:
    """The same arrays (P, channels, F) at some lines."""
    return [part[..., use] for part in parts]


def _interpolated(f_hz: np.ndarray, at_hz: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Matrix of responses between the excited lines, as DIS-3; (F, n_y, n_u)."""
    flat = g.reshape(len(g), -1).T
    parts = [np.interp(f_hz, at_hz, one.real) + 1j * np.interp(f_hz, at_hz, one.imag) for one in flat]
    return np.array(parts).T.reshape(len(f_hz), *g.shape[1:])


def _entries(
    mean_u: np.ndarray, mean_y: np.ndarray, noise: np.ndarray, spread: np.ndarray
) -> dict[str, np.ndarray]:
    """Variances of each entry of G by the scatter of the responses of single realisations (DIS-2).

    Experiments of one realisation share phases, and their distortions may be correlated. The scatter over
    realisations holds in any case.
    """
    n_u, n_e = mean_u.shape[1], mean_u.shape[2]
    m = n_e // n_u
    var_noise = noise[:, :, None] * np.einsum("kjj->kj", spread).real[:, None, :]
    blocks = [slice(i * n_u, (i + 1) * n_u) for i in range(m)]
    if m < 2:
        unknown = np.full(var_noise.shape, np.nan)
        return {"var_noise": var_noise, "var_total": unknown, "std_nonlinear": unknown.copy()}
    single = [mean_y[..., b] @ np.linalg.inv(mean_u[..., b]) for b in blocks]
    var_total = np.var(single, axis=0, ddof=1) / m
    above = np.maximum(var_total - var_noise, 0)
    return {"var_noise": var_noise, "var_total": var_total, "std_nonlinear": np.sqrt(m * above)}


def _size(band: DistortedBand) -> str:
    low, high = f"{band.low_db:.0f}", f"{band.high_db:.0f}"
    return f"{low} dB above noise" if low == high else f"{low} to {high} dB above noise"
