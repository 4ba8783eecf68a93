"""Starts of the linear part from the values of another stack, such as the one that `gsid.start` finds."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import permutations

import numpy as np

from gsid.diagnosis.missing_torque.problem import LinearPart, linear_kind

Stack = Mapping[str, Mapping[str, float]]

FARTHEST = 2.0  # share of the frequency within which a mode is the same: values may be 30 % off
MODES_MOST = 6  # of either stack that are matched: the pairs grow as the factorial


def with_values_of(part: LinearPart, stack: Stack) -> LinearPart:
    """A linear part with the values of another stack, where both have the same effects.

    Lags are matched by size, modes by frequency. A mode that has no partner within its limits keeps its
    values, as do fixed ones.

    Parameters
    ----------
    part : LinearPart
    stack : dict of dict of float
        {effect: {parameter: value}}.
    """
    apart = [*_of(part.stack, "lag"), *_of(part.stack, "mode")]
    matched = {label: label for label in part.stack if label in stack and label not in apart}
    matched |= _matched_lags(part.stack, stack) | _matched_modes(part, stack)
    values = part.values
    for i, name in enumerate(part.names):
        label, _, parameter = name.rpartition(".")
        if label in matched:
            other = dict(stack[matched[label]])
            values[i] = next(iter(other.values())) if len(other) == 1 else other[parameter]
    return part.at(np.clip(values, part.lower, part.upper))


def lacks(part: LinearPart, stack: Stack, effect: str) -> bool:
    """Whether another stack has one more effect of this kind than a linear part.

    Parameters
    ----------
    part : LinearPart
    stack : dict of dict of float
    effect : str
    """
    form = linear_kind(effect)
    return len(_of(stack, form)) > len(_of(part.stack, form))


def _of(stack: Stack, form: str) -> list[str]:
    """Labels of the effects of a kind."""
    return [label for label in stack if linear_kind(label) == form]


def _matched_lags(ours: Stack, theirs: Stack) -> dict[str, str]:
    """The longest with the longest: a lag of the motor and one of the sensor are the same function."""

    def by_size(stack: Stack) -> list[str]:
        return sorted(_of(stack, "lag"), key=lambda label: -next(iter(stack[label].values())))

    return dict(zip(by_size(ours), by_size(theirs), strict=False))


def _matched_modes(part: LinearPart, theirs: Stack) -> dict[str, str]:
    """Pairs of modes, as many as possible within their limits, with least differences of log frequency."""
    ours = part.stack
    mine, others = _of(ours, "mode")[:MODES_MOST], _of(theirs, "mode")[:MODES_MOST]
    if not mine or not others:
        return {}
    f_hz, other_hz = (
        np.array([s[label]["f_hz"] for label in labels]) for s, labels in ((ours, mine), (theirs, others))
    )
    gap = np.abs(np.subtract.outer(np.log(f_hz), np.log(other_hz)))
    limits = dict(zip(part.names, zip(part.lower, part.upper, strict=True), strict=True))
    fixed = [(f / FARTHEST, f * FARTHEST) for f in f_hz]
    ends = [limits.get(f"{label}.f_hz", one) for label, one in zip(mine, fixed, strict=True)]
    lower, upper = np.transpose(ends)
    is_out = (other_hz < lower[:, None]) | (other_hz > upper[:, None])
    gap[is_out] += 1 + len(mine) * np.max(gap)  # as many pairs within the limits as possible
    if len(mine) <= len(others):
        choices = [
            list(zip(range(len(mine)), p, strict=True)) for p in permutations(range(len(others)), len(mine))
        ]
    else:
        choices = [
            list(zip(p, range(len(others)), strict=True)) for p in permutations(range(len(mine)), len(others))
        ]
    best = min(choices, key=lambda pairs: sum(gap[i, j] for i, j in pairs))
    return {mine[i]: others[j] for i, j in best if not is_out[i, j]}
