"""JSON of files: standard JSON only, of a bounded size and depth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from gsid.base.arguments import LONGEST_TEXT

SIZE_MOST = 64 * 2**20  # bytes
DEPTH_MOST = 32  # lists and objects inside each other; a model file has 7
LARGEST = 1e100  # of a coefficient
DIGITS_MOST = 300  # of a whole number: more is no double


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
        It is too large, no text, nested too deep, or not JSON: numbers that are not finite are none.
    """
    path = Path(path)
    size = path.stat().st_size
    if size > SIZE_MOST:
        raise ValueError(f"{size / 2**20:.0f} MB, at most {SIZE_MOST // 2**20} are read")
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
        raise ValueError(f"nested deeper than {DEPTH_MOST} lists and objects") from None
    layer = [data]
    for _ in range(DEPTH_MOST):
        layer = [item for node in layer if isinstance(node, dict | list) for item in _items(node)]
    if any(isinstance(node, dict | list) for node in layer):
        raise ValueError(f"nested deeper than {DEPTH_MOST} lists and objects")
    return data


def _items(node: dict | list) -> list:
    return list(node.values()) if isinstance(node, dict) else node


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _finite(text: str) -> float:
    number = float(text)
    if number - number != 0:
        raise ValueError(f"the number {text[:20]} is out of range")
    return number


def _whole(text: str) -> int:
    if len(text) > DIGITS_MOST:
        raise ValueError(f"a number has {len(text)} digits")
    return int(text)


# ---------------------------------------------------------------- values by their kind


def number(data: Any, key: str, default: float | None = None) -> float | None:
    """A number of an object; `default` where there is none, or null.

    Raises
    ------
    ValueError
        It is no number, or the object is none.
    """
    return _of_kind(data, key, (int, float), "a number", default)


def text(data: Any, key: str, default: str | None = "") -> str | None:
    """A text of an object that can be printed and is not endless, as `number`."""
    value = _of_kind(data, key, str, "a text", default)
    if value is not None and len(value) > LONGEST_TEXT:
        raise ValueError(f"{key} has {len(value)} characters, at most {LONGEST_TEXT}")
    if value is not None and not value.isprintable():
        raise ValueError(f"{key} has a character that cannot be printed: {value[:40]!r}")
    return value


def flag(data: Any, key: str, default: bool | None = False) -> bool | None:
    """True or false of an object, as `number`."""
    return _of_kind(data, key, bool, "true or false", default)


def moderate(values: Any, name: str, most: float = LARGEST) -> Any:
    """Numbers, or lists of them, whose squares are doubles; null as it is.

    Raises
    ------
    ValueError
        One is no number, or larger than `most`.
    """
    if values is None:
        return None
    array = np.asarray(values)
    if array.size and array.dtype.kind not in "iuf":
        raise ValueError(f"{name} has what is no number: {str(values)[:40]!r}")
    if not np.all(np.abs(array.astype(float)) <= most):
        raise ValueError(f"{name} has a value beyond {most:g}")
    return values


def listed(data: Any, key: str) -> list[Any]:
    """A list of an object; [] where there is none, or no object."""
    return [] if data is None else _of_kind(data, key, list, "a list", None) or []


def texts(data: Any, key: str) -> list[str]:
    """A list of texts that can be printed; [] where there is none, or null."""
    values = listed(data, key)
    return [text({f"{key}[{i}]": value}, f"{key}[{i}]", None) or "" for i, value in enumerate(values)]


def _of_kind(data: Any, key: str, kind: type | tuple, words: str, default: Any) -> Any:
    if not isinstance(data, dict):
        raise ValueError(f"an object with {key} is needed, not {str(data)[:40]!r}")
    value = data.get(key)
    if value is None:
        return default
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(f"{key} is not {words}: {str(value)[:40]!r}")
    return value


def numbers(data: Any, key: str, needed: tuple[str, ...]) -> dict[str, Any]:
    """An object of numbers, some of which must be there; others may be null, as a std that is not known."""
    values = _of_kind(data, key, dict, "an object of numbers", None)
    if values is None:
        raise ValueError(f"{key} is missing")
    for name in (*needed, *values):
        if number(values, name) is None and name in needed:
            raise ValueError(f"{name} of {key} is missing")
    return values


def band_of(data: Any) -> dict[str, list[float]]:
    """{"band_hz": [lo, hi]} where an object has it, else {}."""
    band = _of_kind(data, "band_hz", list, "two numbers", None)
    if band is None:
        return {}
    if len(band) != 2 or any(number({"band_hz": edge}, "band_hz") is None for edge in band):
        raise ValueError(f"band_hz is not two numbers: {str(band)[:40]!r}")
    return {"band_hz": band}


def how_fitted(data: Any) -> dict[str, Any]:
    """How a model was fitted: the key "fit" of its file, each value of its kind.

    Raises
    ------
    ValueError
        A value is of another kind.
    """
    fit = data.get("fit") or {}
    band = band_of(fit).get("band_hz")
    return {
        "method": text(fit, "method", None),
        **{key: number(fit, key) for key in ("cost", "cost_expected", "n_lines")},
        "converged": flag(fit, "converged", None),
        "band_hz": None if band is None else tuple(band),
    }
