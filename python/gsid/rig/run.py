"""One run: a periodic command sent over the line, and the record of what the axis measured."""

from __future__ import annotations

import contextlib
import datetime
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsid.records.record import Record
from gsid.rig.frames import COMMAND, frames
from gsid.rig.journal import Journal, JournalError, RunDescription
from gsid.rig.link import QUIET_S, SILENT_S, LimitError, Link, LinkError, Stopped
from gsid.rig.samples import Samples, check_length
from gsid.rig.watch import ROUNDING, RunLimits, Watch

if TYPE_CHECKING:
    from gsid.excitation.multisine import Multisine
    from gsid.response.streaming import StreamingFrf
    from gsid.rig.link import Transport

WINDOW = 512  # commands in flight: 170 ms at 3 kHz, longer than an operating system suspends a process
KEEP_ALIVE_S = 0.05  # longest interval between two frames from the host
REST_S = 0.5  # command zero before a run with a limit on travel, to measure the offset of the gyro


@dataclass
class Progress:
    """Progress of a run.

    Attributes
    ----------
    ticks : int
        Measured so far.
    good, lost, requested : int
        Periods: good and lost ones so far, and good ones requested.
    periods : sequence of bool
        Whether each period so far is good.
    u, y : (n,) float64
        Command in force and output of the samples since the last call; not a number where one is lost.
    travel_deg : (n,) float64
        Travel from the start [deg]; not a number if it is not monitored.
    """

    ticks: int
    good: int
    lost: int
    requested: int
    periods: Sequence[bool]
    u: np.ndarray
    y: np.ndarray
    travel_deg: np.ndarray


