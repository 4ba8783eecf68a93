"""Shared style of the pictures: colours, axes, points, bands and texts."""

from __future__ import annotations

import contextlib
import contextvars
import functools
import io
import textwrap
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator, NullLocator

from gsid.base.extremes import extremes
from gsid.models.confidence import NORMAL_95

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf


# Colours of Okabe and Ito, which colour-blind readers can distinguish; each has one meaning in all pictures.
MEASURED = "#333333"
MODEL = "#0072B2"
NOISE = "#8A8A8A"
EXCESS = "#D55E00"
SIGNAL = "#0072B2"
EVEN = "#009E73"
KINDS = ("excited", "odd", "even")

STYLE = {
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # no ticks on top that a title would have to avoid, a tenth of the time to draw
    "axes.labelsize": 9.0,
    "axes.labelcolor": "#333333",
    "axes.edgecolor": "#888888",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.6,
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "lines.linewidth": 1.3,
    "lines.markersize": 2.4,
    "legend.fontsize": 8.5,
    "legend.frameon": True,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "legend.borderpad": 0.3,
    "svg.fonttype": "path",
    "svg.hashsalt": "gsid",
}
GRID_LINE = {"color": "#D0D0D0", "linewidth": 0.7, "zorder": 0.6}  # of the pole-zero map
GRID_TEXT = {"color": "#666666", "fontsize": 7.5, "zorder": 0.7}
WIDTH_IN = 9.0
NARROW_IN = 4.3  # on a telephone 9-point text of this width can be read
_width_in = contextvars.ContextVar("width of new figures [inch]", default=WIDTH_IN)
CHARACTERS_PER_INCH = 12.3  # of a title
RASTER_DPI = 160
NOTEBOOK_DPI = 100
_MANY_POINTS = 1200  # more than that are drawn as a bitmap inside the vector picture


# --- drawing helpers --------------------------------------------------------------------------------------


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    @functools.wraps(draw)
    def styled(*args, **kwargs) -> Figure:
        with matplotlib.rc_context(STYLE):
            figure = draw(*args, **kwargs)
            _wrap_titles(figure)
            return figure

    return styled


@contextlib.contextmanager
def narrow() -> Iterator[None]:
    """Draw figures for a narrow screen: less wide, with the same size of text."""
    token = _width_in.set(NARROW_IN)
    try:
        yield
    finally:
        _width_in.reset(token)


def is_narrow() -> bool:
    """Whether there is no room for axes side by side."""
    return _width_in.get() < WIDTH_IN


class Picture(Figure):
    """A figure whose axes can be unpacked, and which a notebook shows also without pyplot."""

    def __iter__(self) -> Iterator[Axes]:
        return iter(self.axes)

    def _repr_png_(self) -> bytes:
        image = io.BytesIO()
        with matplotlib.rc_context(STYLE):
            self.savefig(image, format="png", dpi=NOTEBOOK_DPI)
        return image.getvalue()


def new_figure(height_in: float) -> Figure:
    figure = Picture(figsize=(_width_in.get(), height_in), dpi=RASTER_DPI)
    FigureCanvasAgg(figure)
    return figure


def _wrap_titles(figure: Figure) -> None:
    """Break titles that are longer than the figure is wide."""
    most = int(CHARACTERS_PER_INCH * figure.get_figwidth())
    for ax in figure.axes:
        title = ax.get_title(loc="left")
        if len(title) > most:
            ax.set_title(textwrap.fill(title, most), loc="left")
    if len(figure.get_suptitle()) > most:
        figure.suptitle(textwrap.fill(figure.get_suptitle(), most), fontsize=9.5)


def db(x) -> np.ndarray:
    return 20.0 * np.log10(np.maximum(np.abs(x), np.finfo(float).tiny))


def plain_number(value: float, _position: int | None = None) -> str:
    return f"{value:g}"


