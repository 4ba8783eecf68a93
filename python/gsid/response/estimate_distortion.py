"""Estimate noise and nonlinear distortion from records, or sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid._lib import check, ffi, ffi32, lib, lib32
from gsid.base.bands import within
from gsid.base.errors import InputError
from gsid.records.record import Record
from gsid.response.distortion import N_HARMONICS, NEIGHBOURS, SAME_LEVEL, Distortion
from gsid.spectrum.realisation import Realisation, common_lines, realisations
from gsid.spectrum.spectra import Spectra


class StreamingDistortion:
    """Streaming measurement that can run beside a controller: the C core, in fixed memory.

    Parameters
    ----------
    fs_hz : float
        Sample rate [Hz].
    period_samples : int
        N.
    line : (F,) int
        Excited lines, ascending, 1 <= line < N/2.
    free_line : (D,) int, optional
        Lines that are not excited, ascending.
    settle_samples : int
        Samples discarded at the start of each realisation.
    input_is_known : bool
        Whether `start` is given the lines of the input. Otherwise the input is measured.
    precision : {"double", "single"}
        Build of the core.

    Raises
    ------
    ValueError
        An unknown precision.
    GsidError
        The core refuses the configuration.
    """

    def __init__(
        self,
        fs_hz: float,
        period_samples: int,
        line: np.ndarray,
        free_line: np.ndarray | None = None,
        *,
        settle_samples: int = 0,
        input_is_known: bool = False,
        precision: str = "double",
    ) -> None:
        if precision not in ("double", "single"):
            raise ValueError(f"precision must be double or single, not {precision!r}")
        is_double = precision == "double"
        self._ffi, self._lib = (ffi, lib) if is_double else (ffi32, lib32)
        self._real, self._cplx = (np.float64, np.complex128) if is_double else (np.float32, np.complex64)
        self.fs_hz, self.period_samples, self.n_spoiled = float(fs_hz), int(period_samples), 0
        self.line = np.asarray(line, int)
        self.free_line = np.asarray([] if free_line is None else free_line, int)
        self.settle_samples, self.input_is_known = int(settle_samples), bool(input_is_known)
        self._power_u = np.zeros(len(self.line))
        self._responses: list[np.ndarray] = []
        self._all = np.concatenate([self.line, self.free_line]).astype(np.uint32)
        self._twiddle = np.empty(period_samples, self._cplx)
        check(
            self._lib.gsid_twiddle_fill(period_samples, self._pointer(self._twiddle)),
            "making the twiddle table",
        )
        cfg = self._ffi.new("gsid_distortion_cfg *")
        cfg.n_period, cfg.n_lines, cfg.n_excited = period_samples, len(self._all), len(self.line)
        cfg.n_settle, cfg.input_is_known = settle_samples, input_is_known
        cfg.line = self._ffi.from_buffer("uint32_t[]", self._all)
        cfg.twiddle = self._pointer(self._twiddle)
        self._memory = np.zeros(self._lib.gsid_distortion_mem_size(cfg) // 16 + 1, complex)
        self._d = self._ffi.new("gsid_distortion *")
        memory = self._ffi.from_buffer(self._memory)
        status = self._lib.gsid_distortion_init(self._d, cfg, memory, len(memory))
        check(status, "setting up the measurement of distortion")

    @property
    def n_realisations(self) -> int:
        """Realisations finished."""
        return self._d.n_realisations

    def start(self, u_known: np.ndarray | None = None) -> None:
        """Begin a realisation.

        Parameters
        ----------
        u_known : (F,) complex, if the input is known
            Lines of the input.

        Raises
        ------
        ValueError
            u_known is missing, given for a measured input, or of another length than line.
        GsidError
            A line is not finite.
        """
        if (u_known is None) == self.input_is_known:
            raise ValueError("u_known is required if the input is known, and not allowed otherwise")
        self._known = None
        if u_known is not None:
            if np.shape(u_known) != self.line.shape:
                raise ValueError(f"u_known has shape {np.shape(u_known)}, line {self.line.shape}")
            self._known = np.concatenate([u_known, np.zeros(len(self.free_line))]).astype(self._cplx)
        pointer = self._ffi.NULL if self._known is None else self._pointer(self._known)
        check(self._lib.gsid_distortion_start(self._d, pointer), "beginning a realisation")

    def step(self, u: np.ndarray, y: np.ndarray) -> None:
        """Take the next samples of the realisation.

        Parameters
        ----------
        u, y : (n,) array_like
            Input and output at the same instants. A sample that is not finite counts as lost.
        """
        for u_n, y_n in zip(np.atleast_1d(u).tolist(), np.atleast_1d(y).tolist(), strict=True):
            status = self._lib.gsid_distortion_step(self._d, u_n, y_n)
            if status == lib.GSID_E_NONFINITE:
                status = self._lib.gsid_distortion_skip(self._d, 1)
            check(status, "taking a sample")

    def add_periods(self, Y: np.ndarray, U: np.ndarray | None = None) -> None:
        """Add whole periods whose lines are already computed.

        Parameters
        ----------
        Y : (P, F + D) complex
            Lines of the output, the excited ones first.
        U : (P, F + D) complex, if the input is measured

        Raises
        ------
        GsidError
            A line is not finite.
        """
        lines = np.ascontiguousarray(Y if U is None else np.stack([Y, U], axis=-1), self._cplx)
        base, stride = self._pointer(lines), lines[0].size
        for p in range(len(Y)):
            check(self._lib.gsid_distortion_add_period(self._d, base + p * stride), "taking a period")

    def finish(self) -> None:
        """End the realisation and add it to the means.

        Raises
        ------
        GsidError
            No realisation was started, it has fewer than 2 good periods, or an excited line has no input.
        """
        g, u, n_spoiled = *self._current(), self._d.frf.n_spoiled
        check(self._lib.gsid_distortion_finish(self._d), "ending a realisation")
        self.n_spoiled += n_spoiled
        self._power_u += np.abs(u) ** 2
        self._responses.append(g)

    def _current(self) -> tuple[np.ndarray, np.ndarray]:
        """Response and mean input lines of the current realisation, (F,) each."""
        g, u = (np.zeros(len(self._all), self._cplx) for _ in range(2))
        out = self._ffi.new("gsid_frf_out *")
        out.g, out.u = self._pointer(g), self._pointer(u)
        self._lib.gsid_frf_result(self._ffi.addressof(self._d.frf), out)
        return g[: len(self.line)].astype(complex), u[: len(self.line)].astype(complex)

    def result(self) -> Distortion:
        """Return the result of the realisations finished so far.

        Returns
        -------
        Distortion

        Raises
        ------
        GsidError
            No realisation is finished.
        """
        n, n_free = len(self.line), len(self.free_line)
        bla = np.empty(n, self._cplx)
        real = {name: np.full(n, np.nan, self._real) for name in ("var_noise", "var_total", "std_nonlinear")}
        real |= {name: np.empty(n_free, self._real) for name in ("level", "level_noise")}
        if self.n_realisations < 2:
            requested = {
                name: array for name, array in real.items() if name not in ("var_total", "std_nonlinear")
            }
        else:
            requested = real
        out = self._ffi.new("gsid_distortion_out *")
        out.bla = self._pointer(bla)
        for name, array in requested.items():
            setattr(out, name, self._ffi.from_buffer("gsid_real[]", array))
        check(self._lib.gsid_distortion_result(self._d, out), "reading the distortion")
        spacing = self.fs_hz / self.period_samples
        return Distortion(
            line=self.line,
            f_hz=self.line * spacing,
            bla=bla.astype(complex),
            responses=np.array(self._responses),
            u=np.sqrt(self._power_u / self.n_realisations),
            free_line=self.free_line,
            free_f_hz=self.free_line * spacing,
            free_order=_orders(self.line, self.free_line),
            n_periods=self._d.n_periods,
            n_realisations=self.n_realisations,
            n_spoiled=self.n_spoiled,
            settle_samples=self.settle_samples,
            period_samples=self.period_samples,
            fs_hz=self.fs_hz,
            **{name: array.astype(float) for name, array in real.items()},
        )

    def _pointer(self, array: np.ndarray):
        return self._ffi.from_buffer("gsid_cplx[]", array)

    def __repr__(self) -> str:
        lines = f"{len(self.line)} lines, {len(self.free_line)} free"
        return f"StreamingDistortion({lines}, {self.n_realisations} realisations)"


def distortion(
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
    band: tuple[float, float] | None = None,
) -> Distortion:
    """Estimate the best linear approximation, noise and nonlinear distortion.

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
        One per realisation, all with the same input level.
    period, settle : int, optional
        Period and settling [samples]. Default: the values of each record, else found from its data. Not used
        for Spectra.
    band : (lo, hi), optional
        Use only lines within this band [Hz].

    Returns
    -------
    Distortion

    Raises
    ------
    InputError
        As `gsid.frf`; or the realisations have different input levels.
    ValueError
        The sequence is empty.
    """
    parts = realisations(records, period=period, settle=settle)
    first = parts[0]
    line, free_line = _lines_of(parts, band)
    _require_one_level(parts, line)
    is_known = all(part.u_repeats for part in parts)
    measured = StreamingDistortion(
        first.fs_hz, first.period_samples, line, free_line, input_is_known=is_known
    )
    lines = np.concatenate([line, free_line])
    for part in parts:
        Y = part.output(lines)
        if is_known:
            measured.start(part.input(line)[0])
            measured.add_periods(Y)
        else:
            measured.start()
            measured.add_periods(Y, np.broadcast_to(part.input(lines), Y.shape))
        measured.finish()
    return replace(
        _fast(measured.result()),
        n_spoiled=sum(part.n_spoiled for part in parts),
        settle_samples=first.settle_samples,
        u_unit=first.u_unit,
        y_unit=first.y_unit,
        name=", ".join(part.name for part in parts if part.name),
    )


def _fast(d: Distortion) -> Distortion:
    """With one realisation, estimate distortion at the excited lines from the neighbouring free odd lines.

    Odd distortion has the same level at a free odd line as at a neighbouring excited line (DIS-3). The
    estimate is the mean power above noise of the nearest NEIGHBOURS free odd lines.
    """
    free = np.flatnonzero(d.odd & (d.free_line > d.line[0]) & (d.free_line < d.line[-1]))
    if d.n_realisations > 1 or not d.orders_apart or len(free) < NEIGHBOURS:
        return d
    excess = d.level[free] ** 2 - d.level_noise[free] ** 2
    distance = np.abs(d.free_line[free] - d.line[:, None])
    nearest = np.argsort(distance, axis=1, kind="stable")[:, :NEIGHBOURS]
    return replace(d, std_nonlinear=np.sqrt(np.maximum(excess[nearest].mean(axis=1), 0)) / d.u)


def from_responses(f_hz: np.ndarray, g: np.ndarray) -> Distortion:
    """Separate noise and distortion of imported responses, such as one element of a matrix of responses.

    Parameters
    ----------
    f_hz : (F,) array_like
        Hz.
    g : (M, P, F) complex array_like
        Response of each period of each realisation, P >= 2 (thesis, eq. 5.12).

    Returns
    -------
    Distortion
        With unit input. Lines are numbered 1 .. F, and there are no free lines.

    Raises
    ------
    ValueError
        The shapes do not match.
    """
    f_hz, g = np.asarray(f_hz, float), np.asarray(g, complex)
    if g.ndim != 3 or f_hz.shape != g.shape[2:] or g.shape[1] < 2:
        raise ValueError(f"g has shape {g.shape} and f_hz {f_hz.shape}, not (M, P, F) with P >= 2 and (F,)")
    n_lines = len(f_hz)
    measured = StreamingDistortion(np.nan, 2 * n_lines + 2, 1 + np.arange(n_lines), input_is_known=True)
    for one in g:
        measured.start(np.ones(n_lines))
        measured.add_periods(one)
        measured.finish()
    return replace(measured.result(), f_hz=f_hz, period_samples=0)


def _lines_of(parts: list[Realisation], band: tuple[float, float] | None) -> tuple[np.ndarray, np.ndarray]:
    """Lines excited in every realisation, and lines excited in none."""
    line, first = common_lines(parts, band), parts[0]
    some = np.logical_or.reduce([part.excited for part in parts])
    excited = np.flatnonzero(some)
    top = N_HARMONICS * excited[-1] if len(excited) == 1 else excited[-1]
    candidate = np.arange(1, min(top, (first.period_samples - 1) // 2) + 1)
    free = ~some[candidate] & within(first.f_hz, band)[candidate]
    return line, candidate[free]


def _orders(line: np.ndarray, free_line: np.ndarray) -> np.ndarray:
    """Order of each free line in units of the excited lines' greatest common divisor; 0 between units."""
    unit = int(np.gcd.reduce(line))
    return np.where(free_line % unit == 0, free_line // unit, 0)


def _require_one_level(parts: list[Realisation], line: np.ndarray) -> None:
    """Refuse different input levels: the best linear approximation depends on the level."""
    level = [float(np.sqrt(np.sum(np.abs(part.input(line).mean(axis=0)) ** 2))) for part in parts]
    for part, one in zip(parts[1:], level[1:], strict=True):
        if abs(one / level[0] - 1) > SAME_LEVEL:
            raise InputError(
                "the records have different input levels",
                part.name,
                f"{one / level[0]:.3g} times that of {parts[0].name or 'the first'}",
                "compare levels with --other-level REC",
            )