def run(
    port: str | Transport,
    excitation: Multisine | np.ndarray,
    *,
    periods: int,
    settle: int | None = None,
    fs_hz: float = 3000.0,
    u_unit: str = "command",
    y_unit: str = "deg/s",
    command_scale: float = 1.0,
    meta: dict[str, str] | None = None,
    frf: StreamingFrf | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    journal: str | os.PathLike | None = None,
    should_stop: Callable[[], bool] | None = None,
    limits: RunLimits | None = None,
) -> Record:
    """Drive an axis with a periodic excitation until the requested number of good periods is measured.

    A lost or damaged sample spoils its period only. So does a sample whose echo of the command differs from
    that of other periods. A lost command disturbs the axis, which holds the command before it and reports the
    loss: the `settle` samples that follow are then left out too, as at the start. The command is set to zero
    at the end in any case.

    Parameters
    ----------
    port : str or Transport
        Serial port, or path of a pseudo-terminal.
    excitation : Multisine or (N,) array_like
        One period of the command, unit `u_unit`.
    periods : int
        Good periods to measure, >= 1.
    settle : int, optional
        Samples at the start that are recorded but not counted as periods. Default: two periods.
    fs_hz : float
        Sample rate [Hz]. A Multisine has its own, which takes precedence.
    u_unit, y_unit : str
    command_scale : float
        Number on the line for a command of 1 `u_unit`: 17.9 for volts if 179 is 10 V. Excitation, limits and
        record are in `u_unit`.
    meta : dict of str, optional
        Added to the record's meta, beside the statistics of the line.
    frf : StreamingFrf, optional
        Receives every sample on arrival, so that the response is measured while the axis runs.
    on_progress : callable, optional
        Called with a `Progress` whenever samples have arrived.
    journal : path_like, optional
        New file to which the samples are written on arrival; `gsid.rig.journal.recover` makes a record of it.
        The caller removes it once the record is written; it is removed here if it contains no sample.
    should_stop : callable, optional
        Called many times a second: True ends the run with `Stopped`. For handlers of signals that set a flag.
    limits : RunLimits, optional
        Limits of the planned command, checked before the start, and of the command in force, rate and travel,
        checked on arrival of the samples. The travel is the integral of the rate minus the offset of the
        gyro; the offset is the mean rate during half a second of command zero before the start, while the
        axis must stand still. The rate is assumed to be in deg/s. With a limit on rate or travel, the run
        ends if no sample with a rate arrives for 1 s.

    Returns
    -------
    Record
        u is the applied command, as reported by the axis; hold "zoh"; lost samples are not valid.

    Raises
    ------
    InputError
        The run has more than `gsid.rig.samples.SAMPLES_MOST` samples.
    ValueError
        `periods` < 1, `settle` < 0, `command_scale` is not a finite number other than 0, or the excitation is
        not a row of at least 2 finite numbers.
    LinkError
        The port cannot be opened or disappears. The axis does not respond, runs at another rate, uses another
        version of the protocol, or reports another command than the one sent. Or too many periods are lost: 8
        in a row, or fewer good periods than requested in 4 times that number. `record` contains the samples
        measured until then.
    LimitError
        The planned command or the axis exceeds a limit. `record` contains the samples measured until then.
    JournalError
        The journal cannot be written. `record` contains the samples measured until then.
    Stopped
        Ctrl-C, or `should_stop`. `record` contains the samples measured until then.
    """
    table, fs_hz = _one_period(excitation, fs_hz)
    settle = 2 * len(table) if settle is None else int(settle)
    if periods < 1 or settle < 0:
        raise ValueError(f"periods must be at least 1 and settle at least 0, not {periods} and {settle}")
    if not (np.isfinite(command_scale) and command_scale):
        raise ValueError(f"command_scale must be a finite number other than 0, not {command_scale}")
    check_length(len(table), settle, periods)
    name, transport = (port, None) if isinstance(port, str) else ("", port)
    _check_plan(table, limits, name)
    samples = Samples(table, settle, periods)
    description = RunDescription(
        fs_hz,
        len(table),
        settle,
        len(samples.u),
        u_unit,
        y_unit,
        name,
        (meta or {})
        | ({"command_scale": repr(float(command_scale))} if command_scale != 1 else {})
        | {"date": _now(), "port": name},
    )
    kept = Journal(journal, description) if journal is not None else None
    consumers = _Consumers(name, kept, frf, on_progress)

    def connect() -> Link:
        if transport is None:
            return Link.open(name, should_stop, command_scale)
        return Link(transport, "", should_stop, command_scale)

    failure, statistics = _drive(connect, samples, table, fs_hz, limits, consumers)
    failure = _close(kept, samples) or failure
    n = samples.end
    record = description.record(samples.u[:n], samples.y[:n], samples.valid[:n], statistics) if n else None
    if failure is not None:
        failure.record = record  # type: ignore[attr-defined]
        raise failure
    assert record is not None
    return record


def _check_plan(table: np.ndarray, limits: RunLimits | None, name: str) -> None:
    """Raise LimitError if the planned command exceeds its limit."""
    peak = np.abs(table).max()
    if limits and limits.command is not None and peak > limits.command * ROUNDING:
        raise LimitError(
            "the planned command exceeds its limit",
            name,
            f"peak {peak:.4g}, limit {limits.command:g}",
            "lower --amplitude, or `gsid design --limit-command` makes a command that stays within it",
        )


def _drive(
    connect: Callable[[], Link],
    samples: Samples,
    table: np.ndarray,
    fs_hz: float,
    limits: RunLimits | None,
    consumers: _Consumers,
) -> tuple[BaseException | None, dict[str, str]]:
    """Fill `samples`, then set the command to zero; returns the failure, if any, and the statistics."""
    n_ahead = int(SILENT_S * fs_hz)
    statistics: dict[str, str] = {}
    try:
        with connect() as link:
            try:
                consumers.watch = _watch(link, limits, fs_hz) if limits else None
                _exchange(link, samples, table, _start(link, fs_hz), n_ahead, consumers.take)
            except BaseException:
                statistics = _statistics(samples, link, _stop(link, samples, n_ahead))
                raise
            statistics = _statistics(samples, link, _stop(link))
    except KeyboardInterrupt as error:
        return error if isinstance(error, Stopped) else Stopped("stopped"), statistics
    except BaseException as error:
        return error, statistics
    return None, statistics


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


