"""Frames of the serial line as arrays and as bytes; docs/reference/protocol.md defines them."""

from __future__ import annotations

import numpy as np

from gsid._lib import ffi, lib

COMMAND = lib.GSID_FRAME_COMMAND
SAMPLE = lib.GSID_FRAME_SAMPLE
HELLO = lib.GSID_FRAME_HELLO
STOP = lib.GSID_FRAME_STOP
RESULT = lib.GSID_FRAME_RESULT
COMMAND_LOST = lib.GSID_FLAG_COMMAND_LOST
LOST_COUNT = lib.GSID_FLAG_LOST_COUNT
VERSION = lib.GSID_LINK_VERSION
SESSION_MAX = lib.GSID_LINK_SESSION_MAX

#: numpy's view of the C struct gsid_frame.
FRAME = np.dtype([("kind", "u1"), ("flags", "u1"), ("tick", "u4"), ("a", "f4"), ("b", "f4")], align=True)
assert FRAME.itemsize == ffi.sizeof("gsid_frame")


def frames(kind: int, tick=0, a=0.0, b=0.0, flags=0) -> np.ndarray:
    """Make frames.

    Parameters
    ----------
    kind : int
        COMMAND, SAMPLE, HELLO, STOP or RESULT.
    tick : (n,) array_like of int, or int
        Tick to which the frame refers, modulo 2^32; for HELLO the id of the session.
    a, b : (n,) array_like, or float
        Values, unit of the command or of the output.
    flags : (n,) array_like of int, or int

    Returns
    -------
    (n,) ndarray of FRAME
    """
    made = np.zeros(np.broadcast(np.atleast_1d(tick), a, b, flags).shape, FRAME)
    made["kind"], made["tick"], made["a"], made["b"], made["flags"] = kind, tick, a, b, flags
    return made


def hello_frame(session: int, a: float = 0.0, b: float = 0.0) -> np.ndarray:
    """Make a HELLO of this version of the protocol.

    Parameters
    ----------
    session : int
        1 .. SESSION_MAX.
    a, b : float
        In the reply of an axis: ticks per second [Hz], and number of commands it can queue.

    Returns
    -------
    (1,) ndarray of FRAME
    """
    return frames(HELLO, session, a, b, VERSION)


def encode(block: np.ndarray, session: int) -> bytes:
    """Write frames as bytes.

    Parameters
    ----------
    block : (n,) ndarray of FRAME
    session : int
        Id of the session, the start value of the checksum.

    Returns
    -------
    bytes
        The frames one after the other.

    Raises
    ------
    ValueError
        A frame has an unknown kind.
    """
    out = bytearray(len(block) * lib.GSID_LINK_FRAME_MAX)
    source, target, size = ffi.from_buffer("gsid_frame[]", block), ffi.from_buffer("uint8_t[]", out), 0
    for i in range(len(block)):
        written = lib.gsid_link_encode(source + i, session, target + size)
        if written == 0:
            raise ValueError(f"frame {i} is of unknown kind {block['kind'][i]}")
        size += written
    return bytes(out[:size])


class Receiver:
    """Find the frames in a stream of bytes: every HELLO, and the other frames of one session.

    Parameters
    ----------
    session : int
        Id of the session; 0 before there is one.
    follows_hello : bool
        At an axis: each HELLO of this version of the protocol sets the session.

    Attributes
    ----------
    n_frames, n_damaged, n_garbage : int
        Good frames; frames with a wrong checksum, which includes those of other sessions; discarded bytes.
    """

    def __init__(self, session: int = 0, follows_hello: bool = False) -> None:
        self._link = ffi.new("gsid_link *")
        self._follows_hello = follows_hello
        self.session = session

    n_frames = property(lambda self: self._link.n_frames)
    n_damaged = property(lambda self: self._link.n_damaged)
    n_garbage = property(lambda self: self._link.n_garbage)

    @property
    def session(self) -> int:
        """Id of the session whose frames are accepted."""
        return self._link.session

    @session.setter
    def session(self, session: int) -> None:
        self._link.session = session

    def __repr__(self) -> str:
        return (
            f"Receiver({self.n_frames} frames, {self.n_damaged} damaged, {self.n_garbage} bytes of garbage)"
        )

    def decode(self, data: bytes) -> np.ndarray:
        """Decode received bytes.

        Parameters
        ----------
        data : bytes
            Any piece of the stream.

        Returns
        -------
        (n,) ndarray of FRAME
            The good frames that ended in this piece.
        """
        found = np.zeros((self._link.n_held + len(data)) // FRAME_BYTES + 1, FRAME)
        source, target = ffi.from_buffer("uint8_t[]", data), ffi.from_buffer("gsid_frame[]", found)
        used, n_found, n_new = 0, 0, ffi.new("size_t *")
        while used < len(data):  # repeats after each HELLO in the data
            used += lib.gsid_link_decode(
                self._link, len(data) - used, source + used, len(found) - n_found, target + n_found, n_new
            )
            n_found += n_new[0]
            if n_new[0] and self._follows_hello:
                self._follow(found[n_found - 1])
        return found[:n_found]

    def _follow(self, frame: np.void) -> None:
        if frame["kind"] == HELLO and frame["flags"] == VERSION and 1 <= frame["tick"] <= SESSION_MAX:
            self.session = int(frame["tick"])


FRAME_BYTES = len(encode(frames(STOP), 0))
