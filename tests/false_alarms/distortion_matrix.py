"""How often `gsid distortion` flags a channel of a linear plant of several inputs and outputs."""

from __future__ import annotations

from compare_matrix import Setting, records
from study import Cell, Study

from gsid.response.distortion import ALARM_RATE
from gsid.response.mimo_distortion import distortion_mimo


def run(cell: Cell, seed: int) -> float:
    d = distortion_mimo(records(cell.rng(seed), cell.setting))
    return ALARM_RATE if d.distorted_outputs or d.distorted_inputs else 1.0


STUDY = Study(
    name="distortion_matrix",
    title="Distortion of a linear plant of several inputs and outputs",
    about=(
        "The plant and the records of the study of `compare`. `gsid distortion` flags an output or an input "
        "where the scatter over the experiments exceeds that over the periods (DIS-7). Counted: measurements "
        "in which any channel is flagged. The bound for all channels together is by Bonferroni."
    ),
    cells=tuple(
        Cell(
            f"{n_y} x {n_u}, {n_periods} periods, {m} realisations",
            Setting(n_u, n_y, m, n_periods),
            at_most=True,
        )
        for n_u, n_y, m, n_periods in ((2, 2, 2, 2), (2, 3, 3, 4), (4, 4, 2, 3), (4, 4, 4, 2))
    ),
    run=run,
    levels=(ALARM_RATE,),
    n_seeds=400,
    n_short=8,
)
