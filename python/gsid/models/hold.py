"""What a model keeps of the hold of the records of its fit, and fits under both assumptions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from gsid.base.hold import fit_readings, likelier, other_reading

if TYPE_CHECKING:
    from gsid.models.mimo import MimoModel
    from gsid.models.rational import RationalModel
    from gsid.plant.model import PlantModel

Rational = TypeVar("Rational", "RationalModel", "MimoModel")


def fit_both(under: Callable[[str], Rational], dof: float) -> Rational:
    """The likelier of the fits of a response under both assumptions, marked as assumed.

    Parameters
    ----------
    under : callable
        From an assumption to the fit under it.
    dof : float
        Degrees of freedom of the variances that weigh: their scatter raises a cost.

    Returns
    -------
    RationalModel or MimoModel

    Raises
    ------
    ValueError, GsidError
        Of the first fit, where neither can be made.
    """
    found = fit_readings(under)
    scatter = 1 - 1 / dof if dof > 1 else 1.0
    taken = likelier({reading: 2 * model.cost * scatter for reading, model in found.items()})
    model, other = found[taken], found.get(other_reading(taken))
    model.hold_assumed, model.other_delay_s = True, None if other is None else other.delay_s
    return model


def facts_of(model: RationalModel | PlantModel) -> dict[str, Any]:
    """What a model keeps of the hold of the records of its fit.

    Parameters
    ----------
    model : RationalModel or PlantModel

    Returns
    -------
    dict
        hold, hold_assumed, other_delay_s and delay_hold_uncertainty_s, as in `RationalModel`; of a plant that
        was not fitted the hold is None.
    """
    kept = model.fit or {} if hasattr(model, "effects") else vars(model)
    names = ("hold", "hold_assumed", "other_delay_s")
    facts = {name: kept.get(name) for name in names} | {"hold_assumed": bool(kept.get("hold_assumed"))}
    uncertainty = getattr(model, "delay_hold_uncertainty_s", kept.get("delay_hold_uncertainty_s"))
    return facts | {"delay_hold_uncertainty_s": uncertainty}