def frequency_axis(ax: Axes, f_hz, *, label: bool = True) -> None:
    f_hz = np.asarray(f_hz, dtype=float)
    f_hz = f_hz[f_hz > 0.0]
    low, high = (f_hz.min(), f_hz.max()) if len(f_hz) else (1.0, 10.0)
    margin = max((high / low) ** 0.02, 1.01)
    ax.set_xscale("log")
    ax.set_xlim(low / margin, high * margin)
    fine = (
        (1.0, 2.0, 5.0) if high / low > 8.0 else tuple(np.arange(1.0, 10.0, 0.5 if high / low < 2.0 else 1.0))
    )
    ax.xaxis.set_major_locator(LogLocator(subs=fine, numticks=50))
    ax.xaxis.set_major_formatter(FuncFormatter(plain_number))
    ax.xaxis.set_minor_locator(NullLocator())  # not only unseen: a tick takes a millisecond to lay out
    if label:
        ax.set_xlabel("frequency [Hz]")
    else:
        ax.tick_params(axis="x", labelbottom=False)


def phase_axis(ax: Axes) -> None:
    low, high = ax.get_ylim()
    step = next(s for s in (15, 30, 45, 90, 180, 360, 720, 1440, 1e9) if (high - low) / s <= 8)
    ax.yaxis.set_major_locator(MultipleLocator(step))
    ax.set_ylabel("phase [deg]")


def per_unit(y_unit: str, u_unit: str) -> str:
    """Unit of y/u, for example (deg/s)/A."""
    if not y_unit and not u_unit:
        return ""
    top = f"({y_unit})" if "/" in y_unit else y_unit or "1"
    return f"{top}/({u_unit})" if "/" in u_unit else f"{top}/{u_unit or '1'}"


def db_label(what: str, unit: str) -> str:
    return f"{what} [dB re 1 {unit}]" if unit else f"{what} [dB]"


def with_unit(what: str, unit: str) -> str:
    """A label with its unit; a command in units of command needs none."""
    return f"{what} [{unit}]" if unit and unit != what else what


def plain_text(value: str) -> str:
    """Escape dollar signs of names and units from files, so that they do not start a formula."""
    return str(value).replace("$", r"\$")


def draw_points(ax: Axes, x, y, colour: str, label: str | None, **style) -> None:
    style = {"marker": "o", "markersize": 2.4, "markeredgewidth": 0.0} | style
    ax.plot(x, y, linestyle="none", color=colour, label=label, rasterized=len(x) > _MANY_POINTS, **style)


def draw_signal(ax: Axes, t_s, values, **style) -> None:
    """Draw samples over time: of long signals the extremes."""
    place, shown = extremes(np.asarray(values, dtype=float))
    ax.plot(np.asarray(t_s)[place], shown, **style)


def draw_error_bars(ax: Axes, x, low, high, label: str | None) -> None:
    """Draw all bars as one interrupted line, which makes an SVG ten times smaller than separate lines."""
    gap = np.full(len(x), np.nan)
    bars = np.column_stack([low, high, gap]).ravel()
    ax.plot(np.repeat(x, 3), bars, color=MEASURED, alpha=0.35, linewidth=0.8, label=label)


def shade_band(ax: Axes, f_lo: float, f_hi: float, label: str | None = None, colour: str = EXCESS) -> None:
    """Shade a band, with a minimum width, so that a band of one line is visible on a log axis."""
    ax.axvspan(f_lo / 1.006, f_hi * 1.006, color=colour, alpha=0.13, linewidth=0.0, label=label, zorder=0.5)


def limits_db(ax: Axes, *curves, room: float = 4.0) -> None:
    """Axis limits from the main curves, without isolated deep nulls."""
    values = np.concatenate([np.atleast_1d(np.asarray(c, dtype=float)) for c in curves])
    values = values[np.isfinite(values)]
    if len(values):
        low, high = np.percentile(values, 0.5), values.max()
        room = max(room, 0.06 * (high - low))
        ax.set_ylim(low - room, high + room)


