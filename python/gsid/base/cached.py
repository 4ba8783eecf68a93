"""A property that is computed once, without the lock of the standard library's."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class cached_property:
    """As `functools.cached_property` from Python 3.12 on.

    That of Python 3.11 holds one lock of the class while it computes: threads wait for each other, and a
    child forked meanwhile would wait for ever. Here two threads may compute the same value twice.
    """

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function, self._name, self.__doc__ = function, function.__name__, function.__doc__

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        if instance is None:
            return self
        value = instance.__dict__[self._name] = self._function(instance)
        return value
