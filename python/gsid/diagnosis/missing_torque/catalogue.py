"""The laws of the catalogue as the first stage looks at them, and their rivals from outside it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from gsid._lib import ffi
from gsid.diagnosis.missing_torque.law_columns import Law
from gsid.diagnosis.missing_torque.motion import Motion
from gsid.diagnosis.missing_torque.problem import Problem
from gsid.effects.custom import expression
from gsid.effects.types import EffectType, catalogue

COEFFICIENT = "c"  # of an enlarged law
LINEAR_KINDS = frozenset({"damping", "spring", "delay", "lag", "mode"})
"""Kinds of linear parts that are searched for in the frequency domain."""


def family(effect: EffectType) -> str:
    """Family of an effect, from what its law looks at.

    Parameters
    ----------
    effect : EffectType
    """
    if effect.c.command != ffi.NULL:
        return "command"
    if effect.c.torque != ffi.NULL and effect.c.n_states == 0:
        if effect.c.holding != ffi.NULL or effect.c.has_memory:
            return "dry friction"
        return "position" if effect.c.looks_at_angle else "drag"
    return {"spring": "spring", "damping": "damping", "mode": "mode"}.get(effect.linear_part, "lag")


def laws(without: Collection[str], is_angle: bool, is_open_loop: bool, own_phases: int = 0) -> list[Law]:
    """Torque laws and maps of the command that are searched for.

    Parameters
    ----------
    without : collection of str
        Effects that the model has already.
    is_angle : bool
        Whether the axis turns.
    is_open_loop : bool
        Whether the record's input is the command: else it cannot be mapped.
    own_phases : int
        Number of records whose mean angle is not known; 0 if it is.
    """
    found = []
    for effect in _searched(without, is_angle):
        is_law = effect.c.torque != ffi.NULL and effect.c.n_states == 0
        if is_law or (effect.c.command != ffi.NULL and is_open_loop):
            found.append(law(effect, own_phases))
    return found


def law(effect: EffectType, own_phases: int = 0) -> Law:
    """A torque law or a map of the command.

    Parameters
    ----------
    effect : EffectType
    own_phases : int
        As `laws`.
    """
    found = Law(effect, effect.id, family(effect))
    return replace(found, own_phases=own_phases) if found.phase else found


def contains_spring(effect: EffectType) -> bool:
    """Whether a law is a spring over a small travel, as a sine is, without its gap, or before it slides.

    Parameters
    ----------
    effect : EffectType
    """
    if family(effect) != "position":
        return bool(effect.c.has_memory)
    return law(effect).phase is not None or effect.c.edge != ffi.NULL


def enlarged_laws(of_family: str) -> list[Law]:
    """Rivals of the laws of a family from outside the catalogue.

    Parameters
    ----------
    of_family : str
    """
    return [
        Law(expression(text, {COEFFICIENT: 0.0}), text, of_family)
        for effect in catalogue().values()
        if family(effect) == of_family
        for text in effect.enlarged
    ]


def linear_effects(without: Collection[str], is_angle: bool) -> list[EffectType]:
    """Linear effects that are searched for; a further mode is one even where the model has one.

    Parameters
    ----------
    without, is_angle
        As `laws`.
    """
    found = [e for e in _searched(without, is_angle) if e.linear_part in LINEAR_KINDS]
    modes = [e for e in catalogue().values() if e.linear_part == "mode" and e.id in without]
    return found + modes


def _searched(without: Collection[str], is_angle: bool) -> list[EffectType]:
    return [
        effect
        for effect in catalogue().values()
        if effect.id not in without and not effect.not_searched and (is_angle or not effect.turns_only)
    ]


def scales(problem: Problem, moved: list[Motion]) -> dict[str, float]:
    """The quantities that grids are relative to, by their name in `gsid.effects.types.SCALES`.

    Parameters
    ----------
    problem : Problem
    moved : list of Motion
    """
    first = problem.first[0].spectra
    travel = max(float(np.ptp(m.angle)) for m in moved)
    return {
        "largest rate": max(float(np.max(np.abs(m.rate))) for m in moved),
        "largest angle": max(float(np.max(np.abs(m.angle))) for m in moved),
        "travel": travel,
        "travel in rad": travel * problem.radians,
        "largest command": max(float(np.max(np.abs(r.command))) for r in problem.records),
        "sample": 1 / first.fs_hz,
        "sampling rate": first.fs_hz,
        "highest excited line": max(float(r.spectra.f_hz[r.spectra.excited][-1]) for r in problem.records),
        "1": 1.0,
    }
