"""The linear null of a trial, refitted to noise-free answers, and the bench that simulates the answers."""

from __future__ import annotations

import numpy as np
import truth
from hidden import FS_HZ, Params
from scipy.optimize import OptimizeResult, least_squares

N = 6000  # samples of a period
LINE_JUDGED = 400  # 200 Hz


def amplitudes(samples: np.ndarray) -> np.ndarray:
    """One-sided spectra in amplitudes of sines."""
    return np.fft.rfft(samples) * 2 / samples.shape[-1]


class Nulls:
    """The linear null, refitted to noise-free answers: what is left is what the hidden effect can bring."""

    def __init__(
        self, base: Params, lines: np.ndarray, commands: list[np.ndarray], s2: np.ndarray, n_periods: int
    ):
        self.base, self.lines = base, lines
        self.free = [name for name in base if name != "fs_hz"]
        self.scale = np.ones(len(self.free))  # of the last refit, where the next one begins
        self.u = np.array([amplitudes(u) for u in commands])
        self.weight = np.sqrt(2 * n_periods / s2)[:, 1 : LINE_JUDGED + 1]

    def answer(self, scale: np.ndarray) -> np.ndarray:
        """The whitened null with its parameters scaled."""
        params = self.base | {name: self.base[name] * s for name, s in zip(self.free, scale, strict=True)}
        y = np.zeros((len(self.u), LINE_JUDGED), complex)
        y[:, self.lines - 1] = self.u[:, self.lines] * truth.linear_response(params, self.lines * FS_HZ / N)
        return self._whitened(y)

    def _whitened(self, y: np.ndarray) -> np.ndarray:
        y = (self.weight * y).ravel()
        return np.concatenate([y.real, y.imag])

    def whitened(self, ys: list[np.ndarray]) -> np.ndarray:
        """Answers as one row of numbers whose noise has variance 1."""
        return self._whitened(np.array([amplitudes(y) for y in ys])[:, 1 : LINE_JUDGED + 1])

    def slopes(self, scale: np.ndarray, at: np.ndarray) -> np.ndarray:
        moved = scale + 1e-5 * np.eye(len(scale))
        return np.array([self.answer(m) - at for m in moved]).T / 1e-5

    def refit(self, ys: list[np.ndarray]) -> tuple[float, np.ndarray, np.ndarray]:
        """(drop, whitened residual, whitened slopes) of the best null, its parameters not negative."""
        target = self.whitened(ys)
        # From the truth too: a refit that once lost the resonance would not find it again.
        starts = np.maximum(self.scale, 1e-3), np.ones(len(self.free))
        tried = [self._refitted(target, start) for start in starts]
        best = min(tried, key=lambda one: one.cost)
        self.scale = best.x
        return 2 * float(best.cost), -best.fun, best.jac

    def _refitted(self, target: np.ndarray, start: np.ndarray) -> OptimizeResult:
        return least_squares(
            lambda scale: self.answer(scale) - target,
            start,
            lambda scale: self.slopes(scale, self.answer(scale)),
            bounds=(0, np.inf),
            x_scale="jac",
            ftol=1e-8,
            xtol=1e-10,
            max_nfev=60,
        )


class Bench:
    """The commands, and where each one's periodic answer was last found: the next is not far."""

    def __init__(self, commands: list[np.ndarray], tolerance: float):
        self.commands, self.tolerance = commands, tolerance
        self.starts: list[truth.Start | None] = [None] * len(commands)

    def answers(
        self, params: Params, n_steps: int, which: slice = slice(None)
    ) -> list[tuple[np.ndarray, ...]]:
        """(y, theta, rate) of each command in steady state."""
        found = []
        for i in range(len(self.commands))[which]:
            start = self.starts[i] or next(filter(None, self.starts), None)
            *signals, self.starts[i] = truth.steady(
                params, self.commands[i], tolerance=self.tolerance, start=start, n_steps=n_steps
            )
            found.append(tuple(signals))
        return found
