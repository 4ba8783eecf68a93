"""Files that are written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path


def write_atomically(path: str | os.PathLike, write: Callable[[Path], None]) -> None:
    """Let `write` fill a file of a temporary name beside `path`, then rename it: never half a file.

    Parameters
    ----------
    path : path_like
    write : callable
        Given the temporary name, which has the extension of `path`.
    """
    path = Path(path)
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        write(part)
        os.replace(part, path)
    except OSError as error:
        if error.errno is not None:
            error.filename = str(path)  # nobody has heard of the other
        raise
    finally:
        part.unlink(missing_ok=True)
