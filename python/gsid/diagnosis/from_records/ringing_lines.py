"""Lines on which noise rings with a narrow resonance of the axis: they are left out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from gsid.base.deadline import OutOfTime
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.missing_torque.problem import linear_kind
from gsid.greybox.fit import CANNOT_FIT
from gsid.greybox.weights import pooled_variance
from gsid.spectrum.ringing import noise_ratio
from gsid.spectrum.spectra import Spectra
from gsid.structure.start import start

SLOWEST = 1e-9  # decay of a resonance without damping, in 1/s

Stack = Mapping[str, Mapping[str, float]]


def leave_out_ringing_lines(run: Run) -> bool:
    """Leave out lines whose noise FRF-6 does not show, where the draft leaves more than noise.

    A linear part that lacks damping has too sharp a resonance: what counts is that of the linear structure.

    Parameters
    ----------
    run : Run
        With its draft.

    Returns
    -------
    bool
        Whether a line was left out, so that the draft has to be made again.
    """
    if run.loop is not None or run.stack.has_controller or run.draft.stage.conclusion.kind == "none":
        return False
    if not any(mask.any() for mask in _ringing(run, run.draft.stage.linear)):
        return False
    masks = _ringing(run, _structure(run))
    if not any(mask.any() for mask in masks):
        return False
    run.measured, run.judged = (
        [_leave_out(one, mask) for one, mask in zip(records, masks, strict=True)]
        for records in (run.measured, run.judged)
    )
    run.known_fits = {}
    run.notes.append(_note(run.measured, masks))
    return True


def _leave_out(one: Spectra, mask: np.ndarray) -> Spectra:
    return replace(one, left_out=mask if one.left_out is None else mask | one.left_out)


def _note(measured: list[Spectra], masks: list[np.ndarray]) -> str:
    f_hz = sorted({float(f) for one, mask in zip(measured, masks, strict=True) for f in one.f_hz[mask]})
    where = ", ".join(f"{f:.4g}" for f in f_hz)
    lines = f"The line at {where} Hz is" if len(f_hz) == 1 else f"The lines at {where} Hz are"
    why = "noise rings there with a narrow resonance of the axis, and its size is not known"
    return f"{lines} left out: {why}."


def _structure(run: Run) -> Stack:
    """The linear structure that the data show; empty where there is none."""
    found = run.start
    if found is None:
        try:
            found = start(run.measured, output=run.stack.output, band=run.band, deadline=run.deadline)
        except (*CANNOT_FIT, OutOfTime):
            return {}
    return found.effects if found.has_model else {}


def _ringing(run: Run, stack: Stack) -> list[np.ndarray]:
    """Lines of each record on which the noise may be many times what the fits take for it, (K,) bool.

    They take the mean over neighbouring lines. Where the noise between the lines has the peak of the
    resonance, it is above that mean, and the noise of the line is still above the noise between the lines.
    """
    taken = pooled_variance(run.measured)
    return [
        _rings(one, variance, stack, run.settings)
        for one, (variance, _) in zip(run.measured, taken, strict=True)
    ]


def _rings(one: Spectra, variance: np.ndarray, stack: Stack, settings: DecisionSettings) -> np.ndarray:
    found = np.zeros(len(one.line), bool)
    if one.n_periods < 2 or one.n_spoiled:  # its noise is not that between the lines
        return found
    for f_hz, decay_per_s in resonances(stack):
        near = np.flatnonzero(np.abs(one.f_hz - f_hz) < one.f_hz[1])
        over_between = noise_ratio(one, near, f_hz, max(decay_per_s, SLOWEST))
        peak = one.noise_y[near] / np.maximum(variance[near], np.finfo(float).tiny)
        found[near] |= over_between * np.maximum(peak, 1.0) > settings.ringing
    stays = one.excited & ~found if one.left_out is None else one.excited & ~found & ~one.left_out
    return found if np.any(stays) else np.zeros_like(found)


def resonances(stack: Stack) -> Iterator[tuple[float, float]]:
    """Frequency [Hz] and decay [1/s] of the sprung body and of each mode.

    Parameters
    ----------
    stack : dict of dict of float
    """
    stiffness = damping = 0.0
    for label, params in stack.items():
        kind = linear_kind(label)
        first = next(iter(params.values()), 0.0)
        if kind == "spring":
            stiffness += first
        elif kind == "damping":
            damping += first
        elif kind == "mode":
            yield params["f_hz"], 2 * math.pi * params["f_hz"] * params["zeta"]
    if stiffness > 0 and 0.5 * damping < math.sqrt(stiffness):
        yield math.sqrt(stiffness) / (2 * math.pi), 0.5 * damping
