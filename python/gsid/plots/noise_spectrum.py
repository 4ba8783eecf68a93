"""Picture of the noise of a record: its spectral density and its periodic disturbances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gsid.models.confidence import NORMAL_95
from gsid.plots.style import (
    EXCESS,
    MEASURED,
    NOISE,
    db_label,
    frequency_axis,
    new_figure,
    plain_text,
    styled,
    with_unit,
)

if TYPE_CHECKING:
    from gsid.spectrum.noise import Noise
    from gsid.spectrum.tones import Tone

LABELLED = 8  # disturbances with their name beside them


@styled
def noise(n: Noise) -> Figure:
    """Spectral density of the noise with its 95 % interval; below it, the periodic disturbances by name.

    Parameters
    ----------
    n : Noise

    Returns
    -------
    Figure
    """
    figure = new_figure(5.6 if n.tones else 3.9)
    axes = np.atleast_1d(figure.subplots(2 if n.tones else 1, 1))
    _draw_density(axes[0], n)
    if n.tones:
        _draw_tones(axes[1], n)
    for ax in axes:
        frequency_axis(ax, n.f_hz, label=ax is axes[-1])
    return figure


def _draw_density(ax: Axes, n: Noise) -> None:
    low, high = n.interval()
    ax.fill_between(
        n.f_hz, _db(low), _db(high), color=NOISE, alpha=0.3, linewidth=0.0, label="95 % interval, each line"
    )
    without = " without periodic disturbances" if n.tones else ""
    ax.plot(n.f_hz, _db(n.psd), color=MEASURED, linewidth=0.8, label=f"density{without}")
    for i, tone in enumerate(n.tones):
        label = "periodic disturbances" if i == 0 else None
        ax.axvline(tone.f_hz, color=EXCESS, linewidth=0.7, linestyle=":", label=label)
    unit = plain_text(n.y_unit)
    power_unit = (f"({unit})²" if "/" in unit else f"{unit}²") if unit else "1"
    ax.set_ylabel(db_label("density", f"{power_unit}/Hz"))
    what = f"mean period of {n.period_samples} samples" if n.period_samples else "trend"
    rms = f"{np.sqrt(n.variance):.3g} {unit}".strip()
    rest = f", {np.sqrt(n.variance_rest):.3g} without the disturbances" if n.tones else ""
    ax.set_title(
        f"Output minus its {what}: noise of {rms} rms{rest}; windows of {n.segment_samples / n.fs_hz:.3g} s"
    )
    ax.legend(loc="best")


def _draw_tones(ax: Axes, n: Noise) -> None:
    own = [tone for tone in n.tones if not tone.image_of_hz]
    images = [tone for tone in n.tones if tone.image_of_hz]
    rate = f"false-alarm rate {n.alpha:g}"
    _draw_bars(ax, own, "o", f"periodic disturbances ({len(own)}), 95 % interval; {rate}")
    if images:
        _draw_bars(
            ax, images, "x", f"their images at the refresh rate of {n.refresh_hz:.5g} Hz ({len(images)})"
        )
    for tone in own[:LABELLED]:
        ax.annotate(tone.name, (tone.f_hz, tone.amplitude), (5, 3), textcoords="offset points", fontsize=8.0)
    ax.set_ylim(0.0, 1.35 * max(tone.amplitude + NORMAL_95 * tone.std_amplitude for tone in n.tones))
    ax.set_ylabel(with_unit("amplitude", plain_text(n.y_unit)))
    ax.legend(loc="upper right")


def _draw_bars(ax: Axes, tones: Sequence[Tone], marker: str, label: str) -> None:
    ax.errorbar(
        [tone.f_hz for tone in tones],
        [tone.amplitude for tone in tones],
        [NORMAL_95 * tone.std_amplitude for tone in tones],
        fmt=marker,
        color=EXCESS,
        markersize=4.0,
        elinewidth=1.0,
        label=label,
    )


def _db(power: np.ndarray) -> np.ndarray:
    return 10.0 * np.log10(np.maximum(power, np.finfo(float).tiny))
