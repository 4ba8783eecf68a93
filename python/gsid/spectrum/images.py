"""Images of a periodic disturbance behind a sensor that is refreshed more slowly than it is sampled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.spectrum.tones import BY_CHANCE, HARMONIC_STD, Tone

MOST = 20
"""Multiples of the refresh rate that are tried: the images of a held value fall with their inverse."""
NEAR_BINS = 0.1
"""Bins within which a frequency is that of an image in any case: the error of the refresh rate times MOST."""


def mark_images(tones: Sequence[Tone], refresh_hz: float, fs_hz: float, bin_hz: float) -> list[Tone]:
    """Mark the images of stronger disturbances (NOI-5).

    Parameters
    ----------
    tones : sequence of Tone
    refresh_hz : float
        Rate of the sensor [Hz]; 0: not known, and nothing is marked.
    fs_hz : float
        Sample rate [Hz].
    bin_hz : float
        Inverse of the record's length.
    """
    if not refresh_hz:
        return list(tones)
    bases = [tone for tone in tones if tone.f_hz < refresh_hz / 2 and tone.order == 1]
    return [_marked(tone, bases, refresh_hz, fs_hz, bin_hz) for tone in tones]


def _marked(tone: Tone, bases: Sequence[Tone], refresh_hz: float, fs_hz: float, bin_hz: float) -> Tone:
    if tone.f_hz < refresh_hz / 2:
        return tone
    sources = [
        base
        for base in bases
        if base.amplitude > tone.amplitude and _is_image(tone, base, refresh_hz, fs_hz, bin_hz)
    ]
    if not sources:
        return tone
    return replace(tone, image_of_hz=max(sources, key=lambda base: base.amplitude).f_hz)


def _is_image(tone: Tone, base: Tone, refresh_hz: float, fs_hz: float, bin_hz: float) -> bool:
    multiples = refresh_hz * np.arange(1, MOST + 1)
    f_hz = np.concatenate([multiples - base.f_hz, multiples + base.f_hz])
    f_hz = np.abs(f_hz - fs_hz * np.round(f_hz / fs_hz))  # sampled at fs
    error_hz = max(HARMONIC_STD * np.hypot(tone.std_f_hz, base.std_f_hz), NEAR_BINS * bin_hz)
    by_chance = 2 * error_hz * len(f_hz) / (fs_hz / 2)
    return by_chance < BY_CHANCE and bool(np.min(np.abs(f_hz - tone.f_hz)) < error_hz)
