"""Read and write the JSON of a model file, for all kinds of models."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gsid.base.errors import InputError
from gsid.base.files import write_atomically
from gsid.base.json_files import read_json

FORMAT = 1


def write_model_file(path: str | Path, data: dict[str, Any]) -> None:
    """Write the JSON of a model file. An existing file is replaced completely or not at all."""
    text = json.dumps(data, indent=1, allow_nan=False) + "\n"
    write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))


def read_model_file(path: str | Path) -> Any:
    """Read the JSON of a model file, for all kinds of models.

    Raises
    ------
    InputError
        The file cannot be read, or is not JSON.
    """
    hint = "`gsid start -o` or `gsid fit -o` writes one"
    try:
        return read_json(path)
    except OSError as error:
        what = f"the model file cannot be read: {error.strerror}"
        raise InputError(what, str(path), None, hint) from error
    except ValueError as error:
        raise InputError(f"the model file is not JSON: {error}", str(path), None, hint) from error
