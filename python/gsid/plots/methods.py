"""Comparison of estimators (thesis, figures 7.13 and 7.14)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gsid.base.bands import within
from gsid.models.confidence import complex_bound
from gsid.plots.style import (
    MEASURED,
    NOISE,
    db,
    db_label,
    degrees_of_freedom,
    frequency_axis,
    legend_below,
    limits_db,
    line_mask,
    new_figure,
    per_unit,
    plain_text,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.fitting.estimators import Estimators
    from gsid.response.frf import Frf

# Different dashes, so that the lines can be distinguished without colour.
LOOKS = {
    "ls": ("#D55E00", ":"),
    "iwls": ("#E69F00", "--"),
    "ga": ("#009E73", "-."),
    "nls-output": ("#56B4E9", ":"),
    "nls": ("#56B4E9", "-"),
    "log": ("#CC79A7", "-"),
    "ml-io": ("#0072B2", "--"),
    "ml": ("#0072B2", "-"),
}


@styled
def estimators(found: Estimators, frf: Frf) -> Figure:
    """Errors of every estimator: complex, of the amplitude and of the phase, over frequency.

    Parameters
    ----------
    found : Estimators
        Result of `gsid.fitting.estimators.fit_all`.
    frf : Frf
        The response that they were fitted to.

    Returns
    -------
    Figure
        Top: the measured amplitude, the 95 % bound of its noise and the complex errors, on one dB axis.
        Below: the differences of amplitude [dB] and phase [deg] from the measured ones.
    """
    bands = [row.model.band_hz for row in found.rows if row.model is not None and row.model.band_hz]
    use = line_mask(frf)
    if bands:
        use = use & within(frf.f_hz, bands[0])
    f, g = frf.f_hz[use], frf.g[use]
    figure = new_figure(8.2)
    top, amplitude, phase = figure.subplots(3, 1, sharex=True, height_ratios=[2, 1, 1])
    bound = complex_bound(np.sqrt(frf.var_g[use]), n_dof=degrees_of_freedom(frf))
    top.plot(f, db(g), color=MEASURED, linewidth=1.2, label="|G measured|")
    top.plot(f, db(bound), color=NOISE, linewidth=0.9, label="95 % bound of the noise")
    errors = []
    for row in found.rows:
        if row.model is None:
            continue
        colour, dashes = LOOKS[row.method]
        style = {"color": colour, "linestyle": dashes, "linewidth": 1.1}
        ratio = row.model.response(f) / g
        errors.append(db(g * (ratio - 1)))
        top.plot(f, errors[-1], label=row.method, **style)
        amplitude.plot(f, db(ratio), **style)
        phase.plot(f, np.degrees(np.angle(ratio)), **style)
    frequency_axis(top, f, label=False)
    frequency_axis(amplitude, f, label=False)
    frequency_axis(phase, f)
    limits_db(top, db(g), db(bound), *errors)
    top.set_ylabel(db_label("magnitude", plain_text(per_unit(frf.y_unit, frf.u_unit))))
    amplitude.set_ylabel("amplitude\nerror [dB]")
    phase.set_ylabel("phase\nerror [deg]")
    top.set_title(f"Estimators of order {found.order}: complex error, and those of amplitude and phase")
    legend_below(figure, [top])
    return figure
