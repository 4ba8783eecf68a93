"""Physical effects: the catalogue, as the C library describes it, and effects of the user's own."""

from gsid.effects.custom import expression, load, table
from gsid.effects.types import EffectParameter, EffectType, catalogue, find

__all__ = ["EffectParameter", "EffectType", "catalogue", "expression", "find", "load", "table"]