def degrees_of_freedom(frf: Frf) -> float | np.ndarray | None:
    """Degrees of freedom of the variance at `line_mask`; None: the variance is assumed exact."""
    if frf.dof is not None:
        return np.minimum(frf.dof[line_mask(frf)], 1e9)
    return frf.n_dof if 0 < frf.n_dof < np.inf else None


def line_mask(frf: Frf) -> np.ndarray:
    return np.asarray(frf.f_hz) > 0.0


def delay_text(delay_s: float, fs_hz: float | None, std_s: float | None = None) -> str:
    """Delay in ms and in samples, for example "5.4000 ± 0.0040 ms (16.20 samples)"."""
    samples = f" ({delay_s * fs_hz:.2f} samples)" if fs_hz else ""
    return f"{with_interval(delay_s * 1e3, std_s * 1e3 if std_s else None)} ms{samples}"


def with_interval(value: float, std: float | None) -> str:
    """A value and half its 95 % interval, to two digits of the latter, for example "5.4003 ± 0.0016"."""
    if std is None or not np.isfinite(std) or std <= 0.0:
        return f"{value:.5g}".replace("-", "−")
    half = NORMAL_95 * std
    decimals = 1 - int(np.floor(np.log10(half)))
    if not -4 <= decimals <= 9:
        return f"{value:.6g} ± {half:.2g}".replace("-", "−")
    digits = decimals + (abs(value) < half)  # else 4.8 ± 170 is 0 ± 170
    value, half = round(value, digits), round(half, decimals)
    return f"{value:.{max(digits, 0)}f} ± {half:.{max(decimals, 0)}f}".replace("-", "−")


def order_text(model: RationalModel) -> str:
    """Order in the format of the command line: poles/zeros."""
    return f"{len(model.den) - 1}/{len(model.num) - 1}"


BOUND_OF_NOISE = "95 % noise bound"
LEGEND_WIDTH, SYMBOL = 150, 10  # characters of a line of a legend, and of the room for a symbol


def draw_error(ax: Axes, f, error, bound, label: str, bound_label: str = BOUND_OF_NOISE) -> None:
    """Error of every line, those above the bound in another colour."""
    above = error > bound
    ax.plot(f, db(bound), color=EXCESS, linewidth=1.0, label=bound_label)
    draw_points(ax, f[~above], db(error[~above]), MODEL, label)
    if above.any():
        draw_points(ax, f[above], db(error[above]), EXCESS, "above the bound", markersize=3.2)


def above_text(error, bound, right: str = "noise alone") -> str:
    """Number of lines above their bound, and the share expected from `right`, by default noise alone."""
    if not np.any(np.isfinite(bound)):
        return "the noise is unknown"
    above = error > bound
    share = 100.0 * np.mean(above)
    return f"{np.sum(above)} of {len(above)} lines above the bound ({share:.3g} %; {right}: 5 %)"


def legend_below(figure: FigureBase, axes: Sequence[Axes]) -> None:
    """One legend for all axes, outside them, each entry once."""
    entries = {
        label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        entries.values(),
        entries.keys(),
        loc="outside lower center",
        ncols=_columns_of_legend(list(entries)),
        fontsize=8.0,
        columnspacing=1.4,
        handletextpad=0.5,
    )


def _columns_of_legend(labels: Sequence[str]) -> int:
    """Most columns, at most 5, that fit into the width of a figure."""
    room = LEGEND_WIDTH * _width_in.get() / WIDTH_IN
    for n in range(min(len(labels), 5), 1, -1):
        columns = np.array_split(labels, n)  # as matplotlib splits them
        if sum(max(map(len, column)) + SYMBOL for column in columns) <= room:
            return n
    return 1


def band_text(f_lo_hz: float, f_hi_hz: float) -> str:
    """A band in Hz, for example "0.5 to 6 Hz"; one frequency when both ends are the same."""
    low, high = f"{f_lo_hz:.3g}", f"{f_hi_hz:.3g}"
    return f"{low} Hz" if low == high else f"{low} to {high} Hz"
