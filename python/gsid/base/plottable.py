"""Method `plot()` of results. A separate module registers a drawing function for each type."""

from __future__ import annotations

import functools
import html
import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@functools.singledispatch
def figure_of(drawn: object, *args: Any, **options: Any) -> Figure:
    """Draw an object by the function that is registered for its type.

    Parameters
    ----------
    drawn : object
    *args, **options
        Arguments of the drawing function of its type.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    TypeError
        No drawing function is registered for this type.
    """
    raise TypeError(f"a {type(drawn).__name__} cannot be plotted")


class Plottable:
    """A result with a figure. A notebook shows its text, unless it has a table of its own."""

    drawn_by = ""  # module that registers the drawing functions, imported on demand; set by `gsid`

    def plot(self) -> Figure:
        """Draw the result. The functions of `gsid.plots` describe each figure.

        Returns
        -------
        matplotlib.figure.Figure
            `gain, phase = frf.plot()` gives its axes, as does `.axes`. A notebook shows the figure.
        """
        return self._figure()

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"

    def _figure(self, *args: Any, **options: Any) -> Figure:
        importlib.import_module(self.drawn_by)
        return figure_of(self, *args, **options)
