"""Starting values of laws of the drive in a closed loop.

The command inside the loop is not in the record, so that the first stage has no column for these laws. The
loop is simulated instead, with each law at the points of its grid relative to the simulated command.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from gsid.base.deadline import Deadline
from gsid.base.errors import GsidError
from gsid.diagnosis.missing_torque import catalogue
from gsid.diagnosis.missing_torque.law_columns import Law
from gsid.greybox.fit import PlantFit
from gsid.plant.model import PlantModel

POINTS_MOST = 24  # of each law: each is a simulation of all records


def drive_starts(
    null: PlantFit, without: Collection[str], deadline: Deadline
) -> list[tuple[str, PlantModel]]:
    """Effects of the drive, each with the model at the best point of its grid, if the cost falls there.

    Parameters
    ----------
    null : PlantFit
        Of a model with its controller.
    without : collection of str
        Effects that are not tried.
    deadline : Deadline
        Time at which no further point is simulated.
    """
    present = {effect.id for effect in null.model.effects}
    laws = [law for law in catalogue.laws({*present, *without}, True, True) if law.is_command]
    largest = max(
        float(np.max(np.abs(null.model.drive_command(record.spectra, record.prediction))))
        for record in null.records
    )
    found = []
    for law in laws:
        cost, model = _best(null, law, largest, deadline)
        if cost < null.cost:
            found.append((cost, law.effect.id, model))
    return [(effect, model) for _, effect, model in sorted(found, key=lambda one: one[0])]


def _best(null: PlantFit, law: Law, largest: float, deadline: Deadline) -> tuple[float, PlantModel]:
    points = law.points({"largest command": largest, "1": 1.0})
    best = (np.inf, null.model)
    for point in points[np.unique(np.linspace(0, len(points) - 1, POINTS_MOST).astype(int))]:
        if deadline.is_over:
            break
        names = [parameter.name for parameter in law.effect.parameters]
        model = null.model.with_effect(law.effect, dict(zip(names, map(float, point), strict=True)))
        try:
            best = min(best, (null.cost_of(model), model), key=lambda one: one[0])
        except GsidError:
            continue
    return best
