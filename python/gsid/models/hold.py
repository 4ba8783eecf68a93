"""Hold of the records that a model was fitted to, and fits with both holds."""

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
    """Fit a response with both holds and return the likelier model, with its hold marked as assumed.

    Parameters
    ----------
    under : callable
        Function from a hold to the model fitted with it.
    dof : float
        Degrees of freedom of the variances used as weights. Their scatter increases the cost.

    Returns
    -------
    RationalModel or MimoModel

    Raises
    ------
    ValueError, GsidError
        Both fits failed. The error is that of the first.
    """
    found = fit_readings(under)
    scatter = 1 - 1 / dof if dof > 1 else 1.0
    taken = likelier({reading: 2 * model.cost * scatter for reading, model in found.items()})
    model, other = found[taken], found.get(other_reading(taken))
    model.hold_assumed, model.other_delay_s = True, None if other is None else other.delay_s
    return model


def facts_of(model: RationalModel | PlantModel) -> dict[str, Any]:
    """Return the entries of a model about the hold of the records of its fit.

    Parameters
    ----------
    model : RationalModel or PlantModel

    Returns
    -------
    dict
        hold, hold_assumed, other_delay_s and delay_hold_uncertainty_s, as in `RationalModel`. The hold of a
        plant that was not fitted is None.
    """
    kept = model.fit or {} if hasattr(model, "effects") else vars(model)
    names = ("hold", "hold_assumed", "other_delay_s")
    facts = {name: kept.get(name) for name in names} | {"hold_assumed": bool(kept.get("hold_assumed"))}
    uncertainty = getattr(model, "delay_hold_uncertainty_s", kept.get("delay_hold_uncertainty_s"))
    return facts | {"delay_hold_uncertainty_s": uncertainty}
