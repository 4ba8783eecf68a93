"""Modules that are called like the function they are named after: `gsid.compare(model, records)`.

`gsid.compare` is a module for whoever imports from it and a function for whoever calls it. A function
put in the module's place would hide the module from `import gsid.compare as c`, and would itself be
replaced by the module whenever somebody imports it; a module that can be called is the same thing always.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any


class _CallableModule(ModuleType):
    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self.__wrapped__(*args, **kwargs)


def callable_as(function: Callable) -> None:
    """Let the module that defines a function be called in its place, with its signature.

    Parameters
    ----------
    function : callable
        Defined in the module that calls this.
    """
    module = sys.modules[function.__module__]
    module.__class__ = _CallableModule
    module.__wrapped__ = function  # inspect.signature follows it
