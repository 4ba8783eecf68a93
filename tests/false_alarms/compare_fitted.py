"""How often `gsid compare --fitted` rejects a right model on the records of its fit."""

from __future__ import annotations

from compare_unseen import N_AXES, axis, measured, noise, rational_system, stack
from study import Cell, Study

from gsid.comparison import compare
from gsid.fitting.rational import fit
from gsid.greybox.fit import fit_plant
from gsid.response.estimate import frf


def plant(cell: Cell, seed: int) -> dict[str, float]:
    """A stack of effects, fitted from values that are up to 5 % off."""
    rng, n_periods = cell.rng(seed), cell.setting[1]
    params, (first, _) = axis(seed % N_AXES)
    ours = measured(rng, first, n_periods, noise(rng))
    start = {name: value * rng.uniform(0.95, 1.05) for name, value in params.items()}
    return {"p_value": compare(fit_plant(stack(start), ours).model, ours, fitted=True).p_value}


def rational(cell: Cell, seed: int) -> dict[str, float]:
    """A held second-order system with a zero, 60 lines."""
    ours = rational_system(cell.rng(seed))(cell.setting[1])
    return {"p_value": compare(fit(frf(ours), "2/1", delay="none"), ours, fitted=True).p_value}


def run(cell: Cell, seed: int) -> dict[str, float]:
    return cell.setting[0](cell, seed)


STUDY = Study(
    name="compare_fitted",
    title="A correct, fitted model on the record of its fit",
    about=(
        "The models and records of the study above, compared with the record of the fit (`gsid compare "
        "--fitted`). Rejections after a wrong minimum are counted too."
    ),
    cells=tuple(
        Cell(f"{words}, {n_periods} periods", (kind, n_periods))
        for words, kind in (("stack", plant), ("rational", rational))
        for n_periods in (3, 8)
    ),
    run=run,
    levels=(0.05,),
    n_seeds=2000,
    n_short=12,
    confidence=0.99,
    window=(0.7, 1.3),
)
