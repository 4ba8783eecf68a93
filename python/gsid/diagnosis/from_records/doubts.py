"""Doubts about a law that is far better than nothing: one line, the same response in all records, the error
of a simulation, a mode without resonance, a limit of shapes.

A disturbance at a fixed frequency, such as a fan, leaves one line that is no noise, and a narrow mode fits
it in some of the records. A mode far above the band, or heavily damped, is a lag or a delay to the data.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.from_records.law_part import label_of
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.from_records.simulation_error import simulation_error
from gsid.diagnosis.missing_torque.catalogue import LINEAR_KINDS
from gsid.diagnosis.missing_torque.linear_fit import basis
from gsid.effects.types import find
from gsid.greybox.fit import PlantFit, RecordFit
from gsid.plant.effect import Param
from gsid.plant.model import PlantModel

F_STEP_HZ = 1e-6  # lines of different records that are nearer are the same
FOLLOWED = 1e-9  # share of an error that is left where the parameters follow it
INPUTS_DIFFER = 0.01  # share of the power of several inputs that is not in their mean


def doubts(null: PlantFit, fit: PlantFit, effect: str, settings: DecisionSettings) -> list[str]:
    """What speaks against naming a law, one sentence each.

    Parameters
    ----------
    null, fit : PlantFit
        To the same records, without and with the law.
    effect : str
        The law.
    settings : DecisionSettings
    """
    found, line = [], strongest_line(null, fit)
    if line.elsewhere < settings.linear_drop and line.may_be_disturbance(effect, settings):
        found.append(
            f"What {effect} explains is on one line, {line.f_hz:.4g} Hz, where it leaves {line.after:.3g} of"
            f" {line.before:.3g} in {line.n_records} records; a disturbance of that frequency does the same."
        )
    if not is_linear(effect) and explains_linear_response(null, fit, settings):
        found.append(
            f"What {effect} explains is the same response to the input in all records, as that of a linear"
            " effect that the model lacks."
        )
    fall, error = null.cost - fit.cost, simulation_error(null)
    if fall < error + 2 * settings.significant * math.sqrt(error):  # beside noise
        found.append(
            f"{effect} lowers the cost by {fall:.3g}, of which {error:.3g} may be the error of simulating an"
            " input that is not held."
        )
    if find(effect).linear_part == "mode" and not adds_resonance(null, fit, settings):
        found.append(
            f"With {effect} the model has no further resonance that the data resolve within"
            f" {fit.band_hz[0]:.4g} to {fit.band_hz[1]:.4g} Hz: a lag or a delay may do the same."
        )
    found += [
        f"The data do not determine {name} ({param.value:.2g} +- {_std(param):.2g}):"
        " at a limit of its shapes a law may be another one."
        for name, param in _undetermined(fit, effect, settings).items()
    ]
    return found


@dataclass(frozen=True)
class StrongestLine:
    """The line that has most of what a law explains, in all records that have it.

    Attributes
    ----------
    f_hz : float
    before, after : float
        By how much the cost is lower for a fit to the other lines, without and with the law (DIA-17).
    n_records, n_lines : int
        That have it, and their lines there: records of other periods may have several.
    elsewhere : float
        Fall of the cost by the law, if both fits are to the other lines.
    """

    f_hz: float
    before: float
    after: float
    n_records: int
    n_lines: int
    elsewhere: float

    def may_be_disturbance(self, effect: str, settings: DecisionSettings) -> bool:
        """Whether the line is not explained in all records, or in so few that any law could: a law answers
        to the command of each. A linear effect of one parameter is no chance if line and rest agree on it;
        the rate of a held sensor is searched, as the step of a rounding, and may follow a disturbance.

        Parameters
        ----------
        effect : str
            The law.
        settings : DecisionSettings
        """
        n, n_parameters = 2 * self.n_lines, len(find(effect).parameters)
        if float(special.chdtrc(n, self.after)) < settings.p_left:
            return True
        if (
            n_parameters == 1
            and find(effect).linear_part in LINEAR_KINDS
            and self.p_of_disturbance() < settings.p_left
        ):
            return False
        return self.n_records < 2 or n - n_parameters < settings.spare

    def p_of_disturbance(self) -> float:
        """p-value of an effect of one parameter if there is only a disturbance on the line, of any phase.

        The effect explains what has its phase, and of the other lines what chance does (DIA-17). It leaves
        the noise at least.
        """
        n = 2 * self.n_lines
        left = max(self.after, n - 1)
        on_line = float(special.betainc((n - 1) / 2, 0.5, min(left / max(self.before, left), 1.0)))
        both = on_line * float(special.chdtrc(1, max(self.elsewhere, 0.0)))
        return float(special.chdtrc(4, -2 * math.log(both))) if both > 0 else 0.0


def strongest_line(null: PlantFit, fit: PlantFit) -> StrongestLine:
    """The line that has most of what a law explains.

    Parameters
    ----------
    null, fit : PlantFit
        To the same records, without and with the law.
    """
    spacing_hz = max(one.spectra.f_hz[1] - one.spectra.f_hz[0] for one in fit.records)
    lines = [np.rint(one.spectra.f_hz[one.line] / spacing_hz).astype(int) for one in fit.records]
    number, line, n_lines = np.unique(np.concatenate(lines), return_inverse=True, return_counts=True)
    (whole, before), (whole_after, after) = (_cost_by_line(each, line) for each in (null, fit))
    i = int(np.argmax(before - after))
    elsewhere = float((whole - before[i]) - (whole_after - after[i]))
    n_records = sum(number[i] in one for one in lines)
    counts = n_records, int(n_lines[i])
    return StrongestLine(float(number[i] * spacing_hz), float(before[i]), float(after[i]), *counts, elsewhere)


def _cost_by_line(fit: PlantFit, line: np.ndarray) -> tuple[float, np.ndarray]:
    """Cost of a fit, and by how much it is lower for a fit to all lines but one (DIA-17).

    The parameters follow a disturbance on one line, at the cost of all others: the cost on the line itself
    is no measure of it.

    Parameters
    ----------
    fit : PlantFit
    line : (m,) int
        Which of the different lines each one is, in the order of the records.
    """
    known = basis(fit.jacobian)
    error = fit.residual - known @ (known.T @ fit.residual)
    counts = np.bincount(line)
    lower, rows = np.zeros(len(counts)), np.split(np.argsort(line), np.cumsum(counts)[:-1])
    for n in np.unique(counts):  # all lines at a time that as many records have
        chosen = np.flatnonzero(counts == n)
        at = np.stack([np.concatenate([rows[i], rows[i] + len(line)]) for i in chosen])
        e, q = error[at], known[at]
        free = np.eye(2 * n) - q @ np.swapaxes(q, 1, 2)  # what the parameters cannot follow
        solved = np.linalg.pinv(free, rcond=FOLLOWED, hermitian=True) @ e[:, :, None]
        lower[chosen] = np.sum(e * solved[:, :, 0], axis=1)
    return float(error @ error), lower


def explains_linear_response(null: PlantFit, fit: PlantFit, settings: DecisionSettings) -> bool:
    """Whether a change of the linear response explains what a law explains, or all but a small share of it.

    Any change of the response is taken from each fit, on the lines that several records excite (DIA-15).

    Parameters
    ----------
    null, fit : PlantFit
        To the same records.
    settings : DecisionSettings
    """
    fall = _cost_beside_response(null) - _cost_beside_response(fit)
    return fall < max(settings.worse, settings.nonlinear_share * (null.cost - fit.cost))


def _cost_beside_response(fit: PlantFit) -> float:
    """Cost beside any change of the response to the input, on lines that several records excite.

    Records with one and the same input are one: they do not tell a response from a distortion.
    """
    parts = [_on_excited_lines(one) for one in fit.records]
    f_hz, error, u, weight = (np.concatenate(each) for each in zip(*parts, strict=True))
    _, line = np.unique(np.rint(f_hz / F_STEP_HZ), return_inverse=True)
    of_all = np.bincount(line) * np.bincount(line, np.abs(u) ** 2)
    differ = 1 - _power_of_sum(line, u) / of_all > INPUTS_DIFFER
    column = u * weight
    by_response = _power_of_sum(line, column.conj() * error) / np.bincount(line, np.abs(column) ** 2)
    return fit.cost - float(np.sum(by_response[differ]))


def _on_excited_lines(one: RecordFit) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Frequency [Hz], weighted error, input and weight of the lines that a record excites."""
    real, imaginary = np.split(one.residual, 2)
    u = one.spectra.u[one.line]
    use = one.spectra.excited[one.line] & (u != 0)
    return one.spectra.f_hz[one.line][use], (real + 1j * imaginary)[use], u[use], one.weight[use]


