"""Addresses of results by content: the same records, options and version have the same address anywhere."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path

ANSWERS = 7
"""Version of the answers. Increase it with every change after which a verb may answer otherwise.

Old results are then computed again. tests/fleet/test_answers.py fails if an answer changed without it.
"""
META_FILE = "meta.json"  # beside a record, it may hold its rate and units


def file_digest(path: str | Path) -> str:
    """SHA-256 of a file and its extension, which decides how it is read.

    A file that cannot be read has a digest of its own: its unit fails, and is computed once it can be read.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            return f"{path.suffix.lower()}:{hashlib.file_digest(file, 'sha256').hexdigest()}"
    except OSError as error:
        return f"unreadable:{error.errno}"


def record_digest(path: str | Path) -> str:
    """Digest of a record, and of the `meta.json` in its folder if there is one."""
    meta = Path(path).parent / META_FILE
    return file_digest(path) + (f"+{file_digest(meta)}" if meta.is_file() else "")


def address(work: str, options: Mapping[str, object], digests: Iterable[str]) -> str:
    """Address of a result: SHA-256 of everything that decides it, in hexadecimal digits.

    Parameters
    ----------
    work : str
        What is run.
    options : mapping
        Values that JSON can hold; for files, their digests.
    digests : iterable of str
        Those of the records, in the order in which they are read.
    """
    content = {"answers": ANSWERS, "work": work, "options": dict(options), "records": list(digests)}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
