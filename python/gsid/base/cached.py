"""A property that is computed once. Unlike that of the standard library, it does not use a lock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class cached_property:
    """Equivalent of `functools.cached_property` of Python 3.12 and later.

    Python 3.11 holds a lock of the class during the computation. Threads wait for each other, and a child
    process forked at that time would wait for ever. This version may compute a value twice in two threads.
    """

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function, self._name, self.__doc__ = function, function.__name__, function.__doc__

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        if instance is None:
            return self
        value = instance.__dict__[self._name] = self._function(instance)
        return value
