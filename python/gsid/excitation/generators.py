"""Binary sequences, swept sines and stepped sines; the C core computes their samples, as on the target."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from gsid._lib import check, ffi, lib
from gsid.base.bands import ON_A_LINE
from gsid.excitation.multisine import Multisine, lines_of_band, whole_lines
from gsid.excitation.periodic import Periodic, require_one_of, require_rate, whole_period
from gsid.response.stepped import Steps

PRBS_KINDS = {
    "quadratic-residue": lib.GSID_PRBS_QUADRATIC_RESIDUE,
    "maximum-length": lib.GSID_PRBS_MAXIMUM_LENGTH,
}
SWEEP_KINDS = {"linear": lib.GSID_SWEEP_LINEAR, "log": lib.GSID_SWEEP_LOGARITHMIC}
CLOCK_OVER_BAND = 2.5  # of a binary sequence: its power has halved at 0.4 of its clock (thesis, section 3.6)


def _samples(step: object, n: int) -> np.ndarray:
    """Compute n samples of a generator of the core, one call per sample."""
    u, sample = np.empty(n), ffi.new("double *")
    for i in range(n):
        check(step(sample), "computing the period")
        u[i] = sample[0]
    return u


def _require_amplitude(amplitude: float) -> None:
    if not (math.isfinite(amplitude) and amplitude > 0):
        raise ValueError(f"the amplitude must be a positive number, not {amplitude}")


def _lines_of_interest(fs_hz: float, period_samples: int, band_hz: tuple[float, float]) -> np.ndarray:
    """All lines of a band, (F,) int. Raise ValueError if the band contains no line."""
    first, last = whole_lines(*lines_of_band(fs_hz, period_samples, band_hz))
    if first > last:
        raise ValueError(f"no line in {band_hz[0]:g}:{band_hz[1]:g} Hz: use a longer period for closer lines")
    return np.arange(first, last + 1)


def request(
    fs_hz: float, period_samples: float, band_hz: tuple[float, float], amplitude: float
) -> tuple[int, np.ndarray]:
    """Check a request; return its period [samples] and lines of interest, (F,) int.

    Parameters
    ----------
    fs_hz : float
    period_samples : int
    band_hz : (lo, hi)
    amplitude : float

    Raises
    ------
    ValueError
        The request cannot be met.
    """
    _require_amplitude(amplitude)
    require_rate(fs_hz)
    n_period = whole_period(period_samples)
    return n_period, _lines_of_interest(fs_hz, n_period, band_hz)


@dataclass(repr=False)
class Prbs(Periodic):
    """Pseudorandom binary sequence of levels +-amplitude (EXC-4, EXC-5; thesis, section 3.6).

    Attributes
    ----------
    fs_hz : float
        Sample rate [Hz].
    n_chips : int
        Number of chips in a period.
    n_hold : int
        Number of samples of a chip; the clock is fs/n_hold.
    line : (F,) int
        Lines of interest.
    amplitude : float
        Unit of the command.
    kind : {"quadratic-residue", "maximum-length"}
    """

    fs_hz: float
    n_chips: int
    n_hold: int
    line: np.ndarray
    amplitude: float = 1.0
    kind: str = "quadratic-residue"

    @classmethod
    def design(
        cls,
        fs_hz: float,
        period_samples: int,
        band_hz: tuple[float, float],
        *,
        kind: str = "quadratic-residue",
        amplitude: float = 1.0,
    ) -> Prbs:
        """Design a sequence with a clock of about 2.5 times the upper edge of the band, as in the thesis.

        Parameters
        ----------
        fs_hz : float
            Sample rate [Hz].
        period_samples : int
            Number of chips times samples per chip. The number of chips must be a valid sequence length.
        band_hz : (lo, hi)
            Band of interest [Hz].
        kind : {"quadratic-residue", "maximum-length"}
            Valid lengths are odd primes for "quadratic-residue" and 2^m - 1 for "maximum-length". Apart from
            the response of the hold, the spectrum is flat. For primes 4 k + 1 it is only nearly flat.
        amplitude : float
            Unit of the command.

        Returns
        -------
        Prbs

        Raises
        ------
        ValueError
            The request cannot be met. The message contains the nearest valid request.
        """
        require_one_of("kind", kind, PRBS_KINDS)
        period_samples, line = request(fs_hz, period_samples, band_hz, amplitude)
        n_hold = max(1, math.floor(fs_hz / (CLOCK_OVER_BAND * band_hz[1]) + ON_A_LINE))
        requested = round(period_samples / n_hold)
        n_chips = int(lib.gsid_prbs_nearest(PRBS_KINDS[kind], requested))
        if n_chips * n_hold != period_samples:
            raise ValueError(
                f"a {kind} sequence with {n_hold} samples per chip cannot have a period of {period_samples} "
                f"samples; "
                f"the nearest valid request is {n_chips * n_hold} samples ({n_chips} chips)"
            )
        return cls(float(fs_hz), n_chips, n_hold, line, float(amplitude), kind)

    @property
    def period_samples(self) -> int:
        """Number of samples of a period, N."""
        return self.n_chips * self.n_hold

    def table(self) -> np.ndarray:
        """One period, (N,) float64, unit of the command."""
        prbs = ffi.new("gsid_prbs *")
        cfg = ffi.new("gsid_prbs_cfg *", [PRBS_KINDS[self.kind], self.n_chips, self.n_hold, self.amplitude])
        check(lib.gsid_prbs_init(prbs, cfg), "setting up the binary sequence")
        return _samples(lambda u: lib.gsid_prbs_step(prbs, u), self.period_samples)

    def scaled(self, factor: float) -> Prbs:
        """The same sequence, times a factor."""
        return replace(self, amplitude=self.amplitude * factor)

    def _head(self) -> dict[str, object]:
        return {"prbs": f"{self.kind}, {self.n_chips} chips of {self.n_hold} samples"}

    def __repr__(self) -> str:
        clock = self.fs_hz / self.n_hold
        return f"Prbs({self.kind}, {self.n_chips} chips at {clock:g} Hz, +-{self.amplitude:g})"


@dataclass(repr=False)
class Sweep(Periodic):
    """Swept sine that passes the band once in each period (EXC-6, EXC-7; thesis, section 3.7).

    Attributes
    ----------
    fs_hz : float
        Sample rate [Hz].
    period_samples : int
        Number of samples of a period, N.
    f_start_hz, f_stop_hz : float
        Frequencies at the start and at the end of a period [Hz].
    line : (F,) int
        Lines of interest.
    amplitude : float
        Unit of the command.
    phase_rad : float
        Phase of the sine at the start of a period [rad].
    kind : {"linear", "log"}
    has_mean : bool
        False: the mean of the period is subtracted.
    """

    fs_hz: float
    period_samples: int
    f_start_hz: float
    f_stop_hz: float
    line: np.ndarray
    amplitude: float = 1.0
    phase_rad: float = 0.0
    kind: str = "linear"
    has_mean: bool = True

    @classmethod
    def design(
        cls,
        fs_hz: float,
        period_samples: int,
        band_hz: tuple[float, float],
        *,
        kind: str = "linear",
        amplitude: float = 1.0,
        phase_rad: float = 0.0,
        phase_of: str = "sine",
        has_mean: bool = True,
        continuous: bool = True,
    ) -> Sweep:
        """Design a sweep.

        Parameters
        ----------
        fs_hz : float
            Sample rate [Hz].
        period_samples : int
            Number of samples of a period, N.
        band_hz : (lo, hi)
            Frequencies at the start and at the end of a period [Hz].
        kind : {"linear", "log"}
            Course of the frequency over time.
        amplitude : float
            Unit of the command.
        phase_rad : float
            Phase at the start of a period [rad].
        phase_of : {"sine", "cosine"}
            What the phase refers to. The thesis (section 3.7) has a cosine at 45 degrees.
        has_mean : bool
            False: subtract the mean of the period, which moves an axis without doing anything else.
        continuous : bool
            Lower the upper frequency slightly, so that a period contains a whole number of turns and the
            phase is continuous from one period to the next.

        Returns
        -------
        Sweep

        Raises
        ------
        ValueError
            The request cannot be met. The message contains the nearest valid request.
        """
        require_one_of("kind", kind, SWEEP_KINDS)
        require_one_of("phase_of", phase_of, ("sine", "cosine"))
        period_samples, line = request(fs_hz, period_samples, band_hz, amplitude)
        start_hz, stop_hz = map(float, band_hz)
        phase_rad += math.pi / 2 if phase_of == "cosine" else 0.0
        sweep = cls(
            float(fs_hz), period_samples, start_hz, stop_hz, line, amplitude, phase_rad, kind, has_mean
        )
        return sweep._whole() if continuous else sweep

    def _cfg(self) -> object:
        n, spacing = self.period_samples, self.fs_hz / self.period_samples
        start, stop = self.f_start_hz / spacing, self.f_stop_hz / spacing
        return ffi.new(
            "gsid_sweep_cfg *", [SWEEP_KINDS[self.kind], n, start, stop, self.amplitude, self.phase_rad]
        )

    @property
    def turns(self) -> float:
        """Number of turns of the sine in a period. A whole number gives a continuous phase."""
        return float(lib.gsid_sweep_turns(self._cfg()))

    def _whole(self) -> Sweep:
        whole = math.floor(self.turns)
        lowest = self.f_start_hz * (1 + 1e-9)
        if whole == self.turns:
            return self
        if replace(self, f_stop_hz=lowest).turns > whole:
            raise ValueError(
                f"no whole number of turns fits between {self.f_start_hz:g} and {self.f_stop_hz:g} Hz; "
                "use a longer period, or allow a phase jump between periods"
            )
        stop = brentq(lambda f: replace(self, f_stop_hz=f).turns - whole, lowest, self.f_stop_hz, xtol=1e-12)
        return replace(self, f_stop_hz=float(stop))

    def table(self) -> np.ndarray:
        """One period, (N,) float64, unit of the command."""
        sweep = ffi.new("gsid_sweep *")
        check(lib.gsid_sweep_init(sweep, self._cfg()), "setting up the sweep")
        u = _samples(lambda u: lib.gsid_sweep_step(sweep, u), self.period_samples)
        return u if self.has_mean else u - u.mean()

    def scaled(self, factor: float) -> Sweep:
        """The same sweep, times a factor."""
        return replace(self, amplitude=self.amplitude * factor)

    def _head(self) -> dict[str, object]:
        band = f"{self.f_start_hz:.10g} to {self.f_stop_hz:.10g} Hz"
        return {"sweep": f"{self.kind}, {band}, {self.turns:.6g} turns"}

    def __repr__(self) -> str:
        band = f"{self.f_start_hz:g} to {self.f_stop_hz:g} Hz"
        return f"Sweep({self.kind}, {band} in {self.period_samples} samples, +-{self.amplitude:g})"


@dataclass(repr=False)
class SteppedSine(Periodic):
    """Sequence of single sines, each with a settling time and whole periods to measure (thesis, figure 3.2).

    Attributes
    ----------
    fs_hz : float
        Sample rate [Hz].
    n_base : int
        Number of samples of the common period of all sines; line k is at k fs/n_base.
    line : (F,) int
        Lines in the order of the sequence.
    amplitude : (F,) float
        Amplitude of each sine, unit of the command.
    settle_samples, n_periods : int
        Settling time of each sine [samples], and number of periods measured after it.
    """

    fs_hz: float
    n_base: int
    line: np.ndarray
    amplitude: np.ndarray
    settle_samples: int
    n_periods: int

    @classmethod
    def design(
        cls,
        fs_hz: float,
        period_samples: int,
        band_hz: tuple[float, float],
        *,
        grid: str = "quasi-log",
        settle_samples: int | None = None,
        n_periods: int = 2,
        amplitude: float = 1.0,
    ) -> SteppedSine:
        """Design a stepped sine.

        Parameters
        ----------
        fs_hz : float
            Sample rate [Hz].
        period_samples : int
            Number of samples of the common period of all sines.
        band_hz : (lo, hi)
            Band [Hz].
        grid : str
            Grid of the lines, as in `Multisine.design`.
        settle_samples : int, optional
            Settling time of each sine [samples]; default: one period.
        n_periods : int
            Number of periods measured at each sine, >= 1. At least two are needed to estimate the noise.
        amplitude : float
            Amplitude of each sine, unit of the command.

        Returns
        -------
        SteppedSine

        Raises
        ------
        ValueError
            The request cannot be met. The message contains the nearest valid request.
        """
        _require_amplitude(amplitude)
        if n_periods < 1:
            raise ValueError(f"a sine must last at least 1 period, not {n_periods}")
        line = Multisine.design(fs_hz, period_samples, band_hz, grid=grid).line
        settle = period_samples if settle_samples is None else settle_samples
        if settle < 0:
            raise ValueError(f"settle_samples must be 0 or more, not {settle}")
        sizes = np.full(len(line), float(amplitude))
        return cls(float(fs_hz), int(period_samples), line, sizes, int(settle), int(n_periods))

    @property
    def period_samples(self) -> int:
        """Number of samples of the whole sequence."""
        return len(self.line) * (self.settle_samples + self.n_periods * self.n_base)

    @property
    def f_hz(self) -> np.ndarray:
        """Frequencies of the sines, (F,) [Hz]."""
        return self.line * (self.fs_hz / self.n_base)

    def table(self) -> np.ndarray:
        """The whole sequence, (period_samples,) float64, unit of the command."""
        twiddle = np.empty(self.n_base, complex)
        check(lib.gsid_twiddle_fill(self.n_base, ffi.from_buffer("gsid_cplx[]", twiddle)), "making the table")
        line = np.ascontiguousarray(self.line, np.uint32)
        amplitude = np.ascontiguousarray(self.amplitude, float)
        cfg = ffi.new("gsid_stepped_cfg *")
        cfg.n_period, cfg.n_lines = self.n_base, len(line)
        cfg.n_settle, cfg.n_periods = self.settle_samples, self.n_periods
        cfg.line = ffi.from_buffer("uint32_t[]", line)
        cfg.amplitude = ffi.from_buffer("double[]", amplitude)
        cfg.twiddle = ffi.from_buffer("gsid_cplx[]", twiddle)
        stepped = ffi.new("gsid_stepped *")
        check(lib.gsid_stepped_init(stepped, cfg), "setting up the stepped sine")
        return _samples(lambda u: lib.gsid_stepped_step(stepped, u), self.period_samples)

    @property
    def crest_factor(self) -> float:
        """Largest crest factor of the sampled sines; at most sqrt(2)."""
        return self.peak / (float(np.max(np.abs(self.amplitude))) / math.sqrt(2))

    @property
    def crest_factor_fine(self) -> float:
        """Crest factor of a sine: sqrt(2)."""
        return math.sqrt(2)

    @property
    def p_int_over_p_tot(self) -> float:
        """Share of the power at the lines of interest: 1 for single sines."""
        return 1.0

    def scaled(self, factor: float) -> SteppedSine:
        """The same sequence, times a factor."""
        return replace(self, amplitude=np.asarray(self.amplitude) * factor)

    def _head(self) -> dict[str, object]:
        each = f"{self.settle_samples} samples to settle, {self.n_periods} periods of {self.n_base}"
        return {"stepped_sine": f"{len(self.line)} sines, each {each}", **self.steps.keys()}

    @property
    def steps(self) -> Steps:
        """Layout of the sequence, by which :func:`gsid.frf` evaluates its record."""
        return Steps(self.n_base, self.settle_samples, self.n_periods)

    def __repr__(self) -> str:
        f_hz = self.f_hz
        band = f"{f_hz[0]:g} .. {f_hz[-1]:g} Hz"
        return f"SteppedSine({len(f_hz)} sines {band}, {self.period_samples} samples in all)"
