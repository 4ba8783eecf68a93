"""The linear structure that a diagnosis starts with: from the records, or a given model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsid.base.errors import InputError
from gsid.diagnosis.from_records.canonical import (
    canonical_stack,
    has_low_mode,
    without_wrong_unit,
)
from gsid.diagnosis.from_records.draft import null_cost
from gsid.diagnosis.from_records.draw_up import give_up
from gsid.diagnosis.from_records.law_part import is_of_linear_part, linear_only
from gsid.diagnosis.from_records.loop import identified_loop, referenced
from gsid.diagnosis.from_records.mode_limits import with_mode_limits
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.verdict import (
    UNKNOWN,
    Decision,
)
from gsid.effects.types import catalogue
from gsid.greybox.better_start import fit_from_better_start
from gsid.greybox.fit import require_motion
from gsid.greybox.linear_start import linear_start
from gsid.greybox.weights import has_common_zero
from gsid.plant.mean_input import with_mean_input
from gsid.plant.model import PlantModel
from gsid.plant.units import TRAVELS, check_plant_units
from gsid.records.clipping import clipped_text
from gsid.records.record import Record
from gsid.response.closed_loop import require_reference
from gsid.spectrum.realisation import listed, require_different, spectra_of
from gsid.spectrum.spectra import Spectra, is_open, read_as, require_motion_of_output
from gsid.structure.start import Start, start


def find_structure(
    run: Run,
    records: Record | Spectra | Sequence[Record | Spectra],
    model: PlantModel | None,
    output: str | None,
    reference: str | None,
) -> None:
    """The canonical stack from the data, or the given model.

    Parameters
    ----------
    run : Run
    records, output, reference
        As `diagnose_records`.
    model : PlantModel or None
        A given model.
    """
    with run.timed("spectra"):
        run.on_step("transforming the records")
        run.measured = spectra_of(records)
        require_different(run.measured)
    require_motion_of_output(run.measured)
    _note_clipped(run, listed(records))
    if run.band is not None and not (model is not None and has_common_zero(model)):
        # Line 0 is of use to some laws only: costs of different lines cannot be compared.
        run.band = max(run.band[0], min(float(one.f_hz[1]) for one in run.measured)), run.band[1]
    run.hold_assumed, run.open = is_open(run.measured), [one.hold is None for one in run.measured]
    if model is not None:
        with run.timed("given model"):
            _take(run, model)
        _note_laws_of_turning(run)
        return
    with run.timed("linear structure"):
        run.on_step("finding the linear structure")
        run.in_closed_loop = reference is not None
        source = records if run.in_closed_loop else run.measured
        if run.in_closed_loop:
            _find_loop(run, listed(records), reference)
        try:
            run.start = start(
                source, output=output, band=run.band, reference=reference, deadline=run.deadline
            )
        except np.linalg.LinAlgError:
            reason = "No linear structure represents the data: the search for one failed numerically."
            run.decision = Decision(UNKNOWN, (), (reason,))
            return
    if not run.start.has_model and run.deadline.is_over:
        give_up(run)
    elif not run.start.has_model:
        run.decision = Decision(UNKNOWN, (), (_why_no_stack(run.start),))
    else:
        run.stack = canonical_stack(run.start.model(), run.f_lo_hz, run.settings)
        run.measured = run.judged = without_wrong_unit(run.measured, run.stack)
        run.by_reference = without_wrong_unit(run.by_reference, run.stack)
        run.measured = run.judged = with_mean_input(run.measured, run.start.model())
        _keep_resonances(run)
        _note_laws_of_turning(run)


def _note_clipped(run: Run, records: Sequence[Record | Spectra]) -> None:
    """Report an output that may be clipped: the catalogue has no clipped sensor."""
    stays = clipped_text(one for one in records if isinstance(one, Record))
    if stays:
        run.notes.append(stays[0].upper() + stays[1:] + ".")


def _find_loop(run: Run, records: list[Record], reference: str) -> None:
    """The controller, from the reference, the output and the command."""
    for record in records:
        require_reference(record, reference)
    run.loop = identified_loop(records, run.measured, reference, run.settings)
    if run.loop is not None:
        run.by_reference = referenced(records, run.measured, reference)


def _note_laws_of_turning(run: Run) -> None:
    """An axis whose output is neither an angle nor a travel may turn all the same."""
    unit = run.measured[0].y_unit
    if run.stack.angle_unit != "m" or unit.partition("/")[0] in {"", *TRAVELS}:
        return
    why = f"y is in {unit}, which is no unit of an angle; --factor and --unit convert it"
    run.not_tried |= {effect.id: why for effect in catalogue().values() if effect.turns_only}


def _keep_resonances(run: Run) -> None:
    """The low modes as well, where the stack without them is far worse."""
    found = run.start.model()
    if not has_low_mode(found, run.f_lo_hz, run.settings):
        return
    with_modes = canonical_stack(found, run.f_lo_hz, run.settings, merged=False)
    costs = [
        null_cost(run.measured, each, run.band, run.deadline, run.known_fits, run.settings)
        for each in (run.stack, with_modes)
    ]
    if costs[0] > run.settings.merged_cost * costs[1]:
        run.stack = with_modes


def _take(run: Run, model: PlantModel) -> None:
    """A given model. Its laws are fitted by simulation, and their part of the output is subtracted."""
    for one in run.measured:
        check_plant_units(model, one)
    if not model.free_names:
        hint = 'mark what the records may change, such as the gain of rigid_body, with "free": true'
        raise InputError("the given model has no free parameter", "", None, hint)
    run.given = model
    model = with_mode_limits(model, run.settings)
    run.stack, run.judged = linear_only(model), run.measured
    run.hold_assumed = run.hold_assumed and not model.has_controller
    if not all(one.input_repeats for one in run.measured):
        near = linear_start(run.stack, run.measured)
        run.measured = run.judged = with_mean_input(run.measured, near)
    laws = [effect for effect in model.effects if not is_of_linear_part(effect)]
    if laws:
        run.on_step("fitting the given model by simulation")
        how = {"band": run.band, "deadline": run.deadline, "quiet": True}
        fitted = fit_from_better_start(model, run.measured, **how)
        require_motion(fitted)
        run.measured = read_as(run.measured, fitted.hold) if fitted.hold_assumed else run.measured
        run.keep(fitted.model)


def _why_no_stack(found: Start) -> str:
    if found.represented:
        return f"y is the {found.output}, which no stack of effects has as output: integrate y."
    return f"No stack of effects represents the data; a rational model of order {found.order} does best."
