"""Write output files atomically: a file is replaced completely or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import signal
import stat
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from gsid.base.errors import InputError

STDOUT = "-"
TEMPORARY = ".gsid-"  # begins the names of files that are not finished
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISCHR, "a character device"),
    (stat.S_ISBLK, "a block device"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
)
_ENDING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGQUIT") if hasattr(signal, name)]


def write_atomically(path: str | os.PathLike, write: Callable[[Path], None]) -> None:
    """Write a temporary file with `write`, synchronise it to the disk, then rename it to `path`.

    An existing file keeps its mode, and its owner where that is permitted. A symbolic link is kept, and its
    target is replaced. `-` is the standard output of the process.

    Parameters
    ----------
    path : path_like
    write : callable
        Called with the temporary name, which has the extension of `path` in lower case.

    Raises
    ------
    InputError
        `path` exists and is not a regular file (`target_of`).
    OSError
        The file cannot be written. An existing file is unchanged.
    """
    try:
        if is_stdout(path):
            with _temporary(Path(tempfile.gettempdir()), "", 0o600) as part:
                write(part)
                _copy_to_stdout(part)
            return
        target = target_of(path)
        with _temporary(target.parent, kind_of(path), 0o600 if target.exists() else 0o666) as part:
            write(part)
            if target.exists():
                _copy_attributes(target, part)
            _sync(part)
            os.replace(part, target)
        _sync(target.parent)
    except OSError as error:
        if error.errno is not None:
            error.filename = str(path)  # the caller does not know the temporary name
        raise


def is_stdout(path: str | os.PathLike) -> bool:
    """Whether a name stands for the standard output; write ./- for a file named "-"."""
    return os.fspath(path) == STDOUT


def kind_of(path: str | os.PathLike, stream: str = "") -> str:
    """Extension in lower case; `stream` for the standard output, which has none."""
    return stream if is_stdout(path) else Path(path).suffix.lower()


def target_of(path: str | os.PathLike) -> Path:
    """Find the file that a write to `path` replaces or creates: links are followed.

    Parameters
    ----------
    path : path_like

    Returns
    -------
    Path

    Raises
    ------
    InputError
        A folder, device, pipe or socket, or a link that leads to no file.
    PermissionError
        An existing file is read-only.
    """
    name = os.fspath(path)
    try:
        mode = os.stat(name).st_mode
    except FileNotFoundError:
        if os.path.islink(name):
            hint = "remove the link, or name another file"
            raise InputError("the link leads to no file", name, os.readlink(name), hint) from None
        return Path(name)
    if not stat.S_ISREG(mode):
        kind = next((text for is_kind, text in _KINDS if is_kind(mode)), "no regular file")
        hint = "name a file" if stat.S_ISDIR(mode) else f"name a file, or {STDOUT} for the standard output"
        raise InputError("the output is not a regular file", name, kind, hint)
    if not os.access(name, os.W_OK):
        raise PermissionError(errno.EACCES, "the file is read-only", name)
    return Path(os.path.realpath(name))


def refuse_overwrite(path: str | os.PathLike, used: Iterable[str | os.PathLike], what: str) -> None:
    """Refuse an output file that is in use as another file, under the same or another name.

    Parameters
    ----------
    path : path_like
        Output.
    used : iterable of path_like
        Files in use.
    what : str
        Message if the output is one of them.

    Raises
    ------
    InputError
        The output is one of the files in use.
    """
    for other in used:
        if _same_file(path, other):
            name = Path(path)
            hint = f"give the output another name, for example {name.with_stem(name.stem + '2')}"
            raise InputError(what, str(path), None if str(path) == str(other) else f"is {other}", hint)


def _same_file(one: str | os.PathLike, other: str | os.PathLike) -> bool:
    """Whether two names are the same file (device and inode), or would become the same file."""
    with contextlib.suppress(OSError):
        return os.path.samefile(one, other)
    return os.path.realpath(one) == os.path.realpath(other)


@contextlib.contextmanager
def _temporary(folder: Path, extension: str, mode: int) -> Iterator[Path]:
    """Create a file with a random name. It is removed on exit unless it was renamed."""
    part = folder / f"{TEMPORARY}{os.urandom(8).hex()}{extension}"
    with _removed_by_signals(part):
        try:
            os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode))
            yield part
        finally:
            part.unlink(missing_ok=True)


@contextlib.contextmanager
def _removed_by_signals(part: Path) -> Iterator[None]:
    """Remove the file before a signal ends the process. Signals that have a handler are not changed."""

    def end(number: int, frame: object) -> None:
        part.unlink(missing_ok=True)
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    caught = []
    if threading.current_thread() is threading.main_thread():
        caught = [number for number in _ENDING if signal.getsignal(number) is signal.SIG_DFL]
    for number in caught:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in caught:
            signal.signal(number, signal.SIG_DFL)


def _copy_attributes(old: Path, new: Path) -> None:
    """Copy the mode and the extended attributes, and the owner where that is permitted."""
    was = os.stat(old)
    for owner in ((-1, was.st_gid), (was.st_uid, -1)):
        with contextlib.suppress(OSError):
            os.chown(new, *owner)
    shutil.copystat(old, new)
    os.utime(new)
    now = os.stat(new)
    if now.st_gid != was.st_gid:  # do not give the old group's permissions to another group
        os.chmod(new, stat.S_IMODE(was.st_mode) & ~0o7070)


def _sync(path: Path) -> None:
    """Wait until a file or a folder is on the disk. Some file systems cannot synchronise folders."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError:
        if not path.is_dir():
            raise
    finally:
        os.close(descriptor)


def _copy_to_stdout(part: Path) -> None:
    if sys.__stdout__ is None:
        raise OSError(errno.EBADF, "there is no standard output")
    sys.__stdout__.flush()
    with part.open("rb") as file:
        shutil.copyfileobj(file, sys.__stdout__.buffer)
    sys.__stdout__.buffer.flush()
