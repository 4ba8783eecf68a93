"""Orthogonal multisines for several inputs that are excited at once (EXC-13).

One realisation takes as many experiments as there are inputs. At each line its inputs are

    U = diag(A_1 e^(j a_1), ...) W diag(e^(j b_1), ...),   W_ie = e^(2 pi j i e / n)

with one row for each input and one column for each experiment. W is orthogonal, so that the experiments
separate the inputs with the least uncertainty. The phases a and b are independent from line to line and from
realisation to realisation. With b the distortions of different experiments are uncorrelated, although the
inputs of one realisation share their phases a.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import dft

from gsid.base.files import write_atomically
from gsid.excitation.multisine import Multisine
from gsid.spectrum.lines import period_of

INPUTS_MAX = 64


@dataclass(frozen=True, repr=False)
class OrthogonalMultisines:
    """Periods of orthogonal multisines.

    Attributes
    ----------
    fs_hz : float
    line : (F,) int
    periods : (M n_u, N, n_u) float64
        One period of each experiment; the n_u experiments of a realisation follow each other.
    n_realisations : int
    grid : str
    seed : int
    """

    fs_hz: float
    line: np.ndarray
    periods: np.ndarray
    n_realisations: int
    grid: str
    seed: int

    @property
    def n_inputs(self) -> int:
        """Number of inputs, n_u."""
        return self.periods.shape[2]

    @property
    def period_samples(self) -> int:
        """Number of samples of a period, N."""
        return self.periods.shape[1]

    @property
    def peak(self) -> np.ndarray:
        """(n_u,) largest magnitude of each input over all experiments."""
        return np.abs(self.periods).max(axis=(0, 1))

    @property
    def rms(self) -> np.ndarray:
        """(n_u,) root mean square of each input over all experiments."""
        return np.sqrt(np.mean(self.periods**2, axis=(0, 1)))

    def write(self, paths: Sequence[str | os.PathLike]) -> None:
        """Write one period of each experiment as CSV with the columns t_s, u1, u2, ...

        Parameters
        ----------
        paths : sequence of path_like
            One for each experiment.

        Raises
        ------
        OSError
            A file cannot be written.
        """
        names = ",".join(["t_s", *(f"u{i + 1}" for i in range(self.n_inputs))])
        keys = {"fs_hz": repr(self.fs_hz), "period_samples": self.period_samples, "hold": "zoh"}
        keys |= {"grid": self.grid, "seed": self.seed}
        for number, (path, u) in enumerate(zip(paths, self.periods, strict=True)):
            head = keys | {"realisation": number // self.n_inputs + 1}
            rows = (",".join(map(repr, [n / self.fs_hz, *row])) for n, row in enumerate(u.tolist()))
            lines = [*(f"# {key}: {value}" for key, value in head.items()), names, *rows]
            _write_lines(path, lines)

    def __repr__(self) -> str:
        f = self.line[[0, -1]] * self.fs_hz / self.period_samples
        return (
            f"OrthogonalMultisines({self.n_inputs} inputs, {len(self.line)} lines {f[0]:g} .. {f[1]:g} Hz, "
            f"{self.n_realisations} x {self.n_inputs} experiments)"
        )


def orthogonal_multisines(
    fs_hz: float,
    period_samples: int,
    band_hz: tuple[float, float],
    amplitude: Sequence[float],
    *,
    n_realisations: int = 1,
    grid: str = "full",
    seed: int = 0,
) -> OrthogonalMultisines:
    """Design orthogonal random-phase multisines.  Eq: EXC-13

    Parameters
    ----------
    fs_hz, period_samples, band_hz, grid
        As `Multisine.design`.
    amplitude : sequence of float
        Amplitude of each line of each input; its length is the number of inputs.
    n_realisations : int
        Realisations, M; each has as many experiments as inputs.
    seed : int
        Seed of the phases and of the grid "odd-random".

    Returns
    -------
    OrthogonalMultisines

    Raises
    ------
    ValueError
        As `Multisine.design`, or there is no input, an amplitude is not positive, or M is not positive.
    """
    size = np.asarray(amplitude, float)
    if size.ndim != 1 or not 0 < len(size) <= INPUTS_MAX or not np.all((size > 0) & (size < np.inf)):
        raise ValueError(f"amplitude must be 1 to {INPUTS_MAX} positive numbers, one for each input")
    if n_realisations < 1:
        raise ValueError(f"the number of realisations must be at least 1, not {n_realisations}")
    lines = Multisine.design(fs_hz, period_samples, band_hz, grid=grid, seed=seed).line
    n_u, n = len(size), int(period_samples)
    rng = np.random.default_rng(seed)
    of_input, of_experiment = np.exp(2j * np.pi * rng.random((2, n_realisations, n_u, len(lines))))
    u = np.zeros((n_realisations, n_u, n_u, n // 2 + 1), complex)  # realisation, experiment, input, line
    mixed = dft(n_u).conj()[:, :, None] * size[None, :, None]
    u[..., lines] = of_experiment[:, :, None] * mixed * of_input[:, None]
    periods = np.array([period_of(one, n) for one in u.reshape(-1, n // 2 + 1)])
    periods = np.swapaxes(periods.reshape(n_realisations * n_u, n_u, n), 1, 2)
    return OrthogonalMultisines(float(fs_hz), lines, periods, n_realisations, grid, seed)


def _write_lines(path: str | os.PathLike, lines: list[str]) -> None:
    write_atomically(path, lambda part: part.write_text("\n".join(lines) + "\n", encoding="utf-8"))
