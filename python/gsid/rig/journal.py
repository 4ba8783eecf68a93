"""Journal of a run: samples written to disk as they arrive, so that an interrupted run leaves a record."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import queue
import struct
import threading
import time
import zlib
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from gsid.base.errors import InputError
from gsid.records.record import Record

MAGIC = b"GSIDJRN1"  # then the length and the CRC-32 of the description, then the description as JSON
BLOCK = (
    b"SMPL"  # then the first tick, the number of samples and the CRC-32 of all but itself, then the samples
)
SIZES = struct.Struct("<II")
HEAD = struct.Struct("<4sIII")
SAMPLE = np.dtype([("u", "<f4"), ("y", "<f4"), ("valid", "u1")])
DESCRIPTION_MAX = 1 << 20  # bytes
BLOCK_MAX = 1024  # samples
SAMPLES_MAX = 1 << 31
# Most samples that may be missing: a number for each byte of the file, plus a constant.
LOST_MAX = (64, 1 << 22)
SYNC_S = 1.0  # between two syncs
CLOSE_S = 10.0  # longest wait for a disk that does not respond


@dataclass
class RunDescription:
    """Description of a record without its samples.

    Attributes
    ----------
    fs_hz : float
        Sample rate [Hz].
    period_samples, settle_samples : int
    capacity : int
        Largest number of samples of the run.
    u_unit, y_unit : str
    name : str
        Name of the port.
    meta : dict of str
    """

    fs_hz: float
    period_samples: int
    settle_samples: int
    capacity: int
    u_unit: str
    y_unit: str
    name: str
    meta: dict[str, str] = field(default_factory=dict)

    def record(self, u: np.ndarray, y: np.ndarray, valid: np.ndarray, meta: dict[str, str]) -> Record:
        """Make a record of the whole periods, or of all samples if there is no whole period.

        Parameters
        ----------
        u, y : (n,) float64
        valid : (n,) bool
        meta : dict of str
            Added to that of the description.

        Returns
        -------
        Record
        """
        n_periods = max(0, len(u) - self.settle_samples) // self.period_samples
        n = self.settle_samples + n_periods * self.period_samples if n_periods else len(u)
        periods = valid[self.settle_samples : n] if n_periods else valid[:0]
        n_good = int(periods.reshape(n_periods, self.period_samples).all(axis=1).sum())
        counts = {
            "good_periods": n_good,
            "spoiled_periods": n_periods - n_good,
            "lost_samples": int(np.count_nonzero(~valid[:n])),
        }
        return Record(
            u=u[:n].copy(),
            y=y[:n].copy(),
            valid=valid[:n].copy(),
            fs_hz=self.fs_hz,
            period_samples=self.period_samples,
            settle_samples=self.settle_samples,
            u_unit=self.u_unit,
            y_unit=self.y_unit,
            hold="zoh",
            name=self.name,
            meta=self.meta | {key: str(value) for key, value in counts.items()} | meta,
        )


class JournalError(InputError):
    """The journal cannot be written."""


class Journal:
    """Append samples to a new file in a separate thread, so that a slow disk never delays the line.

    A written sample survives the end of this process. It survives a power failure once it is synced, which
    happens once a second.

    Parameters
    ----------
    path : path_like
        New file.
    run : RunDescription

    Raises
    ------
    InputError
        A journal of that name exists.
    JournalError
        The file cannot be created.
    """

    def __init__(self, path: str | os.PathLike, run: RunDescription) -> None:
        self.path = Path(path)
        self._error: OSError | None = None
        self._blocks: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._sync_due = threading.Event()
        self._ended = False
        description = _description(run)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        try:
            self._file = os.open(self.path, flags, 0o666)
        except FileExistsError:
            raise InputError(
                "a journal of an earlier run exists",
                str(self.path),
                None,
                f"`gsid run --recover {self.path} -o REC` makes a record of it; then remove it",
            ) from None
        except OSError as error:
            raise self._failed(error) from error
        try:
            self._write(description)
            os.fsync(self._file)
            _sync_folder(self.path.parent)
        except OSError as error:
            os.close(self._file)
            self.path.unlink(missing_ok=True)
            raise self._failed(error) from error
        self._threads = [
            threading.Thread(target=work, daemon=True) for work in (self._write_all, self._sync_all)
        ]
        for thread in self._threads:
            thread.start()

    def append(self, first: int, u: np.ndarray, y: np.ndarray, valid: np.ndarray) -> None:
        """Append samples from tick `first` on. They replace samples of the same ticks.

        Parameters
        ----------
        first : int
        u, y : (n,) array_like
        valid : (n,) array_like of bool

        Raises
        ------
        JournalError
            An earlier write has failed.
        """
        if self._error is not None:
            raise self._failed(self._error)
        samples = np.zeros(len(u), SAMPLE)
        samples["u"], samples["y"], samples["valid"] = u, y, valid
        for at in range(0, len(samples), BLOCK_MAX):
            block = samples[at : at + BLOCK_MAX]
            self._blocks.put(_block(first + at, block.tobytes(), len(block)))

    def close(self) -> None:
        """Write all pending samples and sync the file; raises JournalError if this fails."""
        self._blocks.put(None)
        end = time.monotonic() + CLOSE_S
        for thread in self._threads:
            thread.join(max(0.0, end - time.monotonic()))
            if thread.is_alive():
                raise self._failed(
                    OSError(errno.ETIMEDOUT, f"the disk does not respond within {CLOSE_S:g} s")
                )
        os.close(self._file)
        if self._error is not None:
            raise self._failed(self._error)

    def _write(self, data: bytes) -> None:
        while data:
            data = data[os.write(self._file, data) :]

    def _write_all(self) -> None:
        synced_s = time.monotonic()
        while (block := self._blocks.get()) is not None and self._error is None:
            try:
                self._write(block)
            except OSError as error:
                self._error = error
            if time.monotonic() > synced_s + SYNC_S:
                synced_s = time.monotonic()
                self._sync_due.set()
        self._ended = True
        self._sync_due.set()

    def _sync_all(self) -> None:
        """Body of the thread: write pending samples until the journal is closed or the disk fails."""
        ended = False
        while not ended:
            self._sync_due.wait()
            self._sync_due.clear()
            ended = self._ended
            try:
                os.fsync(self._file)
            except OSError as error:
                self._error = self._error or error

    def _failed(self, error: OSError) -> JournalError:
        return JournalError(
            "the journal cannot be written",
            str(self.path),
            error.strerror or str(error),
            "without it a crash would lose the samples: free some space, or name another folder with -o",
        )


def _description(run: RunDescription) -> bytes:
    text = json.dumps(asdict(run)).encode()
    return MAGIC + SIZES.pack(len(text), zlib.crc32(text)) + text


def _block(first: int, samples: bytes, n: int) -> bytes:
    check = zlib.crc32(samples, zlib.crc32(SIZES.pack(first, n)))
    return HEAD.pack(BLOCK, first, n, check) + samples


def _sync_folder(folder: Path) -> None:
    with contextlib.suppress(OSError):  # not supported by some systems
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@dataclass
class Recovered:
    """Result of reading a journal.

    Attributes
    ----------
    record : Record
    n_torn : int
        Bytes of an incomplete block at the end: the run was interrupted while it wrote them.
    n_damaged : int
        Bytes of damaged blocks before the last good block.
    """

    record: Record
    n_torn: int
    n_damaged: int


def recover(path: str | os.PathLike) -> Recovered:
    """Make a record from a journal.

    Parameters
    ----------
    path : path_like

    Returns
    -------
    Recovered
        Samples of damaged blocks are not valid.

    Raises
    ------
    InputError
        The file is not a journal, its description is damaged, or it contains no sample.
    """
    name = str(path)
    data = Path(path).read_bytes()
    run, at = _read_description(name, data)
    blocks: list[tuple[int, np.ndarray]] = []
    n_bad, n_damaged = 0, 0
    limit = min(run.capacity, LOST_MAX[0] * len(data) + LOST_MAX[1])
    while at < len(data):
        n_bytes = _read_block(data, at, limit, blocks)
        if n_bytes:
            n_damaged, n_bad = n_damaged + n_bad, 0
        else:
            following = data.find(BLOCK, at + 1)
            n_bytes = (following if following >= 0 else len(data)) - at
            n_bad += n_bytes
        at += n_bytes
    if not blocks:
        raise InputError(
            "the journal contains no sample", name, None, "the run ended before the first: run it again"
        )
    end = max(first + len(samples) for first, samples in blocks)
    u, y, valid = np.zeros(end), np.zeros(end), np.zeros(end, bool)
    for first, samples in blocks:
        place = slice(first, first + len(samples))
        u[place], y[place] = samples["u"], samples["y"]
        valid[place] = (samples["valid"] == 1) & np.isfinite(samples["u"]) & np.isfinite(samples["y"])
    u[~valid], y[~valid] = np.nan_to_num(u[~valid]), np.nan_to_num(y[~valid])
    record = run.record(u, y, valid, {"recovered_from": Path(path).name})
    return Recovered(record, n_bad, n_damaged)


def _read_block(data: bytes, at: int, limit: int, blocks: list[tuple[int, np.ndarray]]) -> int:
    """Append the block that starts at `at`. Returns its length in bytes; 0 if no valid block starts there."""
    if at + HEAD.size > len(data):
        return 0
    mark, first, n, check = HEAD.unpack_from(data, at)
    end = at + HEAD.size + n * SAMPLE.itemsize
    if mark != BLOCK or not 1 <= n <= BLOCK_MAX or end > len(data) or first + n > limit:
        return 0
    samples = data[at + HEAD.size : end]
    if check != zlib.crc32(samples, zlib.crc32(SIZES.pack(first, n))):
        return 0
    blocks.append((first, np.frombuffer(samples, SAMPLE)))
    return end - at


def _read_description(name: str, data: bytes) -> tuple[RunDescription, int]:
    """The description, and the offset of the first block."""
    if not data.startswith(MAGIC):
        raise InputError("not a journal of gsid run", name, None, "name REC.journal of an interrupted run")
    damaged = InputError(
        "the description of the journal is damaged",
        name,
        None,
        "without it rate and period are unknown; `gsid run` writes it before the axis moves",
    )
    at = len(MAGIC) + SIZES.size
    if len(data) < at:
        raise damaged
    n, check = SIZES.unpack_from(data, len(MAGIC))
    text = data[at : at + n]
    if n > DESCRIPTION_MAX or len(text) < n or zlib.crc32(text) != check:
        raise damaged
    try:
        run = RunDescription(**json.loads(text))
        _check_description(run)
    except (ValueError, TypeError, AttributeError, RecursionError):
        raise damaged from None
    return run, at + n


def _check_description(run: RunDescription) -> None:
    """Raise ValueError or TypeError for values that no run can have."""
    counts = (run.period_samples, run.settle_samples, run.capacity)
    texts = (run.u_unit, run.y_unit, run.name, *run.meta, *run.meta.values())
    if not (
        all(isinstance(count, int) for count in counts)
        and all(isinstance(text, str) for text in texts)
        and 0 < float(run.fs_hz) < np.inf
        and run.period_samples >= 1
        and 0 <= run.settle_samples <= run.capacity <= SAMPLES_MAX
    ):
        raise ValueError("values that no run has")