def _close(journal: Journal | None, samples: Samples) -> BaseException | None:
    """Finish the journal. Returns the reason if it is incomplete."""
    if journal is None:
        return None
    try:
        try:
            _keep(journal, samples)
        finally:
            journal.close()
    except JournalError as error:
        return error
    finally:
        if not samples.end:
            journal.path.unlink(missing_ok=True)
    return None


def _keep(journal: Journal, samples: Samples) -> None:
    """Append the samples that are not in the journal yet."""
    new = slice(samples.kept, samples.end)
    if new.start < new.stop:
        journal.append(new.start, samples.u[new], samples.y[new], samples.valid[new])
        samples.kept = samples.end


@dataclass
class _Consumers:
    """Consumers of the samples as they arrive."""

    name: str
    journal: Journal | None
    frf: StreamingFrf | None
    on_progress: Callable[[Progress], None] | None
    watch: Watch | None = None
    n_watched: int = 0
    n_fed: int = 0
    n_shown: int = 0

    def take(self, samples: Samples) -> None:
        """Pass on new samples; raises LimitError if a limit is exceeded."""
        if self.journal is not None:
            _keep(self.journal, samples)
        if self.watch is not None:
            self._check_limits(self.watch, samples)
        if self.frf is not None and samples.echo.is_judged:
            new = slice(self.n_fed, samples.end)
            self.frf.step(samples.u[new], samples.y[new], samples.valid[new])
            self.n_fed = samples.end
        if self.on_progress:
            self.on_progress(self._progress(samples))

    def _progress(self, samples: Samples) -> Progress:
        new = slice(self.n_shown, samples.end)
        self.n_shown = samples.end
        u, y = (np.where(samples.received[new], values[new], np.nan) for values in (samples.u, samples.y))
        watched = self.watch is not None and self.watch.limits.travel_deg is not None
        travel_deg = self.watch.new_angle_deg if watched and self.watch else np.full(len(u), np.nan)
        counts = samples.n_good, samples.n_lost, samples.requested
        return Progress(samples.end, *counts, samples.good, u, y, travel_deg)

    def _check_limits(self, watch: Watch, samples: Samples) -> None:
        first, new = self.n_watched, slice(self.n_watched, samples.end)
        found = watch.check(samples.u[new], samples.y[new], samples.received[new])
        self.n_watched = samples.end
        if found is not None:
            raise LimitError(
                "the axis exceeds a limit: stopped",
                self.name,
                f"{found[1]}, at sample {first + found[0]}",
                "lower the amplitude, or raise the limit if the rig permits it",
            )


def _watch(link: Link, limits: RunLimits, fs_hz: float) -> Watch:
    """Limits and, for the travel, the rate that the gyro measures at rest."""
    if limits.travel_deg is None:
        return Watch(limits, fs_hz)
    n_queue = _start(link, fs_hz)
    table = np.zeros(max(2, round(REST_S * fs_hz)))
    rest = Samples(table, 0, 1)
    _exchange(link, rest, table, n_queue, int(SILENT_S * fs_hz), lambda samples: None)
    return Watch(limits, fs_hz, float(rest.y[rest.valid].mean()))


def _one_period(excitation: Multisine | np.ndarray, fs_hz: float) -> tuple[np.ndarray, float]:
    if hasattr(excitation, "table"):
        excitation, fs_hz = excitation.table(), excitation.fs_hz
    table = np.asarray(excitation, dtype=np.float64)
    if table.ndim != 1 or len(table) < 2 or not np.isfinite(table).all():
        raise ValueError(f"the excitation is not a row of at least 2 finite numbers: shape {table.shape}")
    return table, float(fs_hz)


