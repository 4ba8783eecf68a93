"""Diagnosis from the records alone: from the samples to the name of the missing effect.

1. The linear structure is taken from the data (`gsid.start`), or from a given model. Drifts, and a fan
   between the lines, are subtracted.
2. The laws are judged on a canonical stack by the first stage; linear effects that are missing enter the
   stack first. Where more than noise is left, lines on which noise rings are left out.
3. The winner, its relatives and the best law of another family are fitted by simulation.
4. If no law is named: stops that only the high level reaches, then play between motor and load.
5. A law is named if these fits confirm it; otherwise it is the nearest, or unknown.
6. If a law is named, elements that may be zero are dropped, or its part of the output is subtracted and the
   linear structure is found again.
7. With a given model: further effects, one round each; whether each is missing under both assumptions of the
   hold. Else the likelier hold is taken, and a nearest law that leaves more than noise has to explain most.
8. Values with equal weights where more than noise is left, and larger laws that are not excluded.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.threads import with_one_thread_for_algebra
from gsid.diagnosis.closed_loop import in_closed_loop
from gsid.diagnosis.from_records.disturbances import subtract_disturbances
from gsid.diagnosis.from_records.draw_up import draw_up, give_up
from gsid.diagnosis.from_records.equal_weights import weigh_model_error
from gsid.diagnosis.from_records.far_values import check_far_values
from gsid.diagnosis.from_records.find_structure import find_structure
from gsid.diagnosis.from_records.fit_laws import confirm
from gsid.diagnosis.from_records.hold_check import check_hold, take_likelier_hold
from gsid.diagnosis.from_records.larger_laws import add_larger_laws
from gsid.diagnosis.from_records.mend_structure import mend_structure
from gsid.diagnosis.from_records.result import Diagnosis
from gsid.diagnosis.from_records.ringing_lines import leave_out_ringing_lines
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.run import ALPHA, Run
from gsid.diagnosis.from_records.seek_play import seek_play
from gsid.diagnosis.from_records.seek_stop import seek_stop
from gsid.diagnosis.from_records.series_check import check_series
from gsid.diagnosis.from_records.settings import DEFAULTS, DecisionSettings
from gsid.diagnosis.from_records.steps import BEFORE_FITS, Steps
from gsid.diagnosis.from_records.summary import summarised
from gsid.diagnosis.from_records.weak_nearest import doubt_nearest
from gsid.effects.types import find
from gsid.plant.model import PlantModel, check_plant
from gsid.records.record import Record
from gsid.spectrum.spectra import Spectra


@with_one_thread_for_algebra
def diagnose_records(
    records: Record | Spectra | Sequence[Record | Spectra],
    model: PlantModel | None = None,
    *,
    output: str | None = None,
    reference: str | None = None,
    band: tuple[float, float] | None = None,
    without: Collection[str] = (),
    fast: bool = False,
    time_s: float | None = None,
    alpha: float = ALPHA,
    settings: DecisionSettings = DEFAULTS,
    on_step: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """Find the physical effect that is missing from the linear model of an axis, from its records alone.

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
        Realisations, preferably with random phases and at two levels.
    model : PlantModel, optional
        Linear stack to start with. Default: found by `gsid.start`.
    output : {"rate", "angle", "acceleration"}, optional
        What y is; default: inferred from the data, or that of the model.
    reference : str, optional
        Of records measured in a closed loop: the column of its reference.
    band : (lo, hi), optional
        Only lines within [Hz]; default from the first to the last excited line.
    without : collection of str
        Effects that are not tried.
    fast : bool
        Stop at the first draft, which is not confirmed by simulation.
    time_s : float, optional
        Budget [s]: then the running step is stopped, and the result is the best so far. Default 60.
    alpha : float
        With a model: p-value of what the model leaves, below which it is rejected though no effect explains
        that.
    settings : DecisionSettings
    on_step : callable
        Called with a short description of each step before it starts: its number, and the time left.

    Returns
    -------
    Diagnosis
        If it is interrupted (KeyboardInterrupt) after the first draft: the state that it had reached.

    Raises
    ------
    InputError
        As `gsid.start`; an unknown effect in `without`; a given model without a free parameter; no effect is
        left to look for.
    ValueError
        No record, an unknown output, a time that is not positive, or spectra with a reference.
    """
    if not 0 < alpha < 1:
        raise ValueError(f"alpha must be between 0 and 1, got {alpha}")
    if time_s is not None and not time_s > 0:
        raise ValueError(f"time_s must be positive, got {time_s}")
    for effect in without:
        find(effect)
    budget_s = settings.time_s if time_s is None else time_s
    if model is not None:
        check_plant(model)
        model = replace(model, output=output or model.output)
        if reference is not None:
            model, records = in_closed_loop(model, records, reference)
            reference = None
    rounds = None
    with Deadline(budget_s) as whole:
        deadline = whole.bounded(settings.moves_most)
        steps = Steps(on_step, deadline)
        if fast:
            steps.expect(BEFORE_FITS)
        run = Run(deadline, settings, band, without, steps, alpha)
        try:
            find_structure(run, records, model, output, reference)
            if run.stack is not None:
                subtract_disturbances(run)
                draw_up(run)
                if leave_out_ringing_lines(run):
                    draw_up(run)
                if not fast:
                    confirm(run)
                    seek_stop(run)
                    seek_play(run)
                    mend_structure(run)
                    if model is not None:
                        rounds = Rounds(run)
                        rounds.run()
                        check_far_values(rounds)
                        check_hold(rounds)
                        check_series(rounds)
                    else:
                        take_likelier_hold(run)
                        doubt_nearest(run)
                    shown = rounds.effects if rounds else [run]
                    if len(shown) == 1:
                        weigh_model_error(*shown)
                    for one in shown:
                        add_larger_laws(one)
            return summarised(run, rounds)
        except KeyboardInterrupt:
            if run.draft is None:
                raise
            run.interrupted = True
        except OutOfTime:
            give_up(run)
    return summarised(run, rounds)


def diagnose(
    model: PlantModel,
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    reference: str | None = None,
    band: tuple[float, float] | None = None,
    without: Collection[str] = (),
    fast: bool = False,
    time_s: float | None = None,
    alpha: float = ALPHA,
    settings: DecisionSettings = DEFAULTS,
    on_step: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """Find the physical effects that are missing from a model: `diagnose_records` with this model.

    Parameters
    ----------
    model : PlantModel
        What is believed so far; its free parameters are fitted first. What it fixes stays fixed.
    records, reference, band, without, fast, time_s, alpha, settings, on_step
        As `diagnose_records`.

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError, InputError
        As `gsid.fit_plant`.
    """
    check_plant(model)
    return diagnose_records(
        records,
        model,
        reference=reference,
        band=band,
        without=without,
        fast=fast,
        time_s=time_s,
        alpha=alpha,
        settings=settings,
        on_step=on_step,
    )
