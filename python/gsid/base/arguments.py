"""Arguments as people give them: taken where it is clear what is meant, refused in their own words."""

from __future__ import annotations

import math
from typing import Any

from gsid.base.errors import InputError

LONGEST_TEXT = 2000  # characters: a picture takes seconds to draw a longer label
SLOWEST_HZ, FASTEST_HZ = 1e-9, 1e15  # sample rates: powers of frequencies stay doubles


def whole_samples(name: str, value: Any) -> int | None:
    """A count of samples; a float is taken when it is a whole number, as one out of a file is.

    Parameters
    ----------
    name : str
        Of the argument, for the error's text.
    value : int, float or None
        None stays None.

    Raises
    ------
    ValueError
        Not a whole number.
    TypeError
        No number at all.
    """
    if value is None:
        return None
    number = real_number(name, value, "samples")
    if not (math.isfinite(number) and number == round(number)):
        raise ValueError(f"{name} must be a whole number of samples, got {value}")
    return round(number)


def real_number(name: str, value: Any, unit: str) -> float:
    """A number as a float; TypeError where it is none.

    Parameters
    ----------
    name, unit : str
        Of the argument, for the error's text.
    value : float
        A text is none, whatever it says.
    """
    try:
        if isinstance(value, str | bytes):
            raise TypeError
        return float(value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be a number [{unit}], got {value!r:.60}") from error


def sample_rate(value: float, where: str) -> float:
    """A sample rate that can be calculated with.

    Parameters
    ----------
    value : float
        Hz.
    where : str
        File or record.

    Raises
    ------
    InputError
        It is not positive, or no rate that anything is sampled with.
    """
    if not (math.isfinite(value) and value > 0):
        raise InputError("the sample rate is not a positive number", where, value, "give it with --fs [Hz]")
    if not SLOWEST_HZ <= value <= FASTEST_HZ:
        hint = f"it lies in {SLOWEST_HZ:g} .. {FASTEST_HZ:g} Hz: look at its unit, or give it with --fs [Hz]"
        raise InputError("the sample rate is out of range", where, f"{value:g} Hz", hint)
    return value


def printable_text(name: str, value: Any, where: str) -> str:
    """A text that comes out of a file and is printed: no codes that a terminal obeys, no line breaks.

    Parameters
    ----------
    name : str
        Of the text, for the error's text.
    value : str
    where : str
        File or record.

    Raises
    ------
    InputError
        It is no text, is longer than 2000 characters, or has one that cannot be printed.
    """
    if not isinstance(value, str):
        raise InputError(f"{name} is not a text", where, repr(value)[:60], f"write {name} as a text")
    if len(value) > LONGEST_TEXT:
        hint = f"write at most {LONGEST_TEXT} characters"
        raise InputError(f"{name} is too long", where, f"{len(value)} characters, {value[:20]}...", hint)
    if not value.isprintable():
        hint = f"write {name} without control characters"
        raise InputError(f"{name} has a character that cannot be printed", where, repr(value)[:60], hint)
    return value
