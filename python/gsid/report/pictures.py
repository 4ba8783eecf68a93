"""Pictures of a report: their captions, and their inline SVG for wide and for narrow screens."""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from markupsafe import Markup, escape

from gsid import plots
from gsid.plots.interactive import interactive

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Drawing:
    """A picture to draw.

    Attributes
    ----------
    title : str
        A key of `CAPTIONS`.
    draw : callable
        Returns the figure.
    facts : str
        What this one shows, before the caption that all such pictures share.
    """

    title: str
    draw: Callable[[], Figure]
    facts: str = ""


@dataclass(frozen=True)
class Picture:
    """A picture of the page.

    Attributes
    ----------
    title, caption : str
    wide, narrow : Markup
        SVG elements for the two widths of a page.
    data : Markup
        The same two as figures of plotly, in JSON; empty if the page is not interactive. The traces of the
        narrow one are left out where they are those of the wide one.
    """

    title: str
    caption: str
    wide: Markup
    narrow: Markup
    data: Markup


CAPTIONS = {
    "Measured and simulated signal": "The difference of an adequate model is noise: it is as "
    "large as the grey band, and shows no pattern.",
    "Estimators": "If only noise remains, the errors stay below the bound. Linear least squares is "
    "inaccurate at low frequencies. Maximum likelihood has its largest errors where the noise is largest.",
    "Excitation": "One period in time and its lines. A crest factor near 1.4 gives the most power within a "
    "limited command. With a model, the predicted travel is shown too. With several records, this is the one "
    "with the largest input.",
    "Noise": "The part of the output that does not repeat with the period: its spectral density, and "
    "periodic disturbances such as a fan.",
    "Periods": "Settled periods repeat, and their differences from the mean are noise. The transient must "
    "decay to this level before the first period used.",
    "Frequency response": "The response and, in the same dB, the standard deviation of its noise: the "
    "distance between the two is the signal-to-noise ratio of each line.",
    "Measured and fitted": "A correct model passes through the measured points. Bars and band are 95 % "
    "intervals, point by point.",
    "Complex residual": "The distance between measurement and model in the complex plane. If only noise "
    "remains, 5 % of the points lie above the bound, spread evenly.",
    "Poles and zeros": "Dotted rays are equal damping, circles equal frequency; each close-up shows the "
    "region in which the root lies with 95 % confidence.",
    "Error before an effect is added": "The error after a fit of the free parameters, against the noise, for "
    "excited lines and for other lines.",
    "Missing torque": "The error of the output, converted to torque by the inverse of the model and averaged "
    "over samples of similar rate, angle or command, with the law found. Positive torque drives forwards. A "
    "curve that leaves its band of ±2 σ indicates the form of the missing law.",
    "With the effects found": "The error after adding the effects found. If they are right, only noise "
    "remains.",
    "Ladder": "Each step is fitted to some of the data and validated on the rest. A true effect reduces the "
    "error on the validation data, the last missing one to the noise; most wrong effects do not. If the "
    "search used the validation data too, the error on new data may be larger.",
    "Comparison at the output": "The error of the model against the noise. An excess at lines that were not "
    "excited can only be nonlinear; at excited lines it is nonlinear or due to a missing linear effect.",
    "Noise and distortion": "Top: the response with its uncertainty from noise alone, which averaging "
    "reduces, and from noise and distortion together. Bottom: the output at excited and at other lines.",
}


class Painter:
    """Draws the pictures of one experiment, with ids that are unique on the page.

    Parameters
    ----------
    number : int
        Of the experiment.
    interactive : bool
        Whether figures of plotly are added.
    """

    def __init__(self, number: int, *, interactive: bool) -> None:
        self._number, self._interactive, self._n = number, interactive, 0

    def paint(self, drawings: Iterable[Drawing]) -> list[Picture]:
        """Draw.

        Parameters
        ----------
        drawings : iterable of Drawing
        """
        return [self._painted(one) for one in drawings]

    def _painted(self, one: Drawing) -> Picture:
        self._n += 1
        prefix = f"e{self._number}p{self._n}"
        caption = f"{one.facts} {CAPTIONS[one.title]}".strip()
        label = f"{one.title}. {caption}"
        wide = one.draw()
        with plots.narrow():
            small = one.draw()
        data = _inline_json(wide, small) if self._interactive else ""
        return Picture(
            one.title,
            caption,
            inline_svg(wide, f"{prefix}w-", label, "wide"),
            inline_svg(small, f"{prefix}n-", label, "narrow"),
            Markup(data),
        )


