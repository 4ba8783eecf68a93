"""`plot()` of results: how each is drawn is registered by its type in `gsid.plots`."""

from __future__ import annotations

import functools
import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@functools.singledispatch
def figure_of(drawn: object, *args: Any, **options: Any) -> Figure:
    """Draw an object; `gsid.plots` registers a function for each type.

    Parameters
    ----------
    drawn : object
    *args, **options
        Of the function for its type.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    TypeError
        There is no drawing of this type.
    """
    raise TypeError(f"there is no drawing of a {type(drawn).__name__}")


class Plottable:
    """A result with a figure."""

    def plot(self) -> Figure:
        """Draw the result (`gsid.plots`)."""
        return self._figure()

    def _figure(self, *args: Any, **options: Any) -> Figure:
        # By name, since gsid.plots imports every type that it draws; it is loaded with matplotlib, on demand.
        importlib.import_module("gsid.plots")
        return figure_of(self, *args, **options)
