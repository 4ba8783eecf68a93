"""The older tests for nonlinearity (source, 5.2): two amplitudes side by side, the harmonics of a sine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import f as f_distribution

from gsid.errors import InputError

if TYPE_CHECKING:
    import matplotlib.figure

    from gsid.distortion import Distortion

SUPERPOSITION_ALARM = 0.01


@dataclass(repr=False)
class Superposition:
    """Responses at two input levels: on a linear axis they are one (source, eq. 5.2).

    Attributes
    ----------
    line : (F,) int
        Lines excited at both levels.
    f_hz : (F,) [Hz]
    level_ratio : float
        Input of the second measurement over that of the first, rms.
    change : (F,) complex
        Second response minus first.
    change_db, change_deg : (F,)
        Change of gain and phase.
    std : (F,)
        Standard deviation of `change`; with several realisations their scatter counts too.
    n_dof : int
        Complex degrees of freedom of `std`, at least.
    p_value : float
        Probability of changes this large on a linear axis, all lines together.
    first, second : Distortion
    """

    line: np.ndarray
    f_hz: np.ndarray
    level_ratio: float
    change: np.ndarray
    change_db: np.ndarray
    change_deg: np.ndarray
    std: np.ndarray
    n_dof: int
    p_value: float
    first: Distortion
    second: Distortion

    @property
    def sentence(self) -> str:
        """What the two levels say, in words."""
        ratio = f"At {self.level_ratio:.3g} times the input"
        if self.p_value > SUPERPOSITION_ALARM:
            return f"{ratio} the response is the same within its scatter (p = {self.p_value:.2g})."
        worst = int(np.argmax(np.abs(self.change) / self.std))
        return (
            f"{ratio} the response changes (p = {self.p_value:.2g}): by {self.change_db[worst]:+.2f} dB and "
            f"{self.change_deg[worst]:+.1f} deg at {self.f_hz[worst]:.3g} Hz, where it is clearest."
        )

    def plot(self) -> matplotlib.figure.Figure:
        """Both responses and their change beside its scatter."""
        from gsid import plots

        return plots.superposition(self)

    def __repr__(self) -> str:
        return f"Superposition({len(self.line)} lines; {self.sentence})"


def superposition(first: Distortion, second: Distortion) -> Superposition:
    """Compare the responses at two input levels.

    Parameters
    ----------
    first, second : Distortion
        Of one axis, at different levels.

    Returns
    -------
    Superposition

    Raises
    ------
    InputError
        No common line, or the same level twice.
    """
    if (first.fs_hz, first.period_samples) != (second.fs_hz, second.period_samples):
        what = "the two levels were measured with different periods or rates"
        raise InputError(what, second.name, None, "measure both with the same period")
    line, a, b = np.intersect1d(first.line, second.line, return_indices=True)
    if not len(line):
        raise InputError("no line is excited at both levels", second.name, None, "excite the same lines")
    level_ratio = float(np.sqrt(np.sum(second.u[b] ** 2) / np.sum(first.u[a] ** 2)))
    variance = _variance(first)[a] + _variance(second)[b]
    change = second.bla[b] - first.bla[a]
    turn = second.bla[b] / first.bla[a]
    # the mean over n lines of |change|^2 / variance: F(2 n, 2 n nu) to good approximation
    nu = min(_degrees(first), _degrees(second))
    statistic = float(np.mean(np.abs(change) ** 2 / variance))
    return Superposition(
        line=line,
        f_hz=first.f_hz[a],
        level_ratio=level_ratio,
        change=change,
        change_db=20 * np.log10(np.abs(turn)),
        change_deg=np.degrees(np.angle(turn)),
        std=np.sqrt(variance),
        n_dof=nu,
        p_value=float(f_distribution.sf(statistic, 2 * len(line), 2 * len(line) * nu)),
        first=first,
        second=second,
    )


def _variance(d: Distortion) -> np.ndarray:
    return d.var_total if d.n_realisations > 1 else d.var_noise


def _degrees(d: Distortion) -> int:
    return d.n_realisations - 1 if d.n_realisations > 1 else d.n_periods - 1


@dataclass(frozen=True)
class Harmonic:
    """A multiple of the frequency of a sine, in the output.

    Attributes
    ----------
    order : int
    f_hz : float
    level, noise : float
        Amplitude, and the standard deviation that noise alone leaves of it, unit of y.
    below_fundamental_db, above_noise_db : float
    """

    order: int
    f_hz: float
    level: float
    noise: float
    below_fundamental_db: float
    above_noise_db: float


def harmonics(d: Distortion) -> list[Harmonic]:
    """List the harmonics of a record whose input is one sine (source, section 5.2).

    Parameters
    ----------
    d : Distortion
        With one excited line.

    Returns
    -------
    list of Harmonic
        From order 2 on.

    Raises
    ------
    ValueError
        More than one line is excited.
    """
    if len(d.line) != 1:
        raise ValueError(f"{len(d.line)} lines are excited: harmonics belong to one sine")
    fundamental = float(np.abs(d.bla[0]) * d.u[0])
    found = []
    for i in np.flatnonzero(d.free_order >= 2):
        level, noise = float(d.level[i]), float(d.level_noise[i])
        with np.errstate(divide="ignore"):
            below, above = 20 * np.log10([fundamental / level, level / noise])
        found.append(
            Harmonic(int(d.free_order[i]), float(d.free_f_hz[i]), level, noise, float(below), float(above))
        )
    return found
