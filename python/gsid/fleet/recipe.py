"""The recipe of a fleet: a TOML file with a verb, its options, and how files belong to units."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gsid.base.errors import InputError, choose
from gsid.fleet.unit import Limits

GROUPS = ("unit", "time", "group")  # of the pattern of names
_KEYS = ("verb", "options", "unit", "seconds", "memory_mb")


@dataclass(frozen=True)
class Recipe:
    """What is run on every unit.

    Attributes
    ----------
    path : Path
    verb : str
    options : dict
        Options of the verb by their names, without the dashes.
    pattern : re.Pattern or None
        Finds the unit in the path of a record, and optionally its time and group. None: by the folders.
    limits : Limits
    """

    path: Path
    verb: str
    options: dict[str, Any] = field(default_factory=dict)
    pattern: re.Pattern[str] | None = None
    limits: Limits = field(default_factory=Limits)


def read_recipe(path: str | Path) -> Recipe:
    """Read a recipe.

    Raises
    ------
    InputError
        It is not TOML, a key is unknown, or a value has the wrong type.
    """
    path = Path(path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError("the recipe is not TOML", str(path), str(error)) from None
    for key in data:
        if key not in _KEYS:
            hint = f"{choose(key, _KEYS)}; options of the verb stand below [options]"
            raise InputError("the recipe has an unknown key", str(path), key, hint)
    verb, options = data.get("verb"), data.get("options", {})
    if not isinstance(verb, str):
        raise InputError("the recipe has no verb", str(path), verb, 'add a line such as verb = "diagnose"')
    if not isinstance(options, dict):
        raise InputError("options is not a table", str(path), options, "write the line [options] above them")
    limits = Limits(*(_positive(path, data, key) for key in ("seconds", "memory_mb")))
    return Recipe(path, verb, options, _pattern(path, data.get("unit")), limits)


def _positive(path: Path, data: dict[str, Any], key: str) -> float | None:
    value = data.get(key)
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not 0 < value < float("inf"):
        raise InputError(f"{key} is not a positive number", str(path), value, f"for example {key} = 600")
    return float(value)


def _pattern(path: Path, text: object) -> re.Pattern[str] | None:
    if text is None:
        return None
    hint = r"for example unit = '(?P<unit>SN\d+)_(?P<time>\d{4}-\d\d-\d\d)'"
    try:
        found = re.compile(str(text))
    except re.error as error:
        raise InputError("unit is not a regular expression", str(path), f"{text}: {error}", hint) from None
    if "unit" not in found.groupindex or not set(found.groupindex) <= set(GROUPS):
        what = "the pattern of unit needs the group unit, and may have the groups time and group"
        raise InputError(what, str(path), text, hint)
    return found
