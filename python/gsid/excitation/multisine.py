"""Multisines on a grid of lines k fs/N. A request is met exactly or raises an error."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from numbers import Integral

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.bands import ON_A_LINE, two_frequencies
from gsid.excitation.periodic import Periodic, require_one_of, require_rate, whole_period

GRIDS = ("full", "odd", "odd-random", "quasi-log")
GROUP = 4  # on the grid odd-random, one randomly drawn line of each group of odd lines is omitted
LINES_PER_DECADE = 20  # of the grid quasi-log
PHASES = ("schroeder", "random")


@dataclass(repr=False)
class Multisine(Periodic):
    """u[n] = sum over lines of amplitude cos(2 pi line n / N + phase)  (EXC-1; thesis, eqs. 3.4 and 3.8).

    Attributes
    ----------
    fs_hz : float
        Sample rate [Hz].
    period_samples : int
        Number of samples of a period, N.
    line : (F,) int
        Excited lines, ascending, 1 <= line < N/2; line k is at k fs/N [Hz].
    amplitude : (F,) float
        Amplitude of each sine, unit of the command.
    phase_rad : (F,) float
        Phase of each sine [rad].
    grid : {"full", "odd", "odd-random", "quasi-log"}
    shape_db_per_decade : float
        Slope of the amplitude over frequency.
    seed : int or None
        Seed of random phases; None for Schroeder phases.
    optimised : bool
        True if the phases were optimised from these (`gsid.excitation.limits.optimise`).
    """

    fs_hz: float
    period_samples: int
    line: np.ndarray
    amplitude: np.ndarray
    phase_rad: np.ndarray
    grid: str = "full"
    shape_db_per_decade: float = 0.0
    seed: int | None = None
    optimised: bool = False

    @classmethod
    def design(
        cls,
        fs_hz: float,
        period_samples: float,
        band_hz: tuple[float, float],
        *,
        grid: str = "full",
        phases: str = "schroeder",
        seed: int = 0,
        offset_phase_rad: float = 0.0,
        shape_db_per_decade: float = 0.0,
        amplitude: float | None = None,
        rms: float | None = None,
        peak: float | None = None,
    ) -> Multisine:
        """Design a multisine.

        Parameters
        ----------
        fs_hz : float
            Sample rate [Hz], > 0.
        period_samples : int
            Number of samples of a period, N; a whole number.
        band_hz : (lo, hi)
            First and last frequency allowed [Hz], 0 < lo < hi < fs/2.
        grid : {"full", "odd", "odd-random", "quasi-log"}
            "full": every line of the band. "odd": odd lines only; the even lines then detect even
            distortion. "odd-random": odd lines, of which one in every four, drawn by the seed, is omitted to
            detect odd distortion (EXC-8). "quasi-log": odd lines spaced evenly in log f.
        phases : {"schroeder", "random"}
            "schroeder": phases of low crest factor (EXC-2; thesis, definition 3.5.1). "random": independent
            phases, uniform on [0, 2 pi) (EXC-3; thesis, definition 5.3.1).
        seed : int
            Seed of random phases and of the grid "odd-random", 0 .. 2^64 - 1.
        offset_phase_rad : float
            Added to every phase [rad]. It moves the mean position of an axis; the thesis has 0.2793 with
            Schroeder phases (section 3.5).
        shape_db_per_decade : float
            Slope of the amplitude over frequency. 0 is flat; -10 falls as 1/sqrt(f).
        amplitude, rms, peak : float, optional
            Level in units of the command; give at most one: amplitude of the first line, rms of the signal,
            or largest magnitude of its samples. Default: amplitude 1.

        Returns
        -------
        Multisine

        Raises
        ------
        ValueError
            The request cannot be met. The message contains the nearest valid request.
        """
        require_rate(fs_hz)
        require_one_of("grid", grid, GRIDS)
        require_one_of("phases", phases, PHASES)
        if not (isinstance(seed, Integral) and 0 <= seed < 2**64):
            raise ValueError(f"the seed must be a whole number within 0 .. 2^64 - 1, not {seed}")
        if not math.isfinite(shape_db_per_decade):
            raise ValueError(f"the slope must be a finite number of dB per decade, not {shape_db_per_decade}")
        n_period = whole_period(period_samples)
        line = _lines_in_band(fs_hz, n_period, band_hz, grid, seed)
        shape = np.empty(len(line))
        check(
            lib.gsid_amplitude_shape(len(line), _u32(line), shape_db_per_decade, _real(shape)),
            "shaping the amplitudes",
        )
        phase_rad = np.empty(len(line))
        if phases == "random":
            check(lib.gsid_phase_random(len(line), seed, _real(phase_rad)), "drawing random phases")
        else:
            check(lib.gsid_phase_schroeder(len(line), _real(shape), _real(phase_rad)), "Schroeder phases")
        if not math.isfinite(offset_phase_rad):
            raise ValueError(f"the offset of the phases must be a finite number, not {offset_phase_rad}")
        unit = cls(
            float(fs_hz),
            n_period,
            line,
            shape,
            phase_rad + offset_phase_rad,
            grid,
            float(shape_db_per_decade),
            seed if phases == "random" else None,
        )
        unit.amplitude = shape * _size(unit, amplitude, rms, peak)
        return unit

    def table(self) -> np.ndarray:
        """One period of the signal.

        Returns
        -------
        (N,) float64, unit of the command

        Raises
        ------
        GsidError
            The attributes were changed to values that do not define a multisine.
        """
        line, amplitude, phase_rad = self._arrays()
        twiddle = np.empty(self.period_samples, complex)
        check(lib.gsid_twiddle_fill(self.period_samples, _cplx(twiddle)), "making the twiddle table")
        cfg = ffi.new("gsid_multisine_cfg *")
        cfg.n_period, cfg.n_lines = self.period_samples, len(line)
        cfg.line, cfg.amplitude, cfg.phase_rad = _u32(line), _real(amplitude), _real(phase_rad)
        cfg.twiddle = _cplx(twiddle)
        multisine = ffi.new("gsid_multisine *")
        check(lib.gsid_multisine_init(multisine, cfg), "setting up the multisine")
        u = np.empty(self.period_samples)
        check(lib.gsid_multisine_table(multisine, _real(u)), "computing the period")
        return u

    def spectrum(self) -> np.ndarray:
        """Complex amplitudes amplitude exp(j phase) of the lines, (F,) complex, unit of the command."""
        return np.asarray(self.amplitude) * np.exp(1j * np.asarray(self.phase_rad))

    def scaled(self, factor: float) -> Multisine:
        """The same multisine, times a factor."""
        return replace(self, amplitude=np.asarray(self.amplitude) * factor)

    def _head(self) -> dict[str, object]:
        phases = "schroeder" if self.seed is None else f"random, seed {self.seed}"
        return {
            "lines": f"{self.grid}, {self.line[0]} to {self.line[-1]}",
            "shape_db_per_decade": f"{self.shape_db_per_decade:g}",
            "phases": "optimised" if self.optimised else phases,
        }

    def __repr__(self) -> str:
        f_hz = self.f_hz
        phases = "Schroeder phases" if self.seed is None else f"random phases, seed {self.seed}"
        phases = f"optimised from {phases}" if self.optimised else phases
        return (
            f"Multisine({len(f_hz)} {self.grid} lines {f_hz[0]:g} .. {f_hz[-1]:g} Hz, period "
            f"{self.period_samples} at {self.fs_hz:g} Hz, {self.shape_db_per_decade:g} dB/decade, {phases}, "
            f"rms {self.rms:.4g}, crest factor {self.crest_factor_fine:.3f})"
        )

    def _arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return (
            np.ascontiguousarray(self.line, np.uint32),
            np.ascontiguousarray(self.amplitude, float),
            np.ascontiguousarray(self.phase_rad, float),
        )


def _lines_in_band(
    fs_hz: float, n_period: int, band_hz: tuple[float, float], grid: str, seed: int
) -> np.ndarray:
    """Line numbers of the grid within the band, (F,) uint32."""
    step = 1 if grid == "full" else 2
    lo, hi = lines_of_band(fs_hz, n_period, band_hz, step)
    first, last = whole_lines(lo, hi)

    def fill(capacity: int, line: object) -> int:
        if grid == "odd-random":
            return lib.gsid_lines_odd_random(first, last, GROUP, seed, capacity, line, n_lines)
        if grid == "quasi-log":
            return lib.gsid_lines_quasi_log(first, last, LINES_PER_DECADE, capacity, line, n_lines)
        kind = lib.GSID_GRID_FULL if grid == "full" else lib.GSID_GRID_ODD
        return lib.gsid_lines_fill(kind, first, last, capacity, line, n_lines)

    n_lines = ffi.new("uint32_t *")
    status = fill(0, ffi.NULL) if first <= last else lib.GSID_E_CONFIG
    if status == lib.GSID_E_CONFIG:
        kind = "" if grid == "full" else "odd "
        raise ValueError(
            f"no {kind}line in {band_hz[0]:g}:{band_hz[1]:g} Hz with lines {fs_hz / n_period:g} Hz apart; "
            f"{_nearest_band(fs_hz, n_period, lo, hi, step)}"
        )
    check(status, "counting the lines")
    line = np.empty(n_lines[0], np.uint32)
    check(fill(len(line), _u32(line)), "listing the lines")
    return line


def lines_of_band(
    fs_hz: float, n_period: int, band_hz: tuple[float, float], step: int = 1
) -> tuple[float, float]:
    """Edges of a band as line numbers, not rounded.

    Parameters
    ----------
    fs_hz : float
        Sample rate [Hz].
    n_period : int
        Number of samples of a period, N.
    band_hz : (lo, hi)
        Band [Hz].
    step : int
        Distance of the lines that may be excited, counted from line 1.

    Raises
    ------
    ValueError
        The band is not finite, starts at or below 0, has no width, or reaches fs/2. The message contains the
        nearest valid band.
    """
    lo_hz, hi_hz = two_frequencies(band_hz)
    spacing = fs_hz / n_period
    top = (n_period - 1) // 2
    if not (math.isfinite(lo_hz) and math.isfinite(hi_hz)):
        nearest = _nearest_band(fs_hz, n_period, 1, top, step)
        raise ValueError(f"the band {lo_hz}:{hi_hz} Hz is not finite; {nearest}")
    lo, hi = lo_hz / spacing, hi_hz / spacing
    if lo_hz <= 0:
        nearest = _nearest_band(fs_hz, n_period, 1, hi, step)
        raise ValueError(f"the band {lo_hz:g}:{hi_hz:g} Hz starts at or below 0; {nearest}")
    if lo_hz >= hi_hz:
        nearest = _nearest_band(fs_hz, n_period, lo, lo, step)
        raise ValueError(f"the band {lo_hz:g}:{hi_hz:g} Hz has no width; {nearest}")
    if hi_hz >= fs_hz / 2:
        nearest = _nearest_band(fs_hz, n_period, lo, hi, step)
        raise ValueError(f"the band {lo_hz:g}:{hi_hz:g} Hz reaches fs/2, {fs_hz / 2:g} Hz; {nearest}")
    return lo, hi


def whole_lines(lo: float, hi: float) -> tuple[int, int]:
    """First and last line between two edges in line numbers; there is none if first > last."""
    return max(math.ceil(lo - ON_A_LINE), 1), math.floor(hi + ON_A_LINE)


def _nearest_band(fs_hz: float, n_period: int, lo: float, hi: float, step: int) -> str:
    top = (n_period - 1) // 2  # last line below fs/2
    top -= (top - 1) % step
    first = 1 + step * round((min(max(lo, 1), top) - 1) / step)
    last = 1 + step * round((min(max(hi, 1), top) - 1) / step)
    last = max(last, min(first + step, top))
    spacing = fs_hz / n_period
    return f"the nearest valid request is {first * spacing:.10g}:{last * spacing:.10g} Hz"


def _size(unit: Multisine, amplitude: float | None, rms: float | None, peak: float | None) -> float:
    """Amplitude of the first line for the requested level; `unit` has amplitude 1 there."""
    requested = {"amplitude": amplitude, "rms": rms, "peak": peak}
    requested = {name: value for name, value in requested.items() if value is not None}
    if len(requested) > 1:
        raise ValueError(f"give one of amplitude, rms and peak, not {' and '.join(requested)}")
    if not requested:
        return 1.0
    name, value = requested.popitem()
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be a positive number, not {value}")
    return value / (1.0 if name == "amplitude" else getattr(unit, name))


def _u32(array: np.ndarray):
    return ffi.from_buffer("uint32_t[]", array)


def _real(array: np.ndarray):
    return ffi.from_buffer("double[]", array)


def _cplx(array: np.ndarray):
    return ffi.from_buffer("gsid_cplx[]", array)
