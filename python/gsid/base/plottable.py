"""Method `plot()` of results. A separate module names the drawing function of each type."""

from __future__ import annotations

import html
import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Plottable:
    """A result with a figure. A notebook shows its text, unless it has a table of its own."""

    drawn_by = ""  # module with the names of the drawing functions, imported on demand; set by `gsid`

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
        """Draw it by the function of its type, else of the nearest type that it is derived from.

        Raises
        ------
        TypeError
            No drawing function is named for this type.
        """
        module = importlib.import_module(self.drawn_by)
        for one in type(self).__mro__:
            name = module.DRAWINGS.get(f"{one.__module__}.{one.__qualname__}")
            if name is not None:
                return getattr(module, name)(self, *args, **options)
        raise TypeError(f"a {type(self).__name__} cannot be plotted")
