"""Fit by simulation of play between motor and load.

The motor's position is not in the records, so that the first stage has no column for the play. Its starting
values come from the response and from the measured motion of the load (`gsid.diagnosis.joint_start`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress

import numpy as np

from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import GsidError, InputError
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.joint_start import joint_start
from gsid.diagnosis.missing_torque.linear_fit import ModeScan
from gsid.diagnosis.missing_torque.problem import Problem, linear_part
from gsid.diagnosis.missing_torque.settings import SearchSettings
from gsid.effects.ids import BODY, MODE
from gsid.greybox.fit import PlantFit, fit_plant
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel
from gsid.plant.periodic import PeriodicPlant
from gsid.spectrum.spectra import Spectra

LOOK = 3  # iterations of the first fit, which decides whether it is continued
FURTHER = 15  # iterations of the last one
ALONE = 10  # iterations of the fit of one record, and of it with each further one
WALLS = 3  # restarts from one record
FORGIVEN = 0.5  # share of the cost without play: a fit that leaves more is not restarted
SAME = 10.0  # fall of the cost by which a restart has to be better
DOUBTFUL = 2.0  # kept-out cost, linearised, over that of the fit, from which it is repeated by refits
MOST = 0.5  # share of what is left that a hidden mode has to explain


def may_have_play(model: PlantModel) -> bool:
    """Whether play can be added to a model: it has a body and no play yet.

    Parameters
    ----------
    model : PlantModel
    """
    effects = {effect.id for effect in model.effects}
    return BODY in effects and BACKLASH not in effects


def fit_play(
    null: PlantFit,
    given: PlantModel,
    measured: Sequence[Spectra],
    band: tuple[float, float] | None,
    beaten: float,
    deadline: Deadline,
    pruned: Callable[[PlantModel], PlantModel] = lambda model: model,
    *,
    is_clear: bool = False,
) -> PlantFit | None:
    """Fit a model with play; None if play does not improve the response.

    The fit is completed only if its first iterations reach a lower cost than all other laws.

    Parameters
    ----------
    null : PlantFit
        Fit without play.
    given : PlantModel
        The model before any fit.
    measured : sequence of Spectra
    band : (lo, hi) or None
        Hz.
    beaten : float
        Cost that play has to fall below.
    deadline : Deadline
    pruned : callable
        Removes elements of a stack that became zero: a lag of zero makes the simulation stiff.
    is_clear : bool
        As `joint_start`.
    """
    start = joint_start(null, given, deadline, pruned, is_clear=is_clear)
    return start and fit_play_from(start, null.cost, measured, band, beaten, deadline)


def fit_play_from(
    start: PlantModel,
    without: float,
    measured: Sequence[Spectra],
    band: tuple[float, float] | None,
    beaten: float,
    deadline: Deadline,
    look: int = LOOK,
) -> PlantFit:
    """Fit a model with play from its values.

    Parameters
    ----------
    start : PlantModel
        With play.
    without : float
        Cost of the fit without play.
    measured, band, beaten, deadline
        As `fit_play`.
    look : int
        Iterations of the first fit.
    """
    how = {"band": band, "deadline": deadline, "quiet": True}
    fit = fit_plant(start, measured, max_iter=look, **how)
    if fit.cost < FORGIVEN * without:
        fit = _beyond_the_walls(fit, measured, band, deadline)
    if fit.cost < beaten and not fit.converged:
        with suppress(OutOfTime):  # the first fit has not converged, but is the best so far
            fit = fit_plant(fit.model, measured, max_iter=FURTHER, **how)
    return fit


def _beyond_the_walls(
    fit: PlantFit, measured: Sequence[Spectra], band: tuple[float, float] | None, deadline: Deadline
) -> PlantFit:
    """Fit one record alone, then add the other records one at a time.

    The cost of a record has a steep step wherever the number of collisions changes, and such a step stops the
    fit. The steps of different records lie at different values, so that the cost of a single record has the
    fewest steps.
    """
    n_records = len(measured)
    for _ in range(WALLS if n_records > 1 else 0):
        if _leaves_noise(fit) or deadline.is_over:
            break
        restarts = _restarts(fit, measured, band, deadline)
        with suppress(GsidError, InputError, OutOfTime):
            better = next((one for one in restarts if one.cost <= fit.cost - SAME), None)
            if better is not None:
                fit = better
                continue
        break
    return fit


def _restarts(
    fit: PlantFit, measured: Sequence[Spectra], band: tuple[float, float] | None, deadline: Deadline
) -> Iterator[PlantFit]:
    """Fits to all records: grown from the record that is fitted best alone, then from each record alone."""
    how = {"band": band, "deadline": deadline, "quiet": True}
    alone = [fit_plant(fit.model, one, max_iter=LOOK, **how) for one in measured]
    order = sorted(range(len(measured)), key=lambda i: alone[i].cost_per_dof)
    further = alone[order[0]]
    if not further.converged:
        further = fit_plant(further.model, measured[order[0]], max_iter=ALONE, **how)
    for n in range(2, len(measured) + 1):
        chosen = [measured[i] for i in sorted(order[:n])]
        further = fit_plant(further.model, chosen, max_iter=ALONE, **how)
    yield further
    for i in order:
        longer = fit_plant(alone[i].model, measured[i], max_iter=ALONE, **how)
        yield fit_plant(longer.model, measured, max_iter=ALONE, **how)


def with_hidden_mode(fit: PlantFit, settings: SearchSettings) -> PlantModel | None:
    """The model with the mode that explains most of what a fit with play leaves; None if it explains less.

    Without play the linear structure leaves so much that a sharp mode does not show.

    Parameters
    ----------
    fit : PlantFit
        With play.
    settings : SearchSettings
    """
    problem = Problem(fit.model, [one.spectra for one in fit.records], fit.band_hz, settings)
    errors = [one.spectra.y - one.prediction.Y for one in fit.records]
    error = problem.whiten([e[r.line] for e, r in zip(errors, problem.records, strict=True)])
    no_tangent = np.zeros((len(error), 0))  # what the other parameters can do of a sharp peak is little
    modes = ModeScan(problem, linear_part(fit.model), no_tangent, error)
    f_hz = np.concatenate([lines.f_hz for lines in problem.first])
    ratio = 1 + min(settings.mode_dampings)  # half the width of the sharpest
    frequencies = np.exp(np.arange(np.log(f_hz.min()), np.log(f_hz.max()), np.log(ratio)))
    found = {zeta: modes.best(frequencies, zeta) for zeta in settings.mode_dampings}
    zeta = max(found, key=lambda each: found[each].gain)
    if found[zeta].gain < MOST * float(error @ error):
        return None
    params = {"f_hz": found[zeta].f_hz, "zeta": zeta, "residue": found[zeta].residue}
    return fit.model.with_effect(MODE, params)


def left_by_refits(fit: PlantFit, band: tuple[float, float] | None, deadline: Deadline) -> list[np.ndarray]:
    """Whitened errors of the records, each simulated with the fit to the others, without linearisation.

    Parameters
    ----------
    fit : PlantFit
        Of several records.
    band : (lo, hi) or None
        Hz.
    deadline : Deadline
        Each refit may do its share of the work.

    Returns
    -------
    list of (2 k,) ndarray
        In the order of the records, with variance 1 where only noise is left.

    Raises
    ------
    OutOfTime
        The work or the time was over before each refit had left the values of the fit to all records.
    """
    errors, moves = [], deadline.moves_left / len(fit.records)
    for one in fit.records:
        others = [other.spectra for other in fit.records if other is not one]
        work = deadline.bounded(moves)
        without = fit_plant(fit.model, others, band=band, max_iter=LOOK, deadline=work, quiet=True)
        if not without.converged and np.array_equal(without.model.free_values, fit.model.free_values):
            raise OutOfTime("a refit has not left its start")
        answer = PeriodicPlant.of(without.model, one.spectra, deadline).run_within(deadline)
        errors.append(one.whitened(one.spectra.y - answer.Y))
    return errors


def _leaves_noise(fit: PlantFit) -> bool:
    """Whether a fit needs no restart."""
    is_small = fit.converged and fit.cost_per_dof <= DecisionSettings.adequate
    return is_small or fit.noise_p_value >= DecisionSettings.p_adequate
