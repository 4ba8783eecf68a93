"""Read JSON files: standard JSON only, with limits on size and depth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from gsid.base.arguments import LONGEST_TEXT, is_one_line

MAX_SIZE = 64 * 2**20  # bytes
MAX_DEPTH = 32  # nested lists and objects; a model file has 7
LARGEST = 1e100  # of a coefficient
MAX_DIGITS = 300  # of a whole number: a longer one exceeds the range of a double


def read_json(path: str | Path) -> Any:
    """Read a JSON file.

    Parameters
    ----------
    path : path

    Returns
    -------
    dict, list, str, float, int, bool or None

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        The file is too large, not text, nested too deeply, or not JSON. JSON has no infinity and no NaN.
    """
    path = Path(path)
    size = path.stat().st_size
    if size > MAX_SIZE:
        raise ValueError(f"{size / 2**20:.0f} MB, at most {MAX_SIZE // 2**20} are read")
    return parse_json(path.read_text(encoding="utf-8"))


def parse_json(text: str) -> Any:
    """Parse a text as `read_json` does.

    Raises
    ------
    ValueError
        As `read_json`.
    """
    try:
        data = json.loads(text, parse_constant=_no_constant, parse_float=_finite, parse_int=_whole)
    except RecursionError:
        raise ValueError(f"nested deeper than {MAX_DEPTH} lists and objects") from None
    layer = [data]
    for _ in range(MAX_DEPTH):
        layer = [item for node in layer if isinstance(node, dict | list) for item in _items(node)]
    if any(isinstance(node, dict | list) for node in layer):
        raise ValueError(f"nested deeper than {MAX_DEPTH} lists and objects")
    return data


def _items(node: dict | list) -> list:
    return list(node.values()) if isinstance(node, dict) else node


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is not a JSON number")


def _finite(text: str) -> float:
    number = float(text)
    if number - number != 0:
        raise ValueError(f"the number {text[:20]} is out of range")
    return number


def _whole(text: str) -> int:
    if len(text) > MAX_DIGITS:
        raise ValueError(f"a number has {len(text)} digits")
    return int(text)


# ---------------------------------------------------------------- values by type


def number(data: Any, key: str, default: float | None = None) -> float | None:
    """Read a number of an object; `default` if the key is missing or null.

    Raises
    ------
    ValueError
        The value is not a number, or `data` is not an object.
    """
    return _of_kind(data, key, (int, float), "a number", default)


def text(data: Any, key: str, default: str | None = "") -> str | None:
    """Read a printable text of an object, of limited length, as `number`."""
    value = _of_kind(data, key, str, "a text", default)
    if value is not None and len(value) > LONGEST_TEXT:
        raise ValueError(f"{key} has {len(value)} characters, at most {LONGEST_TEXT}")
    if value is not None and not is_one_line(value):
        raise ValueError(f"{key} has a character that cannot be printed: {value[:40]!r}")
    return value


def flag(data: Any, key: str, default: bool | None = False) -> bool | None:
    """Read true or false of an object, as `number`."""
    return _of_kind(data, key, bool, "true or false", default)


def moderate(values: Any, name: str, most: float = LARGEST) -> Any:
    """Check that the squares of numbers, or of lists of numbers, fit into doubles. None is returned as None.

    Raises
    ------
    ValueError
        A value is not a number, or its magnitude is larger than `most`.
    """
    if values is None:
        return None
    array = np.asarray(values)
    if array.size and array.dtype.kind not in "iuf":
        raise ValueError(f"{name} has a value that is not a number: {str(values)[:40]!r}")
    if not np.all(np.abs(array.astype(float)) <= most):
        raise ValueError(f"{name} has a value beyond {most:g}")
    return values


def listed(data: Any, key: str) -> list[Any]:
    """Read a list of an object; [] if the key is missing or null, or `data` is None."""
    return [] if data is None else _of_kind(data, key, list, "a list", None) or []


def texts(data: Any, key: str) -> list[str]:
    """Read a list of printable texts; [] if the key is missing or null."""
    values = listed(data, key)
    return [text({f"{key}[{i}]": value}, f"{key}[{i}]", None) or "" for i, value in enumerate(values)]


def _of_kind(data: Any, key: str, kind: type | tuple, words: str, default: Any) -> Any:
    if not isinstance(data, dict):
        raise ValueError(f"an object with {key} is required, not {str(data)[:40]!r}")
    value = data.get(key)
    if value is None:
        return default
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(f"{key} is not {words}: {str(value)[:40]!r}")
    return value


def numbers(data: Any, key: str, needed: tuple[str, ...]) -> dict[str, Any]:
    """Read an object of numbers. Those in `needed` must be present; others may be null, for example a std."""
    values = _of_kind(data, key, dict, "an object of numbers", None)
    if values is None:
        raise ValueError(f"{key} is missing")
    for name in (*needed, *values):
        if number(values, name) is None and name in needed:
            raise ValueError(f"{name} of {key} is missing")
    return values


def band_of(data: Any) -> dict[str, list[float]]:
    """Return {"band_hz": [lo, hi]} if the object has the key, else {}."""
    band = _of_kind(data, "band_hz", list, "two numbers", None)
    if band is None:
        return {}
    if len(band) != 2 or any(number({"band_hz": edge}, "band_hz") is None for edge in band):
        raise ValueError(f"band_hz is not two numbers: {str(band)[:40]!r}")
    return {"band_hz": band}


def how_fitted(data: Any) -> dict[str, Any]:
    """Read how a model was fitted from the key "fit" of its file, and check the type of each value.

    Raises
    ------
    ValueError
        A value has the wrong type.
    """
    fit = data.get("fit") or {}
    band = band_of(fit).get("band_hz")
    return {
        "method": text(fit, "method", None),
        **{key: number(fit, key) for key in ("cost", "cost_expected", "n_lines")},
        "converged": flag(fit, "converged", None),
        "band_hz": None if band is None else tuple(band),
    }