def _start(link: Link, fs_hz: float) -> int:
    axis_hz, n_queue = link.hello()
    if not abs(axis_hz - fs_hz) <= 1e-6 * fs_hz:  # the line carries single precision
        raise LinkError(
            "the axis runs at another rate",
            link.name,
            f"{axis_hz:g} Hz, not {fs_hz:g} Hz",
            f"excite with --fs {axis_hz:g}",
        )
    return n_queue


def _stop(link: Link, samples: Samples | None = None, n_ahead: int = 0) -> bool:
    """Set the command to zero and receive pending samples; True if the axis has confirmed it."""

    def take(got: np.ndarray) -> None:
        if samples is not None and samples.end:  # otherwise they belong to the rest before the run
            with contextlib.suppress(LinkError):  # the run is ending anyway
                samples.take(got, samples.end + n_ahead)

    try:
        return link.stop(take)
    except LinkError:
        return False


def _exchange(
    link: Link,
    samples: Samples,
    table: np.ndarray,
    n_queue: int,
    n_ahead: int,
    take: Callable[[Samples], None],
) -> None:
    """Keep a window of commands in flight and `take` the samples, until there are enough good periods.

    While the host is stalled, a paced axis may run on beyond the last command sent: samples up to `n_ahead`
    ticks beyond it are accepted.
    """
    window = max(1, min(WINDOW, n_queue // 2))
    sent, received_at = 0, time.monotonic()
    sent_at, resend_at = received_at, received_at + QUIET_S
    while samples.n_good < samples.requested:
        link.check_stop()
        if samples.hopeless():
            raise _too_many_lost(link, samples)
        room = samples.end + window - sent
        now = time.monotonic()
        if room > window // 4 or (room > 0 and now > sent_at + KEEP_ALIVE_S):  # not frame by frame
            sent = _send_commands(link, table, max(sent, samples.end), samples.end + window)
            sent_at = now
        if samples.take(link.receive(), sent + n_ahead):
            received_at = time.monotonic()
            resend_at = received_at + QUIET_S
            take(samples)
        elif time.monotonic() > received_at + SILENT_S:
            raise LinkError(
                f"no sample from the axis for {SILENT_S:g} s",
                link.name,
                f"after {samples.end} samples",
                "check the line and the axis, and start again",
            )
        elif time.monotonic() > resend_at:
            # Commands or samples may be lost; the axis then waits for commands that were never sent.
            sent = _send_commands(link, table, samples.end, min(sent + window, samples.end + n_queue))
            sent_at = time.monotonic()
            resend_at += QUIET_S


def _send_commands(link: Link, table: np.ndarray, first: int, end: int) -> int:
    tick = np.arange(first, end)
    link.send(frames(COMMAND, tick, table[tick % len(table)], table[(tick + 1) % len(table)]))
    return end


def _too_many_lost(link: Link, samples: Samples) -> LinkError:
    return LinkError(
        "too many periods are lost on the line",
        link.name,
        f"{samples.n_good} good of {len(samples.good)}, {samples.requested} requested; "
        f"{link.receiver.n_damaged} damaged frames, {samples.n_held} commands lost, "
        f"{samples.echo.n_wrong} wrong echoes",
        "check the line (cable, grounding, baud rate) or shorten the period: one lost sample spoils a period",
    )


def _statistics(samples: Samples, link: Link, confirmed: bool) -> dict[str, str]:
    """Statistics of the line."""
    values = {
        "lost_commands": samples.n_held,
        "wrong_echoes": samples.echo.n_wrong,
        "longest_host_silence_s": f"{link.longest_silence_s:.3f}",
        "link_frames": link.receiver.n_frames,
        "link_damaged": link.receiver.n_damaged,
        "link_garbage_bytes": link.receiver.n_garbage,
        "command_zero_confirmed": "yes" if confirmed else "no",
    }
    return {key: str(value) for key, value in values.items()}
