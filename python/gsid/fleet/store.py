"""Folder of results: one JSON file each, named by its address, complete or absent."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from gsid.base.files import write_atomically
from gsid.base.json_files import parse_json

RESULTS = "results"  # folder below that of the fleet


class Store:
    """Results of a fleet.

    Parameters
    ----------
    folder : path
        Folder of the fleet.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder) / RESULTS

    def path(self, key: str) -> Path:
        """File of a result, whether it exists or not."""
        return self.folder / key[:2] / f"{key}.json"

    def has(self, key: str) -> bool:
        """Whether there is a result."""
        return self.path(key).is_file()

    def read(self, key: str) -> dict | None:
        """Read a result; None if there is none or it is damaged, so that it is computed again."""
        try:
            found = parse_json(self.path(key).read_text(encoding="utf-8"))
        except (FileNotFoundError, ValueError):
            return None
        return found if isinstance(found, dict) and found.get("key") == key else None

    def write(self, result: dict) -> None:
        """Write a result under its key. Two processes that write the same one leave one whole file."""
        path = self.path(result["key"])
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(result, allow_nan=False)
        write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))

    def remove(self, key: str) -> None:
        """Remove a result if it exists."""
        self.path(key).unlink(missing_ok=True)

    def files(self) -> Iterator[Path]:
        """All files of the store, also those that an ended process left unfinished."""
        if self.folder.is_dir():
            for part in self.folder.iterdir():
                yield from part.iterdir() if part.is_dir() else [part]