def _inline_json(wide: Figure, narrow: Figure) -> str:
    """Figures of plotly for two widths, for a script element: no text in them can end the element."""
    first, second = interactive(wide), interactive(narrow)
    figures = {"data": _packed(first["data"]), "wide": first["layout"], "narrow": second["layout"]}
    if second["data"] != first["data"]:
        figures["dataNarrow"] = _packed(second["data"])
    return json.dumps(figures, allow_nan=False, separators=(",", ":")).replace("<", r"\u003c")


def _packed(traces: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Traces with their numbers in single precision, as plotly.js reads them from base64."""
    return [trace | {axis: _base64(trace[axis]) for axis in "xy"} for trace in traces]


def _base64(values: list[float | None]) -> dict[str, str]:
    numbers = np.array(values, dtype="<f4")  # None becomes NaN, a gap
    return {"dtype": "f4", "bdata": base64.b64encode(numbers.tobytes()).decode()}


# Text stays text, which can be searched, in the font of the drawing or a similar one.
FONTS = "font-family: 'DejaVu Sans', Verdana, 'Liberation Sans', Arial, sans-serif"


def inline_svg(figure: Figure, prefix: str, label: str, kind: str) -> Markup:
    """SVG element for an HTML page: no prologue, no fixed size, and ids that are unique on the page.

    Parameters
    ----------
    figure : Figure
    prefix : str
        Of the ids.
    label : str
        Text for readers who do not see the picture.
    kind : str
        Class of the element.
    """
    text = io.StringIO()
    with matplotlib.rc_context(plots.STYLE | {"svg.fonttype": "none"}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = _compact(svg)
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{prefix}", svg)
    svg = re.sub(r'(<svg\b[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg\b[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    attributes = f'class="{kind}" role="img" aria-label="{escape(label)}" style="{FONTS}"'
    return Markup(svg.replace("<svg", f"<svg {attributes}", 1))


_SHORT = re.compile(r"(\d\.\d)\d+")  # a tenth of a point is below a screen's resolution
_POINTS = re.compile(r"<g([^>]*)>((?:<use [^>]*/>)+)</g>")
_STYLE = re.compile(r' style="([^"]*)"')


def _compact(svg: str) -> str:
    """The same drawing in a third of the characters."""
    svg = re.sub(r'<g id="[^"]*"', "<g", svg)
    svg = re.sub(r">\s+<", "><", svg)
    svg = re.sub(r"""font: ([^;"]*?)px 'DejaVu Sans'""", r"font-size: \1px", svg)
    svg = svg.replace("font-family: 'DejaVu Sans'; ", "")
    svg = re.sub(r' transform="rotate\(-0 [^"]*"', "", svg)
    svg = re.sub(r'(?<! id=)\b(?:d|x|y)="[^"]*"', _shortened, svg)
    return _POINTS.sub(_with_one_style, svg)


def _shortened(attribute: re.Match[str]) -> str:
    text = re.sub(r"\s*([MLHVCQZz])\s*", r"\1", attribute[0])
    # the shape of a marker is a few points wide
    return text if len(text) < 400 and "C" in text else _SHORT.sub(r"\1", text)


def _with_one_style(group: re.Match[str]) -> str:
    """Points of one style state it once, for all of them."""
    styles = set(_STYLE.findall(group[2]))
    if len(styles) != 1:
        return group[0]
    return f'<g{group[1]} style="{styles.pop()}">{_STYLE.sub("", group[2])}</g>'
