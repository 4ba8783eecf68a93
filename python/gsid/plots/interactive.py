"""A picture as a plotly figure: the same lines, bands, axes and texts, to zoom into and to read values from.

The drawing functions of this package stay the only description of each picture. Plotly is not imported: its
figures are plain dictionaries, and a page draws them with plotly.js.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, StepPatch
from matplotlib.text import Text

DASHES = {"-": "solid", "--": "dash", ":": "dot", "-.": "dashdot"}
SYMBOLS = {
    "o": "circle",
    "x": "x",
    "+": "cross",
    "s": "square",
    "^": "triangle-up",
    "D": "diamond",
    ".": "circle",
}
FORMULA = r"\mathdefault"  # in the labels of a logarithmic axis
PIXELS_PER_POINT = 96 / 72
PIXELS_PER_INCH = 96
TITLE_PIXELS = 11  # a page is narrower than its figure: titles end where those of the figure do
VERTICAL = {
    "top": "top",
    "center": "middle",
    "center_baseline": "middle",
    "baseline": "bottom",
    "bottom": "bottom",
}


def interactive(figure: Figure) -> dict[str, Any]:
    """Convert a picture of this package.

    Parameters
    ----------
    figure : Figure

    Returns
    -------
    dict
        `data` and `layout` of a plotly figure, of plain numbers and texts: JSON without conversion.
    """
    figure.canvas.draw()  # the layout of the axes is known only then
    shown = [ax for ax in figure.axes if ax.get_visible()]
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "height": round(figure.get_figheight() * PIXELS_PER_INCH),
        "margin": {"l": 8, "r": 8, "t": 30, "b": 30},
        "legend": {"orientation": "h", "yref": "container", "yanchor": "bottom", "y": 0, "x": 0},
        "hovermode": "closest",
        "plot_bgcolor": "white",
        "shapes": [],
        "annotations": [],
    }
    names: set[str] = set()
    for number, ax in enumerate(shown, 1):
        layout |= _axes_of(ax, number, shown)
        data += _traces(ax, number, names)
        layout["shapes"] += list(_lines_across(ax, number))
        layout["annotations"] += [*_title(ax, number), *_texts(ax, number)]
    return {"data": data, "layout": layout}


def _suffix(number: int) -> str:
    return "" if number == 1 else str(number)


# --- axes -------------------------------------------------------------------------------------------------


def _axes_of(ax: Axes, number: int, shown: list[Axes]) -> dict[str, Any]:
    box = ax.get_position()
    place = {"x": [box.x0, box.x1], "y": [box.y0, box.y1]}
    made = {}
    for letter, axis in (("x", ax.xaxis), ("y", ax.yaxis)):
        other = "y" if letter == "x" else "x"
        limits = np.asarray(getattr(ax, f"get_{letter}lim")(), float)
        is_log = axis.get_scale() == "log"
        title = _plain(axis.get_label_text()) if _has_labels(axis) else ""
        made[f"{letter}axis{_suffix(number)}"] = (
            {
                "anchor": f"{other}{_suffix(number)}",
                "domain": [float(np.clip(end, 0, 1)) for end in place[letter]],
                "type": "log" if is_log else "linear",
                "range": [float(end) for end in (np.log10(limits) if is_log else limits)],
                "title": {"standoff": 4, "text": title},
                "automargin": True,
                "showline": True,
                "linecolor": "#888888",
                "gridcolor": "#E3E3E3",
                "zeroline": False,
                "showticklabels": _has_labels(axis),
            }
            | _matched(ax, letter, number, shown)
            | _ticks(axis)
        )
    return made


def _has_labels(axis: Any) -> bool:
    """Whether the ticks have numbers: the upper of two shared axes has none."""
    return any(label.get_visible() and label.get_text() for label in axis.get_ticklabels())


def _matched(ax: Axes, letter: str, number: int, shown: list[Axes]) -> dict[str, str]:
    """An axis that is shared with an earlier one zooms together with it."""
    shared = getattr(ax, f"get_shared_{letter}_axes")()
    for earlier, other in enumerate(shown[: number - 1], 1):
        if shared.joined(ax, other):
            return {"matches": f"{letter}{_suffix(earlier)}"}
    return {}


def _ticks(axis: Any) -> dict[str, Any]:
    """Names of categories; plotly places the ticks of numbers itself."""
    labels = [label.get_text() for label in axis.get_ticklabels()]
    if any(FORMULA in label for label in labels) or not any(char.isalpha() for char in "".join(labels)):
        return {}
    at = [float(place) for place in axis.get_ticklocs()]
    return {"tickvals": at, "ticktext": [_plain(label) for label in labels]}


# --- curves -----------------------------------------------------------------------------------------------


def _traces(ax: Axes, number: int, names: set[str]) -> Iterator[dict[str, Any]]:
    """Curves, points and areas, in the order in which they are drawn."""
    artists = [*ax.lines, *ax.collections, *ax.patches]
    for artist in sorted(artists, key=lambda one: one.get_zorder()):
        if not artist.get_visible() or _spans(ax, artist):
            continue
        drawn = _trace(ax, artist)
        if drawn is None:
            continue
        label = _plain(str(artist.get_label()))
        named = bool(label) and not label.startswith("_")
        yield drawn | {
            "xaxis": f"x{_suffix(number)}",
            "yaxis": f"y{_suffix(number)}",
            "name": label if named else "",
            "legendgroup": label if named else "",
            "showlegend": named and label not in names,
        }
        names.update([label] if named else [])


def _trace(ax: Axes, artist: Any) -> dict[str, Any] | None:
    if isinstance(artist, Line2D):
        return _curve(artist)
    if isinstance(artist, LineCollection):
        return _many_lines([np.asarray(path.vertices) for path in artist.get_paths()], artist)
    if isinstance(artist, PolyCollection):
        return _area([np.asarray(path.vertices) for path in artist.get_paths()], artist.get_facecolor())
    if isinstance(artist, PathCollection):
        x, y = np.asarray(artist.get_offsets()).T
        return _points(x, y) | {"marker": {"color": _colour(artist.get_facecolor())[0], "size": 5}}
    if isinstance(artist, StepPatch):
        return _many_lines([_vertices(artist)], artist, width=artist.get_linewidth())
    if isinstance(artist, Patch):
        corners = artist.get_patch_transform().transform(artist.get_path().vertices)
        return _area([corners], artist.get_facecolor())
    return None


def _curve(line: Line2D) -> dict[str, Any]:
    x, y = (np.asarray(line.get_data()[i], float) for i in (0, 1))
    marker, style = line.get_marker(), line.get_linestyle()
    has_line, has_marker = style in DASHES, marker in SYMBOLS
    colour = _colour(line.get_color(), line.get_alpha())[0]
    return _points(x, y) | {
        "mode": "+".join(word for word, on in (("lines", has_line), ("markers", has_marker)) if on) or "none",
        "line": {
            "color": colour,
            "width": line.get_linewidth() * PIXELS_PER_POINT,
            "dash": DASHES.get(style, "solid"),
        },
        "marker": {
            "color": _colour(line.get_markerfacecolor(), line.get_alpha())[0],
            "size": line.get_markersize() * PIXELS_PER_POINT,
            "symbol": SYMBOLS.get(marker, "circle"),
        },
        "connectgaps": False,
    }


def _many_lines(pieces: list[np.ndarray], artist: Any, width: float = 1.0) -> dict[str, Any]:
    colour = artist.get_edgecolor()
    x, y = _joined(pieces)
    line = {"color": _colour(colour)[0], "width": width * PIXELS_PER_POINT}
    return _points(x, y) | {"mode": "lines", "line": line}


def _area(pieces: list[np.ndarray], colour: Any) -> dict[str, Any]:
    x, y = _joined(pieces)
    return _points(x, y) | {
        "mode": "lines",
        "line": {"width": 0},
        "fill": "toself",
        "fillcolor": _colour(colour)[0],
        "hoverinfo": "skip",
    }


def _points(x: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    return {"type": "scatter", "mode": "markers", "x": _numbers(x), "y": _numbers(y)}


def _vertices(patch: StepPatch) -> np.ndarray:
    values, edges, _ = patch.get_data()
    return np.column_stack([np.repeat(edges, 2)[1:-1], np.repeat(values, 2)])


def _joined(pieces: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Several curves as one with gaps."""
    gap = np.full((1, 2), np.nan)
    parts = [part for piece in pieces for part in (piece, gap)][:-1]
    x, y = np.concatenate(parts or [gap]).T
    return x, y


