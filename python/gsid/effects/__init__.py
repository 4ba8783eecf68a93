"""Physical effects: the catalogue, as described by the C library, and user-defined effects."""

from gsid.effects.custom import expression, load, table
from gsid.effects.types import EffectParameter, EffectType, catalogue, find

__all__ = ["EffectParameter", "EffectType", "catalogue", "expression", "find", "load", "table"]
