"""Values of a law that leaves more than noise, from a fit with equal weights."""

from __future__ import annotations

from dataclasses import replace

from gsid.base.deadline import OutOfTime
from gsid.diagnosis.from_records.ripple import remaining_ripple
from gsid.diagnosis.from_records.run import Run
from gsid.greybox.fit import CANNOT_FIT, fit_plant
from gsid.plant.linear_response import BACKLASH


def weigh_model_error(run: Run) -> None:
    """The values of the law with equal weights, and a ripple, where it leaves more than noise.

    Play has neither: its fit has steps, and takes ten times as long.

    Parameters
    ----------
    run : Run
    """
    if not run.decision.effects or run.final is None or BACKLASH in run.final.effects:
        return
    if run.evidence().is_adequate(run.final):
        return
    with run.timed("fit with equal weights"):
        has_large_error = run.final.fit.cost_per_dof >= run.settings.much_left
        if has_large_error and not _fit_with_equal_weights(run):
            return
        if not run.deadline.is_over:
            run.ripple = remaining_ripple(run.final.model, run.measured, run.band)


def _fit_with_equal_weights(run: Run) -> bool:
    """Replace the fit of the law, whose error is larger than noise; whether there is another fit.

    The weights of noise then put this error on the lines where the output is largest.
    """
    run.on_step("fitting with equal weights")
    how = {"band": run.band, "method": "nls-output", "deadline": run.deadline, "quiet": True}
    try:
        run.deadline.check()
        fit = fit_plant(run.final.model, run.measured, **how)
    except (*CANNOT_FIT, OutOfTime):
        return False
    if not fit.converged and run.deadline.is_used_up:
        return False  # it was cut: its values lie between those of two criteria
    run.replace_final(replace(run.final, fit=fit))
    return True
