"""The linear structure beside a law that is named."""

from __future__ import annotations

from gsid.base.deadline import OutOfTime
from gsid.diagnosis.from_records.canonical import insignificant
from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.from_records.law_part import is_of_linear_part, without_laws
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.verdict import MISSING
from gsid.greybox.fit import CANNOT_FIT
from gsid.plant.linear_response import BACKLASH
from gsid.structure.start import start


def mend_structure(run: Run) -> None:
    """The linear structure beside the law.

    Where only noise is left, elements of the canonical stack that became zero are dropped. Otherwise the
    structure is found again from the records without the law's part of the output.

    Parameters
    ----------
    run : Run
    """
    if run.decision.verdict != MISSING or run.start is None or run.final is None or run.loop:
        return
    if is_linear(run.decision.effects[0]) or BACKLASH in run.decision.effects:
        return  # play was fitted beside its own structures
    with run.timed("structure beside the law"):
        if run.evidence().is_adequate(run.final):
            _drop_zeros(run)
            return
        for _ in range(run.settings.structure_rounds):
            if run.deadline.is_over or not _mended(run):
                return


def _drop_zeros(run: Run) -> None:
    """The model without optional elements that are not significant, where the cost stays."""
    fits = run.simulations()
    for name in insignificant(run.final.model, run.settings):
        smaller = fits.fit(run.final.model.without_effect(name), run.final.effects)
        if smaller is None:
            return
        if smaller.cost - run.final.cost < run.settings.needed:
            run.replace_final(smaller)


def _mended(run: Run) -> bool:
    """Whether the structure changed and the model with it is as good."""
    run.on_step("finding the linear structure without the law's part of the output")
    laws = [effect for effect in run.final.model.effects if not is_of_linear_part(effect)]
    try:
        rest = without_laws(run.measured, run.final.model, run.deadline)
        found = start(rest, output=run.start.output, band=run.band, deadline=run.deadline)
    except (*CANNOT_FIT, OutOfTime):
        return False
    if not found.has_model or found.effects.keys() == run.start.effects.keys():
        return False
    model = found.model()
    model.effects += laws
    fits = run.simulations()
    fitted = fits.fit(model, run.final.effects)
    if fitted is None or run.evidence().is_worse(fitted, run.final):
        return False
    run.start = found
    run.replace_final(fitted)
    return True
