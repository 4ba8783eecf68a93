"""Fits by simulation, judged with the weights of what the best of them leaves.

The weights of noise put everything on the lines where the output is largest, as soon as the model's error is
larger than noise. As in the first stage, a white torque of the power that the best law leaves is then added
to the variance of the noise. Shares and margins refer to all that is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.diagnosis.from_records.confirm import Simulated, judged, mean_square
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.missing_torque.problem import torque_power
from gsid.greybox.fit import RecordFit


def weighed(
    null: Simulated, laws: Sequence[Simulated], best: Simulated, settings: DecisionSettings
) -> tuple[Simulated, list[Simulated]]:
    """The linear part and the laws with these weights.

    Parameters
    ----------
    null : Simulated
    laws : sequence of Simulated
    best : Simulated
        Gives the weights.
    settings : DecisionSettings
    """
    factors = [_factor(best, one) for one in best.fit.records]

    def again(one: Simulated) -> Simulated:
        found = judged(one.fit, one.effects, settings, factors)
        found = replace(found, converged=one.converged, stalled=one.stalled)
        return found if one.left_out is None else _by_refits(one, found, factors)

    return again(null), [again(one) for one in laws]


def _by_refits(one: Simulated, found: Simulated, factors: Sequence[np.ndarray]) -> Simulated:
    """A fit whose cost has steps: its errors with the weights, not linearised."""
    left = tuple(factor * error for factor, error in zip(factors, one.left_out, strict=True))
    here = [factor * record.residual for factor, record in zip(factors, one.fit.records, strict=True)]
    cost = float(np.sum(np.concatenate(here) ** 2))
    return replace(found, kept=mean_square(left), left_out=left, weighed=cost)


def _factor(best: Simulated, one: RecordFit) -> np.ndarray:
    """(2 k,) ratio of the weights with and without the torque that is left."""
    entry = np.abs(best.model.linear_response(one.spectra, one.line).torque) ** 2
    noise = 2 / one.weight**2
    error = np.sum(one.residual.reshape(2, -1) ** 2, axis=0) / one.weight**2
    power = torque_power(error, noise, entry)
    return np.tile(np.sqrt(noise / (noise + power * entry)), 2)
