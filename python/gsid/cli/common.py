"""Exit codes, names of the help option, and the ladder of a model that a diagnosis found."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gsid.cli.output import print_message, print_step

if TYPE_CHECKING:
    from gsid.diagnosis.from_records.result import Diagnosis
    from gsid.plant.model import PlantModel

HELP_NAMES = ["-h", "--help"]
EXIT_GOOD, EXIT_CRITERION, EXIT_USAGE, EXIT_INPUT, EXIT_INTERNAL, EXIT_INTERRUPT = 0, 1, 2, 3, 4, 130


def with_ladder(given: PlantModel | None, found: Diagnosis) -> PlantModel:
    """The model that a diagnosis found, with its ladder if there are enough data to hold some out.

    Parameters
    ----------
    given : PlantModel or None
        The model with which the diagnosis started; None: the linear structure of the model that it found.
    found : Diagnosis
    """
    from gsid.base.errors import GsidError, InputError
    from gsid.diagnosis.add import with_history

    if not found.named:
        return found.model
    print_step("judging each step on records that its fit did not use")
    try:
        order = [effects[0] for effects in found.found]
        first = _without_found(found) if given is None else given
        return with_history(first, found.model, found.measured, order=order, band=found.band)
    except (InputError, GsidError) as error:
        print_message(f"note: no ladder in the model: {error}")
        return found.model


def _without_found(found: Diagnosis) -> PlantModel:
    model = found.model
    for effects in found.found:
        model = model.without_effect(effects[0])
    return model
