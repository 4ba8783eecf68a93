"""Exceptions of gsid by cause, and hints for misspelt names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class GsidError(RuntimeError):
    """The C library refused a call or failed.

    Parameters
    ----------
    code : int
        Negative status of the library; docs/reference/errors.md lists the codes.
    message : str
        The operation that failed, and the cause.
    hint : str
        What to do about it; empty if there is no general advice.
    """

    def __init__(self, code: int, message: str, hint: str = "") -> None:
        super().__init__(code, message, hint)
        self.code = code
        self.message = message
        self.hint = hint
        _note(self, hint)

    @property
    def of_data(self) -> bool:
        """Whether the data caused the error: not finite, too few, singular, unstable or too steep."""
        return self.code in (-4, -6, -7, -8, -11)

    def __str__(self) -> str:
        return f"{self.message} (status {self.code})"


class SimulationError(GsidError):
    """A plant cannot be simulated with its parameter values. The model is at fault, not the library."""


class InputError(ValueError):
    """A file or a record is not valid.

    Parameters
    ----------
    what : str
        What is wrong.
    where : str
        File, line, column or sample with the error.
    value : object
        The invalid value; None if no single value is invalid.
    hint : str
        What to do about it.
    """

    def __init__(self, what: str, where: str = "", value: object = None, hint: str = "") -> None:
        super().__init__(what, where, value, hint)
        self.what = what
        self.where = where
        self.value = value
        self.hint = hint
        _note(self, hint)

    def __str__(self) -> str:
        details = [self.where] if self.where else []
        if self.value is not None:
            details.append(str(self.value))
        return f"{self.what} ({': '.join(details)})" if details else self.what


class NotPeriodicError(InputError):
    """The input of a record is not periodic."""


def _note(error: Exception, hint: str) -> None:
    """Add the hint to the traceback."""
    if hint:
        error.add_note(f"hint: {hint}")


def close(name: str, names: Iterable[str]) -> str:
    """Suggest the closest name as "did you mean ...?"; empty if no name is close."""
    matches = difflib.get_close_matches(name, list(names), n=1)
    return f"did you mean {matches[0]}?" if matches else ""


def choose(name: str, names: Iterable[str]) -> str:
    """Hint for an unknown name: the closest of `names`, and the list of them."""
    names = list(names)
    return f"{close(name, names)} available: {', '.join(names) or 'none'}".lstrip()
