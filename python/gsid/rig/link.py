"""Host side of a serial line to an axis: transports, sessions and errors."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np

from gsid.base.errors import InputError
from gsid.records.record import Record
from gsid.rig.frames import (
    COMMAND,
    HELLO,
    SAMPLE,
    SESSION_MAX,
    STOP,
    VERSION,
    Receiver,
    encode,
    frames,
    hello_frame,
)

BAUD = 921600
QUIET_S = 2.0  # time without a reply after which the pending frames are sent again
SILENT_S = 10.0  # time without a reply after which the run ends with an error
SILENCE_STOP_S = 0.2  # time without a frame after which the axis sets its command to zero
STOP_WAIT_S = 0.5  # longest wait for the reply to STOP


class LinkError(InputError):
    """The line or the axis prevents the measurement from being finished.

    Attributes
    ----------
    record : Record or None
        What was measured until then; None when not one sample was.
    """

    record: Record | None = None


class LimitError(LinkError):
    """The planned command or the motion of the axis exceeds a limit of the run; the command is zero."""


class Stopped(KeyboardInterrupt):
    """A run was stopped by Ctrl-C, another signal or `should_stop`; the command is zero.

    Attributes
    ----------
    record : Record or None
        What was measured until then; None when not one sample was.
    """

    record: Record | None = None


class Transport(Protocol):
    """A bidirectional byte stream. Its methods raise OSError if they fail."""

    def read(self) -> bytes:
        """Return the received bytes without waiting for more; b"" after 50 ms without a byte."""

    def write(self, data: bytes) -> None:
        """Send all of `data`."""

    def close(self) -> None:
        """Close the line."""


class SerialTransport:
    """A serial port, or a pseudo-terminal, at 921600 baud 8N1.

    Parameters
    ----------
    port : str
        Such as /dev/ttyUSB0, COM3, or the path that `gsid simulate` prints.

    Raises
    ------
    LinkError
        The port cannot be opened.
    """

    def __init__(self, port: str) -> None:
        import serial

        try:
            self._serial = serial.Serial(port, BAUD, timeout=0.05, write_timeout=SILENT_S, exclusive=True)
        except (serial.SerialException, ValueError) as error:
            raise LinkError(
                "the port cannot be opened",
                port,
                str(error),
                "--port is the path of the axis; `gsid simulate` prints that of a simulated one",
            ) from error

    def read(self) -> bytes:
        return self._serial.read(1) + self._serial.read(min(self._serial.in_waiting, 65536))

    def write(self, data: bytes) -> None:
        self._serial.write(data)

    def close(self) -> None:
        self._serial.close()


def new_session(last: int) -> int:
    """Draw the id of a session, other than the last one."""
    return (last + 1 + secrets.randbelow(SESSION_MAX - 1)) % SESSION_MAX or SESSION_MAX


class Link:
    """Host side of the line.

    Parameters
    ----------
    transport : Transport
    name : str
        Name of the port, for messages.
    should_stop : callable, optional
        If it returns True, a wait for the axis ends with `Stopped`.
    command_scale : float
        Number on the line for a command of 1; the commands that `send` and `receive` carry are divided by it.
    """

    def __init__(
        self,
        transport: Transport,
        name: str = "",
        should_stop: Callable[[], bool] | None = None,
        command_scale: float = 1.0,
    ) -> None:
        self._transport = transport
        self.command_scale = command_scale
        self._should_stop = should_stop
        self.name = name
        self.receiver = Receiver()
        self.longest_silence_s = 0.0  # longest time without a frame from the host while the axis runs
        self._commanded_s: float | None = None  # when the last commands were sent; None: the axis is at rest

    @classmethod
    def open(
        cls, port: str, should_stop: Callable[[], bool] | None = None, command_scale: float = 1.0
    ) -> Link:
        """Open a serial port or a pseudo-terminal; LinkError when that fails."""
        return cls(SerialTransport(port), port, should_stop, command_scale)

    def __repr__(self) -> str:
        return f"Link({self.name}: {self.receiver!r})"

    def __enter__(self) -> Link:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._transport.close()

    def send(self, block: np.ndarray) -> None:
        """Send frames, (n,) of FRAME; LinkError when the port is gone."""
        now = time.monotonic()
        if self._commanded_s is not None:
            self.longest_silence_s = max(self.longest_silence_s, now - self._commanded_s)
        self._commanded_s = now if (block["kind"] == COMMAND).any() else None
        try:
            self._transport.write(encode(self._scaled(block), self.receiver.session))
        except OSError as error:
            raise self._gone(error) from error

    def receive(self) -> np.ndarray:
        """Return the received frames, (n,) of FRAME; none after 50 ms. LinkError when the port is gone."""
        try:
            got = self.receiver.decode(self._transport.read())
        except OSError as error:
            raise self._gone(error) from error
        if self.command_scale == 1.0:
            return got
        got = got.copy()
        got["a"][got["kind"] == SAMPLE] /= self.command_scale
        return got

    def _scaled(self, block: np.ndarray) -> np.ndarray:
        """Frames as they are on the line."""
        is_command = block["kind"] == COMMAND
        if self.command_scale == 1.0 or not is_command.any():
            return block
        block = block.copy()
        for name in ("a", "b"):
            block[name][is_command] *= self.command_scale
        return block

    def check_stop(self) -> None:
        """Raise `Stopped` if `should_stop` returns true."""
        if self._should_stop is not None and self._should_stop():
            raise Stopped("stopped")

    def _gone(self, error: OSError) -> LinkError:
        return LinkError(
            "the port is gone", self.name, str(error), "check cable and power of the axis, and start again"
        )

    def hello(self) -> tuple[float, int]:
        """Open a session. The axis restarts at tick 0.

        Returns
        -------
        fs_hz : float
            Ticks per second of the axis [Hz].
        n_queue : int
            Number of commands that it can queue.

        Raises
        ------
        LinkError
            No reply within 10 s, another version of the protocol, a rate or queue that is not a positive
            number, or the port is gone.
        """
        self.receiver.session = new_session(self.receiver.session)
        for _ in range(round(SILENT_S / QUIET_S)):
            self.send(hello_frame(self.receiver.session))
            answer = self._wait_for(HELLO, QUIET_S, self._is_answer, self.check_stop)
            if answer is not None:
                return self._read_hello(answer)
        raise LinkError(
            f"the axis does not answer within {SILENT_S:g} s",
            self.name,
            f"{self.receiver!r}",
            "check its power, its baud rate (921600), and that no other program uses the port",
        )

    def _is_answer(self, hello: np.void) -> bool:
        """Whether a HELLO is the reply to the host's; an axis of another version has no sessions."""
        return hello["tick"] == self.receiver.session or hello["flags"] != VERSION

    def _read_hello(self, answer: np.void) -> tuple[float, int]:
        if answer["flags"] != VERSION:
            raise LinkError(
                "the axis uses another version of the protocol",
                self.name,
                f"version {max(1, answer['flags'])}, not {VERSION}",
                "update the link.h and link.c of its firmware, or gsid: docs/reference/protocol.md, Versions",
            )
        fs_hz, n_queue = float(answer["a"]), float(answer["b"])
        if not (0 < fs_hz < np.inf and 1 <= n_queue < np.inf):
            raise LinkError(
                "the axis states no usable rate or queue",
                self.name,
                f"{fs_hz:g} Hz, {n_queue:g} commands",
                "its HELLO carries ticks per second in a and commands it can queue in b: "
                "docs/reference/protocol.md",
            )
        return fs_hz, int(n_queue)

    def stop(self, take: Callable[[np.ndarray], None] = lambda got: None) -> bool:
        """Set the command to zero; True when the axis has confirmed it.

        Parameters
        ----------
        take : callable, optional
            Called with the frames that arrive until then, (n,) of FRAME: pending samples.
        """
        for _ in range(3):
            self.send(frames(STOP))
            if self._wait_for(STOP, STOP_WAIT_S, take=take) is not None:
                return True
        return False

    def _wait_for(
        self,
        kind: int,
        timeout_s: float,
        wanted: Callable[[np.void], bool] = lambda frame: True,
        check: Callable[[], None] = lambda: None,
        take: Callable[[np.ndarray], None] = lambda got: None,
    ) -> np.void | None:
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            check()
            got = self.receive()
            take(got)
            for frame in got[got["kind"] == kind]:
                if wanted(frame):
                    return frame
        return None
