"""Streaming measurement of a frequency response in the C core, as it runs beside a controller."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import numpy as np

from gsid._lib import check, ffi, ffi32, lib, lib32
from gsid.base.errors import GsidError, InputError
from gsid.base.files import write_atomically
from gsid.response.frf import Frf

COUNTS = ("n_periods", "n_spoiled", "n_refused")  # of the C struct that a file of a part keeps
FEW_LINES = 10
"""Largest number of lines for which `StreamingFrf` chooses "direct": it is then as fast as a transform."""


class StreamingFrf:
    """Streaming measurement that can run beside a controller: the C core, sample by sample, in fixed memory.

    Parameters
    ----------
    fs_hz : float
        Sample rate [Hz].
    period_samples : int
        N.
    line : (F,) int
        1 <= line < N/2.
    settle_samples : int
        Samples discarded at the start.
    u_known : (F,) complex, optional
        Lines of the input if it is known exactly. Default: the input is measured.
    precision : {"double", "single"}
        Build of the core.
    engine : {"auto", "direct", "spread"}
        Method that computes the lines of a period. "direct" updates a sum at every sample. "spread" computes
        a transform spread over the samples of the next period (N even, N/2 without prime factors above 7).
        The results agree within rounding. "auto" chooses the transform if it is possible and there are more
        than `FEW_LINES` lines.

    Raises
    ------
    ValueError
        An unknown precision or engine, or u_known of another length than line.
    GsidError
        The core refuses the configuration.
    """

    def __init__(
        self,
        fs_hz: float,
        period_samples: int,
        line: np.ndarray,
        *,
        settle_samples: int = 0,
        u_known: np.ndarray | None = None,
        precision: str = "double",
        engine: str = "auto",
    ) -> None:
        if precision not in ("double", "single"):
            raise ValueError(f"precision must be double or single, not {precision!r}")
        if engine not in ("auto", "direct", "spread"):
            raise ValueError(f"engine must be auto, direct or spread, not {engine!r}")
        is_double = precision == "double"
        self._ffi, self._lib = (ffi, lib) if is_double else (ffi32, lib32)
        self._real, self._cplx = (np.float64, np.complex128) if is_double else (np.float32, np.complex64)
        self.fs_hz, self.n_period = float(fs_hz), period_samples
        self.line = np.ascontiguousarray(line, np.uint32)
        self._known = None if u_known is None else np.ascontiguousarray(u_known, self._cplx)
        if self._known is not None and self._known.shape != self.line.shape:
            raise ValueError(f"u_known has shape {self._known.shape}, line {self.line.shape}")
        self._twiddle = np.empty(period_samples, self._cplx)
        status = self._lib.gsid_twiddle_fill(period_samples, self._pointer(self._twiddle))
        check(status, "making the twiddle table")
        cfg = self._ffi.new("gsid_frf_cfg *")
        cfg.n_period, cfg.n_lines, cfg.n_settle = period_samples, len(self.line), settle_samples
        cfg.line = self._ffi.from_buffer("uint32_t[]", self.line)
        cfg.twiddle = self._pointer(self._twiddle)
        cfg.u_known = self._ffi.NULL if self._known is None else self._pointer(self._known)
        spread_size = self._lib.gsid_frf_spread_mem_size(cfg)  # 0: not possible
        if engine == "auto":
            engine = "spread" if spread_size > 0 and len(self.line) > FEW_LINES else "direct"
        self.engine = engine
        size = spread_size if engine == "spread" else self._lib.gsid_frf_mem_size(cfg)
        self._memory = np.zeros(size // 16 + 1, complex)
        self._frf = self._ffi.new("gsid_frf *")
        memory = self._ffi.from_buffer(self._memory)
        init = self._lib.gsid_frf_init_spread if engine == "spread" else self._lib.gsid_frf_init
        check(init(self._frf, cfg, memory, len(memory)), "setting up the measurement")

    @property
    def n_periods(self) -> int:
        """Good periods in the mean so far."""
        return self._frf.n_periods

    @property
    def n_spoiled(self) -> int:
        """Periods omitted because they have lost samples."""
        return self._frf.n_spoiled

    def step(self, u: np.ndarray, y: np.ndarray, valid: np.ndarray | None = None) -> int:
        """Take the next samples.

        Parameters
        ----------
        u, y : (n,) array_like
            Input and output at the same instants, finite where valid. u is not used if the input is known.
        valid : (n,) bool, optional
            False: the sample was lost, and its period is omitted.

        Returns
        -------
        int
            Good periods in the mean so far.

        Raises
        ------
        ValueError
            The lengths differ.
        GsidError
            A sample is not finite. No sample of the block was used.
        """
        u = np.atleast_1d(np.ascontiguousarray(u, np.float64))
        y = np.atleast_1d(np.ascontiguousarray(y, np.float64))
        good = None if valid is None else np.atleast_1d(np.ascontiguousarray(valid, bool)).view(np.uint8)
        if u.shape != y.shape or (good is not None and good.shape != u.shape):
            shapes = [x.shape for x in (u, y, good) if x is not None]
            raise ValueError(f"u, y and valid must have the same length, not {shapes}")
        if self._lib is lib:
            flags = ffi.NULL if good is None else ffi.from_buffer("uint8_t[]", good)
            block = ffi.from_buffer("double[]", u), ffi.from_buffer("double[]", y)
            check(lib.gsid_batch_frf_step(self._frf, len(u), *block, flags), "taking a block of samples")
        else:
            self._step_single(u, y, good)
        # at once, because there is no control tick to keep short
        check(self._lib.gsid_frf_finish(self._frf), "adding the last period")
        return self.n_periods

    def _step_single(self, u: np.ndarray, y: np.ndarray, good: np.ndarray | None) -> None:
        counts = np.ones(len(u), bool) if good is None else good.astype(bool)
        needed = [y] if self._known is not None else [u, y]
        with np.errstate(over="ignore"):
            is_finite = all(np.isfinite(x.astype(np.float32)[counts]).all() for x in needed)
        if not is_finite:
            check(lib.GSID_E_NONFINITE, "taking a block of samples")
        for u_n, y_n, is_good in zip(u.tolist(), y.tolist(), counts.tolist(), strict=True):
            if is_good:
                lib32.gsid_frf_step(self._frf, u_n, y_n)
            else:
                lib32.gsid_frf_skip(self._frf, 1)

    def merge(self, other: StreamingFrf) -> int:
        """Add the good periods of another measurement, as if measured one after the other (FRF-4).

        Parameters
        ----------
        other : StreamingFrf
            With the same lines, period, precision and kind of input; any engine. It is not changed.

        Returns
        -------
        int
            Good periods in the mean now.

        Raises
        ------
        ValueError
            The precisions differ.
        GsidError
            The lines or the kinds of input differ.
        """
        if other._lib is not self._lib:
            raise ValueError("the measurements differ in precision")
        check(self._lib.gsid_frf_merge(self._frf, other._frf), "adding another measurement")
        return self.n_periods

    def save(self, path: str | os.PathLike) -> None:
        """Write the means and sums of the good periods, to be merged elsewhere, without a period under way.

        Parts that are merged in the same order give the same bits, wherever they were measured: nothing is
        rounded in the file, and `merge` is the same sequence of additions.

        Parameters
        ----------
        path : path_like
            .npz.
        """
        counts = {name: getattr(self._frf, name) for name in COUNTS}
        known = {} if self._known is None else {"u_known": self._known}
        cfg = {"fs_hz": self.fs_hz, "n_period": self.n_period, "settle_samples": self._frf.cfg.n_settle}
        values = {**self._sums(), **counts, **cfg, **known, "line": self.line}

        def write(part: Path) -> None:
            with part.open("wb") as file:
                np.savez(file, **values)

        write_atomically(path, write)

    @classmethod
    def load(cls, path: str | os.PathLike) -> StreamingFrf:
        """Read what `save` wrote, as a measurement that can be merged and continued with whole periods.

        Parameters
        ----------
        path : path_like

        Returns
        -------
        StreamingFrf

        Raises
        ------
        InputError
            The file is not one of `save`.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                kept = dict(file)
            part = cls(
                float(kept["fs_hz"]),
                int(kept["n_period"]),
                kept["line"],
                settle_samples=int(kept["settle_samples"]),
                u_known=kept.get("u_known"),
                precision="double" if kept["mean"].dtype == np.complex128 else "single",
                engine="direct",
            )
            part._put(kept)
        except (KeyError, ValueError, TypeError, GsidError, zipfile.BadZipFile) as error:
            hint = "write it with StreamingFrf.save"
            raise InputError("the file is no part of a measurement", str(path), str(error), hint) from None
        return part

    def _sums(self) -> dict[str, np.ndarray]:
        """Copies of the means and sums, as they are in memory."""
        return {name: array.copy() for name, array in self._views().items()}

    def _views(self) -> dict[str, np.ndarray]:
        n, channels = len(self.line), 1 if self._known is not None else 2
        shapes = {"mean": (self._cplx, n * channels), "m2": (self._real, n * channels)}
        if channels == 2:
            shapes["cross"] = (self._cplx, n)
        return {
            name: np.frombuffer(
                self._ffi.buffer(getattr(self._frf, name), size * np.dtype(kind).itemsize), dtype=kind
            )
            for name, (kind, size) in shapes.items()
        }

    def _put(self, kept: dict[str, np.ndarray]) -> None:
        for name, view in self._views().items():
            if kept[name].dtype != view.dtype or kept[name].shape != view.shape:
                raise ValueError(f"{name} is {kept[name].dtype} {kept[name].shape}")
            if not np.isfinite(kept[name]).all():
                raise ValueError(f"{name} has a value that is not finite")
            view[:] = kept[name]
        for name in COUNTS:
            setattr(self._frf, name, int(kept[name]))

    def result(self) -> Frf:
        """Return the result so far.

        Returns
        -------
        Frf

        Raises
        ------
        GsidError
            Fewer than 2 good periods.
        """
        n = len(self.line)
        complex_fields = {name: np.empty(n, self._cplx) for name in ("g", "y", "u", "cov_yu")}
        real_fields = {name: np.empty(n, self._real) for name in ("var_g", "var_y", "var_u")}
        out = self._ffi.new("gsid_frf_out *")
        for name, array in complex_fields.items():
            setattr(out, name, self._pointer(array))
        for name, array in real_fields.items():
            setattr(out, name, self._ffi.from_buffer("gsid_real[]", array))
        check(self._lib.gsid_frf_result(self._frf, out), "reading the frequency response")
        cfg = self._frf.cfg
        return Frf(
            line=self.line.astype(int),
            f_hz=self.line * (self.fs_hz / cfg.n_period),
            n_periods=self.n_periods,
            n_realisations=1,
            n_spoiled=self.n_spoiled,
            settle_samples=cfg.n_settle,
            period_samples=cfg.n_period,
            fs_hz=self.fs_hz,
            **{name: array.astype(np.complex128) for name, array in complex_fields.items()},
            **{name: array.astype(np.float64) for name, array in real_fields.items()},
        )

    def _pointer(self, array: np.ndarray):
        return self._ffi.from_buffer("gsid_cplx[]", array)

    def __repr__(self) -> str:
        periods = f"{self.n_periods} good periods, {self.n_spoiled} spoiled"
        return f"StreamingFrf({len(self.line)} lines, {periods}, {self.engine} engine)"
