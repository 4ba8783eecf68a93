"""Models and records of a closed loop, as a comparison or a fit needs them.

A stack of effects is simulated with the reference as its input and the controller around the axis: driven by
the measured command it would drift away from the measured motion. A rational model has the measured command
as its input, at the lines of the reference; what noise adds to command and output then cancels.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from gsid.base.errors import InputError
from gsid.diagnosis.from_records.loop import LOOP, identified_loop, referenced
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.plant.model import PlantModel
from gsid.records.record import Record
from gsid.response.closed_loop import loop_spectra, require_reference
from gsid.spectrum.realisation import listed, spectra_of
from gsid.spectrum.spectra import Spectra

Model = TypeVar("Model")


def in_closed_loop(
    model: Model, records: Record | Sequence[Record], reference: str
) -> tuple[Model, list[Spectra]]:
    """A model, and the spectra that it has to explain, for records measured in a closed loop.

    Parameters
    ----------
    model : PlantModel, RationalModel or PiecewiseModel
    records : Record or sequence of Record
    reference : str
        Column of the reference.

    Returns
    -------
    model
        A stack of effects without a controller gets the one that reference, output and command show; its
        values are not free.
    list of Spectra
        Their input is the reference if the model is a stack of effects, else the command.

    Raises
    ------
    InputError
        There is no such column, or the stack has no controller and the records show none.
    """
    records = listed(records)
    for record in records:
        require_reference(record, reference)
    if not isinstance(model, PlantModel):
        return model, [loop_spectra(record, reference) for record in records]
    measured = spectra_of(records)
    if not model.has_controller:
        model = _with_controller(model, records, measured, reference)
    by_reference = referenced(records, measured, reference)
    return model, [
        replace(one, excited=command.excited) for one, command in zip(by_reference, measured, strict=True)
    ]


def _with_controller(
    model: PlantModel, records: Sequence[Record], measured: Sequence[Spectra], reference: str
) -> PlantModel:
    found = identified_loop(records, measured, reference, DEFAULTS) if model.output == "angle" else None
    if found is None:
        hint = f"write {LOOP} with its gains into the model file, or leave --r out"
        raise InputError("the controller of the closed loop is not known", records[0].name, None, hint)
    larger = copy.deepcopy(model)
    larger.effects.insert(0, found)
    return larger
