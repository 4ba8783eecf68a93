"""How much of a drop the catalogue leaves: it decides whether a hidden effect can be told from the others."""

from __future__ import annotations

import numpy as np
import truth
from hidden import CATALOGUE, Axis, Params, shapes_of_the_catalogue
from nulls import Bench, Nulls
from scipy.optimize import least_squares
from truth import TruthError

COGGING_STARTS = (20.0, 60.0)  # cycles per turn: a quarter and most of one in the travel


def drops_beside_each_other(traces: list[np.ndarray], slopes: np.ndarray) -> list[float]:
    """Of each effect, what is left of its drop when the null's parameters and the other effect are there."""
    drops = []
    for i, trace in enumerate(traces):
        others = np.column_stack([slopes, *[t for j, t in enumerate(traces) if j != i]])
        others = others / np.linalg.norm(others, axis=0)
        left = trace - others @ np.linalg.lstsq(others, trace, rcond=None)[0] if len(traces) > 1 else trace
        drops.append(float(left @ left))
    return drops


def unexplained_by_another(
    nulls: Nulls, trace: np.ndarray, bench: Bench, n_fit: int, axis: Axis, but: str = ""
) -> float:
    """What is left of a drop beside the best effect of the catalogue but one, taken as linear."""
    nulls.scale = np.ones(len(nulls.free))
    at = nulls.answer(nulls.scale)
    slopes = nulls.slopes(nulls.scale, at)
    left = []
    for effect, span in shapes_of_the_catalogue(axis):
        if effect == but:
            continue
        seen = []
        for extra in span:
            answers = bench.answers(nulls.base | extra, truth.COARSE, slice(n_fit))
            seen.append(nulls.whitened([y for y, *_ in answers]) - at)
        columns = np.column_stack([slopes, *seen])
        columns = columns / np.linalg.norm(columns, axis=0)
        rest = trace - columns @ np.linalg.lstsq(columns, trace, rcond=None)[0]
        left.append(rest @ rest)
    return float(min(left))


def unexplained_by_cogging(nulls: Nulls, params: Params, bench: Bench, n_fit: int) -> float:
    """What the best cogging leaves of a drop, fitted by simulation: whatever a fit leaves is an upper bound.

    At one number of cycles it passes for most laws of the angle, and as it takes the place of a part of the
    spring, it need not be small: of a cubic spring with an unbalance, drop 8601, it left 0.5 and not the 87
    that it leaves when taken as linear.
    """
    none = np.ones(len(nulls.free))

    def cogged(x: np.ndarray) -> Params:
        scaled = {name: nulls.base[name] * s for name, s in zip(nulls.free, x[:-3], strict=True)}
        wave = zip(CATALOGUE["motor_cogging"].values(), x[-3:], strict=True)
        return nulls.base | scaled | dict(wave)

    def answer(params: Params) -> np.ndarray:
        return nulls.whitened([y for y, *_ in bench.answers(params, truth.COARSE, slice(n_fit))])

    def slopes(x: np.ndarray) -> np.ndarray:
        here, scale = answer(cogged(x)), x[:-3]
        steps = 1e-3 * np.array([max(x[-3], 1e-3), x[-2], 1.0])
        waves = [
            (answer(cogged(x + step * unit)) - here) / step
            for step, unit in zip(steps, np.eye(len(x))[-3:], strict=True)
        ]
        return np.column_stack([nulls.slopes(scale, nulls.answer(scale)), *waves])

    def start(cycles: float) -> np.ndarray:
        """From cogging taken as linear."""
        small = 0.01
        waves = [answer(cogged([*none, small, cycles, phase])) - alone for phase in (0.0, np.pi / 2)]
        columns = np.column_stack([nulls.slopes(none, nulls.answer(none)), *waves])
        *moved, sine, cosine = np.linalg.lstsq(columns, target - alone, rcond=None)[0]
        wave = small * np.hypot(sine, cosine), cycles, np.arctan2(cosine, sine)
        return np.array([*np.maximum(none + moved, 1e-3), *wave])

    target, alone = answer(params), answer(nulls.base)
    left = [np.inf]
    for cycles in COGGING_STARTS:
        try:
            fit = least_squares(
                lambda x: answer(cogged(x)) - target,
                start(cycles),
                slopes,
                bounds=([*0 * none, 0.0, 1.0, -np.inf], np.inf),
                x_scale="jac",
                max_nfev=12,
            )
        except TruthError:
            continue  # not followed there: no bound
        left.append(2 * float(fit.cost))
    return min(left)