def _numbers(values: np.ndarray) -> list[float | None]:
    return [float(f"{value:.7g}") if np.isfinite(value) else None for value in np.asarray(values, float)]


def _colour(colour: Any, alpha: float | None = None) -> tuple[str, float]:
    """A colour as CSS text, and its opacity; of several, the first."""
    several = np.asarray(colour)
    first = several[0] if several.ndim == 2 and len(several) else colour
    if isinstance(first, np.ndarray) and first.size == 0:
        return "rgba(0,0,0,0)", 0.0
    red, green, blue, own = to_rgba(first if len(several.shape) else str(colour), alpha)
    return f"rgba({round(255 * red)},{round(255 * green)},{round(255 * blue)},{own:.3g})", own


# --- lines and areas across the axes, texts ---------------------------------------------------------------


def _spans(ax: Axes, artist: Any) -> bool:
    """Whether an artist goes from edge to edge: its place along one axis is that of the axes."""
    across = (ax.get_xaxis_transform(which="grid"), ax.get_yaxis_transform(which="grid"))
    if isinstance(artist, Line2D):
        return artist.get_transform() in across
    return isinstance(artist, Patch) and any(
        artist.get_transform().contains_branch(one)
        and not artist.get_transform().contains_branch(ax.transData)
        for one in across
    )