def _power_of_sum(line: np.ndarray, values: np.ndarray) -> np.ndarray:
    """|sum|^2 of the complex values of each line."""
    return np.bincount(line, values.real) ** 2 + np.bincount(line, values.imag) ** 2


def adds_resonance(null: PlantFit, fit: PlantFit, settings: DecisionSettings) -> bool:
    """Whether a mode that was added is a resonance, and the model has more of them than without it.

    One with the damping of a body does what a lag does. The number alone does not show that: without it, the
    model may have lost a resonance of its own.

    Parameters
    ----------
    null, fit : PlantFit
        Without and with the mode.
    settings : DecisionSettings
    """
    known = set(_modes(null))
    added = [label for label in _modes(fit) if label not in known]
    are_resonances = all(is_resonance(fit, label, settings) for label in added)
    return are_resonances and n_resonances(fit, settings) > n_resonances(null, settings)


def n_resonances(fit: PlantFit, settings: DecisionSettings) -> int:
    """Number of modes of a fitted model that are resonances within the band, beyond their uncertainty.

    Parameters
    ----------
    fit : PlantFit
    settings : DecisionSettings
    """
    return sum(is_resonance(fit, label, settings) for label in _modes(fit))


def _modes(fit: PlantFit) -> list[str]:
    return [label for label, one in fit.model.labels() if one.type.linear_part == "mode"]


