"""Drifts and periodic disturbances, such as a fan: they are subtracted before the search for a law."""

from __future__ import annotations

import numpy as np

from gsid.diagnosis.from_records.ringing_lines import resonances
from gsid.diagnosis.from_records.run import Run
from gsid.spectrum.disturbances import find_disturbances, without_disturbances, without_lines_beside
from gsid.spectrum.drift import find_drift, without_drift
from gsid.spectrum.spectra import Spectra
from gsid.spectrum.tones import Tone

SHARP = 20.0  # time constants in a record: noise rings like a sine with a resonance that decays more slowly
NEAR = 0.35  # distance from a resonance over its frequency: that of a given model may be as far off


def subtract_disturbances(run: Run) -> None:
    """Subtract the sines between the lines, then drifts, whose bins the sines leak into.

    Parameters
    ----------
    run : Run
        With its linear stack, in an open loop.
    """
    if run.loop is not None or run.in_closed_loop or run.stack.has_controller:
        return
    _subtract_sines(run)
    _subtract_drifts(run)


def _subtract_sines(run: Run) -> None:
    """Subtract the sines between the lines, except near a sharp resonance, where noise rings like one.

    A fan runs in all records, though it may not show between the lines of each: the lines beside what two of
    them show are left out in all.
    """
    found = [[tone for tone in find_disturbances(one) if not _rings(run, one, tone)] for one in run.measured]
    if not any(found):
        return
    width_hz = run.measured[0].f_hz[1]
    shared = [tone for tones in found for tone in tones if _is_shared(tone, found, width_hz)]
    run.measured, run.judged = (
        [
            without_lines_beside(without_disturbances(one, tones), shared)
            for one, tones in zip(records, found, strict=True)
        ]
        for records in (run.measured, run.judged)
    )
    run.known_fits = {}
    run.notes.append(_note([tone for tones in found for tone in tones], run.measured[0]))


def _subtract_drifts(run: Run) -> None:
    """Subtract what the output drifts by from its first to its last sample."""
    drifts = [find_drift(one) for one in run.measured]
    if not any(drifts):
        return
    run.measured, run.judged = (
        [without_drift(one, drift) if drift else one for one, drift in zip(records, drifts, strict=True)]
        for records in (run.measured, run.judged)
    )
    run.known_fits = {}
    largest, one = max(zip(drifts, run.measured, strict=True), key=lambda each: abs(each[0]))
    each_s = f"{largest * one.f_hz[1]:.2g} {one.y_unit}".rstrip()
    some = f"in {np.count_nonzero(drifts)} of {len(drifts)} records, " if len(drifts) > 1 else ""
    run.notes.append(f"The output drifts ({some}by up to {each_s} a second); the drift is subtracted.")


def _is_shared(tone: Tone, found: list[list[Tone]], width_hz: float) -> bool:
    """Whether two records show it: one alone may show a peak of the noise."""
    shown = [any(abs(tone.f_hz - other.f_hz) < width_hz for other in tones) for tones in found]
    return sum(shown) > 1


def _rings(run: Run, one: Spectra, tone: Tone) -> bool:
    record_s = one.n_periods * one.period_samples / one.fs_hz
    return any(
        decay_per_s * record_s < SHARP and abs(tone.f_hz - f_hz) < max(NEAR * f_hz, one.f_hz[1])
        for f_hz, decay_per_s in resonances(run.stack.stack())
    )


def _note(tones: list[Tone], one: Spectra) -> str:
    """The largest of each frequency; two within a line are one."""
    largest: list[Tone] = []
    for tone in sorted(tones, key=lambda each: -each.amplitude):
        if all(abs(tone.f_hz - other.f_hz) > one.f_hz[1] for other in largest):
            largest.append(tone)
    named = ", ".join(
        f"{tone.f_hz:.4g} Hz ({tone.amplitude:.2g} {one.y_unit}".rstrip() + ")" for tone in largest
    )
    what = "A periodic disturbance" if len(largest) == 1 else "Periodic disturbances"
    verb = "is" if len(largest) == 1 else "are"
    return f"{what} of {named} {verb} subtracted; the lines on both sides are left out."