def _lines_across(ax: Axes, number: int) -> Iterator[dict[str, Any]]:
    artists: list[Any] = [*ax.lines, *ax.patches]
    for artist in artists:
        if not artist.get_visible() or not _spans(ax, artist):
            continue
        is_line = isinstance(artist, Line2D)
        corners = (
            np.column_stack(artist.get_data())
            if is_line
            else artist.get_patch_transform().transform(artist.get_path().vertices)
        )
        (x0, y0), (x1, y1) = np.min(corners, axis=0), np.max(corners, axis=0)
        own = artist.get_transform()
        along_y = own.contains_branch(ax.get_xaxis_transform(which="grid"))
        refs = {
            "xref": f"x{_suffix(number)}" + ("" if along_y else " domain"),
            "yref": f"y{_suffix(number)}" + (" domain" if along_y else ""),
        }
        shape = {"x0": float(x0), "x1": float(x1), "y0": float(y0), "y1": float(y1), "layer": "below"} | refs
        if is_line:
            yield shape | {"type": "line", "line": {"color": _colour(artist.get_color())[0], "width": 1}}
        else:
            yield shape | {
                "type": "rect",
                "fillcolor": _colour(artist.get_facecolor())[0],
                "line": {"width": 0},
            }


def _title(ax: Axes, number: int) -> Iterator[dict[str, Any]]:
    text = ax.get_title(loc="left") or ax.get_title()
    if text:
        yield {
            "text": _plain(text),
            "xref": f"x{_suffix(number)} domain",
            "yref": f"y{_suffix(number)} domain",
            "x": 0,
            "y": 1,
            "xanchor": "left",
            "yanchor": "bottom",
            "align": "left",
            "font": {"size": TITLE_PIXELS},
            "showarrow": False,
        }


def _texts(ax: Axes, number: int) -> Iterator[dict[str, Any]]:
    for text in ax.texts:
        if text.get_visible() and text.get_text():
            yield _text(ax, text, number)


def _text(ax: Axes, text: Text, number: int) -> dict[str, Any]:
    """A text with its anchor at its place on the canvas, relative to the axes."""
    box = text.get_window_extent()
    horizontal, vertical = text.get_horizontalalignment(), VERTICAL[text.get_verticalalignment()]
    at = {"left": box.x0, "center": (box.x0 + box.x1) / 2, "right": box.x1}[horizontal]
    height = {"bottom": box.y0, "middle": (box.y0 + box.y1) / 2, "top": box.y1}[vertical]
    x, y = ax.transAxes.inverted().transform((at, height))
    return {
        "text": _plain(text.get_text()),
        "xref": f"x{_suffix(number)} domain",
        "yref": f"y{_suffix(number)} domain",
        "x": float(x),
        "y": float(y),
        "xanchor": horizontal,
        "yanchor": vertical,
        "showarrow": False,
        "font": {"size": text.get_fontsize() * PIXELS_PER_POINT, "color": _colour(text.get_color())[0]},
    }


def _plain(text: str) -> str:
    """Text of names from files as it stands: plotly takes some tags for markup."""
    escaped = text.replace(r"\$", "$").replace("&", "&amp;").replace("<", "&lt;")
    return escaped.replace("\n", "<br>")
