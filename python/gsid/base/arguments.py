"""Checks of arguments. An unambiguous value is converted; any other value is refused."""

from __future__ import annotations

import math
import unicodedata
from typing import Any

from gsid.base.errors import InputError

LONGEST_TEXT = 2000  # characters: a picture takes seconds to draw a longer label
SLOWEST_HZ, FASTEST_HZ = 1e-9, 1e15  # sample rates: powers of frequencies stay doubles


def whole_samples(name: str, value: Any) -> int | None:
    """Convert a number of samples to an integer. A float must be a whole number.

    Parameters
    ----------
    name : str
        Name of the argument, for the error message.
    value : int, float or None
        None is returned as None.

    Raises
    ------
    ValueError
        The value is not a whole number.
    TypeError
        The value is not a number.
    """
    if value is None:
        return None
    number = real_number(name, value, "samples")
    if not (math.isfinite(number) and number == round(number)):
        raise ValueError(f"{name} must be a whole number of samples, got {value}")
    return round(number)


def real_number(name: str, value: Any, unit: str) -> float:
    """Convert a number to a float.

    Parameters
    ----------
    name, unit : str
        Name and unit of the argument, for the error message.
    value : float
        A string is not converted, even if it holds a number.

    Raises
    ------
    TypeError
        The value is not a number.
    """
    try:
        if isinstance(value, str | bytes):
            raise TypeError
        return float(value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be a number [{unit}], got {value!r:.60}") from error


def sample_rate(value: float, where: str) -> float:
    """Check a sample rate.

    Parameters
    ----------
    value : float
        Hz.
    where : str
        File or record.

    Raises
    ------
    InputError
        The rate is not positive, or it is outside 1e-9 .. 1e15 Hz.
    """
    if not (math.isfinite(value) and value > 0):
        raise InputError("the sample rate is not a positive number", where, value, "give it with --fs [Hz]")
    if not SLOWEST_HZ <= value <= FASTEST_HZ:
        hint = f"the range is {SLOWEST_HZ:g} .. {FASTEST_HZ:g} Hz: check the unit, or give it with --fs [Hz]"
        raise InputError("the sample rate is out of range", where, f"{value:g} Hz", hint)
    return value


def is_one_line(text: str) -> bool:
    """Whether a text has only printable characters and spaces, so that it stays one line when written.

    `str.isprintable` refuses the non-breaking space, which spreadsheets write into names of columns.

    Parameters
    ----------
    text : str
    """
    return all(one.isprintable() or unicodedata.category(one) == "Zs" for one in text)


def printable_text(name: str, value: Any, where: str) -> str:
    """Check a text that was read from a file and will be printed.

    Control characters, which a terminal would execute, and line breaks are refused.

    Parameters
    ----------
    name : str
        Name of the text, for the error message.
    value : str
    where : str
        File or record.

    Raises
    ------
    InputError
        The value is not a text, is longer than 2000 characters, or has a character that cannot be printed.
    """
    if not isinstance(value, str):
        raise InputError(f"{name} is not a text", where, repr(value)[:60], f"write {name} as a text")
    if len(value) > LONGEST_TEXT:
        hint = f"write at most {LONGEST_TEXT} characters"
        raise InputError(f"{name} is too long", where, f"{len(value)} characters, {value[:20]}...", hint)
    if not is_one_line(value):
        hint = f"write {name} without control characters"
        raise InputError(f"{name} has a character that cannot be printed", where, repr(value)[:60], hint)
    return value
