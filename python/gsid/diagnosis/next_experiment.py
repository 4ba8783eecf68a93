"""Choose an experiment that distinguishes two effects, by simulating both fitted models for several commands.

The expected difference of their costs is the squared distance of their outputs in units of the noise. The
part that the free parameters of one model can imitate is projected out (after the T-criterion of Atkinson
and Fedorov; DIA-6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gsid.base.deadline import Deadline
from gsid.base.errors import GsidError
from gsid.excitation.periodic import write_period
from gsid.plant.model import PlantModel
from gsid.plant.periodic import PeriodicPlant, input_period
from gsid.spectrum.lines import lines_of
from gsid.spectrum.spectra import Spectra

ENOUGH = 10.0  # expected difference in cost that distinguishes two effects
ROUNDING = 1e-12  # of the largest line of the output: the noise of a record without any
MOST_PERIODS = 10.0  # of an experiment that is advised, in periods measured


@dataclass(frozen=True, eq=False)
class Experiment:
    """One entry of the menu.

    Parameters
    ----------
    words : str
    separation : float
        Expected difference in cost between the rivals, with the periods and the noise of the record given.
    peak, travel : float
        Largest command, and travel from end to end of the first rival, in the unit of its angle.
    fs_hz : float
        Sample rate [Hz].
    command, first, second : (N,) ndarray
        One period of the command, and the outputs of both models.
    """

    words: str
    separation: float
    peak: float
    travel: float
    fs_hz: float
    command: np.ndarray = field(repr=False)
    first: np.ndarray = field(repr=False)
    second: np.ndarray = field(repr=False)

    def save(self, path: str | Path) -> None:
        """Write one period of the command as CSV, for `gsid run --u`.

        Parameters
        ----------
        path : path
        """
        write_period(path, self.command, self.fs_hz, {"experiment": self.words})


def menu(u: np.ndarray, limit: float) -> list[tuple[str, np.ndarray]]:
    """Candidate commands of the next experiment, as variations of the present command.

    Parameters
    ----------
    u : (N,) ndarray
        One period of the command.
    limit : float
        Largest allowed command; experiments with larger commands are left out.

    Returns
    -------
    list of (words, (N,) ndarray)
    """
    peak, spectrum = float(np.max(np.abs(u))), np.fft.rfft(u)
    low = np.where(np.arange(len(spectrum)) <= len(spectrum) // 100, spectrum, 0)
    slow = np.fft.irfft(low, len(u))
    slow = slow * peak / max(float(np.max(np.abs(slow))), np.finfo(float).tiny)
    commands = [
        ("the same excitation once more", u),
        ("the same excitation at a tenth of the amplitude", 0.1 * u),
        ("the same excitation at a third of the amplitude", u / 3),
        ("the same excitation at twice the amplitude", 2 * u),
        ("the lowest lines only, at the same peak", slow),
        ("the same excitation with a constant command of half its peak added", u + 0.5 * peak),
        ("the lowest lines only, with a constant command of half its peak added", slow + 0.5 * peak),
    ]
    return [(words, command) for words, command in commands if np.max(np.abs(command)) <= limit]


def next_experiment(
    first: PlantModel,
    second: PlantModel,
    measured: Spectra,
    *,
    limit: float = np.inf,
    deadline: Deadline | None = None,
) -> list[Experiment]:
    """Rank the menu by how well each experiment distinguishes two fitted models.

    Parameters
    ----------
    first, second : PlantModel
    measured : Spectra
        Provides the excitation, the number of periods, and the noise.
    limit : float
        Largest command allowed.
    deadline : Deadline, optional
        Time at which the search ends with the experiments so far.

    Returns
    -------
    list of Experiment
        Best first; experiments that cannot be simulated are left out.
    """
    u = input_period(measured, 1)
    lines = np.flatnonzero(measured.excited)
    use = np.arange(max(lines[0], 1), lines[-1] + 1)
    rounding = (ROUNDING * np.max(np.abs(measured.y))) ** 2
    weight = np.sqrt(2 * measured.n_periods / np.maximum(measured.var_y[use], rounding))
    ranked = []
    for words, command in menu(u, limit):
        if deadline is not None and deadline.is_over:
            break
        try:
            one = PeriodicPlant(first, command, measured.fs_hz).run(sensitivities=True)
            other = PeriodicPlant(second, command, measured.fs_hz).run()
        except GsidError:
            continue
        difference = _whiten((lines_of(one.y) - lines_of(other.y))[use] * weight)
        nuisance = orthonormal(_whiten(one.dY[:, use] * weight).T)
        left = project_out(nuisance, difference[:, None])[:, 0]
        peak, travel = float(np.max(np.abs(command))), float(np.ptp(one.angle))
        outputs = (measured.fs_hz, command, one.y, other.y)
        ranked.append(Experiment(words, float(left @ left), peak, travel, *outputs))
    return sorted(ranked, key=lambda experiment: -experiment.separation)


def advice(
    first: PlantModel,
    second: PlantModel,
    measured: Spectra,
    names: tuple[str, str],
    deadline: Deadline | None = None,
) -> str:
    """Describe the best experiment of the menu, with its command and travel, to be checked against the rig.

    Empty if the time is over before the menu was tried.

    Parameters
    ----------
    first, second, measured
        As for `next_experiment`.
    names : (str, str)
        Names of the two effects.
    deadline : Deadline, optional
    """
    ranked, n_periods = next_experiment(first, second, measured, deadline=deadline), measured.n_periods
    if deadline is not None and deadline.is_over:
        return ""
    least = ENOUGH / MOST_PERIODS  # over as many periods as measured
    if not ranked or ranked[0].separation < least:
        return f"No experiment of the menu distinguishes {names[0]} from {names[1]} at this noise level."
    best = ranked[0]
    expected = best.separation
    if expected < ENOUGH:  # it grows with the number of periods
        n_periods, expected = math.ceil(n_periods * ENOUGH / expected), ENOUGH
    return (
        f"To distinguish {names[0]} from {names[1]}: {best.words} (command up to {best.peak:.3g}, travel of "
        f"{best.travel:.3g} {first.angle_unit}; expected difference in cost {expected:.0f} over "
        f"{n_periods} periods)."
    )


def _whiten(lines: np.ndarray) -> np.ndarray:
    return np.concatenate([lines.real, lines.imag], axis=-1)


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the span of columns. They are scaled to unit length; dependent ones are dropped.

    Parameters
    ----------
    columns : (n, p) ndarray

    Returns
    -------
    (n, <= p) ndarray
    """
    length = np.linalg.norm(columns, axis=0)
    scaled = columns[:, length > 0] / length[length > 0]
    if scaled.shape[1] == 0:
        return np.empty((len(columns), 0))
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return u[:, s > 1e-9 * s[0]]


def project_out(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Part of the columns orthogonal to an orthonormal basis; projected twice to remove rounding errors."""
    once = columns - basis @ (basis.T @ columns)
    return once - basis @ (basis.T @ once)
