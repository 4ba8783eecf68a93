"""What a fit leaves on one line, where it leaves only noise on all others (DIA-18).

A test of all lines together sees no single one, however large: a disturbance locked to the period stays
there, and the cost of a complete model is several times that of noise.
"""

from __future__ import annotations

import numpy as np
from scipy import special

from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.greybox.fit import PlantFit


def remark_on_one_line(fit: PlantFit, settings: DecisionSettings) -> list[str]:
    """Sentence on the line, if there is one.

    Parameters
    ----------
    fit : PlantFit
    settings : DecisionSettings
    """
    costs = [np.sum(np.split(one.residual**2, 2), axis=0) for one in fit.records]
    largest = [float(np.max(cost, initial=0.0)) for cost in costs]
    i = int(np.argmax(largest))
    n_lines = sum(len(cost) for cost in costs)
    dof = fit.variance_dof
    ratio = largest[i] / 2 * dof / (dof - 1)  # the weights are corrected for the scatter of the variances
    p_value = n_lines * float(special.fdtrc(2, 2 * dof, ratio))
    if p_value >= settings.p_left or fit.cost - largest[i] > settings.adequate * fit.n_dof:
        return []
    one = fit.records[i]
    f_hz = one.spectra.f_hz[one.line[np.argmax(costs[i])]]
    name = one.name or f"record {i}"
    return [
        f"{100 * largest[i] / fit.cost:.0f} % of the cost is on one line, {f_hz:.4g} Hz of {name}"
        f" (p = {p_value:.1g}): a disturbance of that frequency, locked to the period, may do this."
    ]