def is_resonance(fit: PlantFit, mode: str, settings: DecisionSettings) -> bool:
    """Whether a mode is a peak in the band. Frequency and width of a mode that is none are not determined.

    Parameters
    ----------
    fit : PlantFit
    mode : str
        Its label in the model.
    settings : DecisionSettings
    """
    f_hz, zeta, residue = (fit.model[f"{mode}.{name}"] for name in ("f_hz", "zeta", "residue"))
    std_hz, size = _std(f_hz), abs(residue.value)
    in_band = fit.band_hz[0] <= f_hz.value - std_hz and f_hz.value + std_hz <= fit.band_hz[1]
    shown = size >= settings.significant * _std(residue)
    if std_hz <= min(one.spectra.f_hz[1] for one in fit.records) and math.isfinite(_std(residue)):
        shown = shown or zeta.value >= settings.significant * _std(zeta)
        shown = shown or size >= settings.significant * _std_at_its_width(fit.model, mode)
    return in_band and zeta.value < settings.zeta_of_mode and shown


def _std_at_its_width(model: PlantModel, mode: str) -> float:
    """Standard deviation of the residue if frequency and damping of the mode were known; infinite if unknown.

    Of a resonance between the lines only its power shows, residue and width do not. Where two modes cancel
    each other, the residue has no other value with its width known.
    """
    names = [f"{mode}.{name}" for name in ("f_hz", "zeta", "residue")]
    if model.covariance is None or not all(model[name].free for name in names):
        return math.inf
    own = [model.free_names.index(name) for name in names]
    covariance = model.covariance[np.ix_(own, own)]
    size = np.sqrt(np.diag(covariance))
    if not np.all(np.isfinite(covariance)) or not np.all(size > 0):
        return math.inf
    inverse = np.linalg.pinv(covariance / np.outer(size, size), hermitian=True)
    return float(size[2] / math.sqrt(max(inverse[2, 2], 1.0)))


def _undetermined(fit: PlantFit, effect: str, settings: DecisionSettings) -> dict[str, Param]:
    """Positive parameters of a law of many shapes that are within a standard deviation of zero.

    A mode without damping is a mode all the same.
    """
    kind = find(effect)
    if len(kind.parameters) < settings.many_shapes or kind.linear_part == "mode":
        return {}
    (params,) = [one.params for label, one in fit.model.labels() if label == label_of(fit.model, effect)]
    positive = {f"{effect}.{name}": param for name, param in params.items() if kind[name].lower >= 0}
    return {name: param for name, param in positive.items() if param.value <= _std(param)}


def _std(param: Param) -> float:
    """Standard deviation; 0 of a fixed parameter, infinite of one that the data do not determine."""
    if not param.free:
        return 0.0
    return math.inf if param.std is None or math.isnan(param.std) else param.std
