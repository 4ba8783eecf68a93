"""The catalogue of physical effects, as the C library describes them."""

from __future__ import annotations

import difflib
import functools
import html
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from gsid._lib import ffi, lib
from gsid.errors import InputError

STAGES = {
    lib.GSID_STAGE_CONTROLLER: "controller",
    lib.GSID_STAGE_ACTUATOR: "actuator",
    lib.GSID_STAGE_TORQUE: "torque",
    lib.GSID_STAGE_STRUCTURE: "structure",
    lib.GSID_STAGE_SENSOR: "sensor",
}
NULL_KINDS = {
    lib.GSID_NULL_SMOOTH: "smooth",
    lib.GSID_NULL_ONE_SIDED: "one_sided",
    lib.GSID_NULL_THRESHOLD: "threshold",
    lib.GSID_NULL_NEVER: "never",
}


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes
    ----------
    name, unit : str
    typical : float
        Of a gimbal, in `unit`.
    lower, upper : float
        Values outside are refused, except `null_value`; infinite where there is no bound.
    null_value : float or None
        The effect vanishes here; None: a shape, without meaning when the effect is absent.
    """

    name: str
    unit: str
    typical: float
    lower: float
    upper: float
    null_value: float | None


@dataclass(frozen=True, repr=False)
class EffectType:
    """One effect of the catalogue.

    Attributes
    ----------
    id, sentence : str
    confused_with : tuple of str
        Effects that it is easily taken for.
    stage : {"controller", "actuator", "torque", "structure", "sensor"}
        Where in the chain from command to output it acts.
    null_kind : {"smooth", "one_sided", "threshold", "never"}
        What the derivative by its strength is worth where it vanishes; "never": the plant is not one
        without it, or it is known.
    parameters : tuple of EffectParameter
    """

    id: str
    sentence: str
    confused_with: tuple[str, ...]
    stage: str
    null_kind: str
    parameters: tuple[EffectParameter, ...]

    def __getitem__(self, name: str) -> EffectParameter:
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(name)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    def to_dict(self) -> dict[str, Any]:
        """The entry of `gsid effects --json`."""
        return {
            "effect": self.id,
            "stage": self.stage,
            "sentence": self.sentence,
            "null_kind": self.null_kind,
            "confused_with": list(self.confused_with),
            "parameters": [vars(parameter) for parameter in self.parameters],
        }

    def _rows(self) -> list[tuple[str, str, str, str]]:
        return [
            (p.name, p.unit or "1", f"{p.typical:g}", f"{p.lower:g} .. {p.upper:g}") for p in self.parameters
        ]

    def __repr__(self) -> str:
        lines = [f"{self.id} ({self.stage}): {self.sentence}"]
        lines += [
            f"  {name:18} {unit:22} typical {typical:10} {bounds}"
            for name, unit, typical, bounds in self._rows()
        ]
        if self.confused_with:
            lines.append(f"  easily taken for {', '.join(self.confused_with)}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{title}</th>" for title in ("parameter", "unit", "typical", "bounds"))
        rows = "".join(
            "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>"
            for row in self._rows()
        )
        caption = html.escape(f"{self.id}: {self.sentence}")
        return f"<table><caption>{caption}</caption><tr>{head}</tr>{rows}</table>"


@functools.cache
def catalogue() -> dict[str, EffectType]:
    """Every effect that the library knows, by id, in the order of the chain from command to output."""
    types = [_read(lib.gsid_catalogue[i]) for i in range(lib.gsid_n_catalogue)]
    return {effect.id: effect for effect in types}


def find(effect: str, where: str = "") -> EffectType:
    """Look an effect up.

    Parameters
    ----------
    effect : str
    where : str
        What named it, for the message.

    Raises
    ------
    InputError
        There is no such effect; the hint names close ones.
    """
    known = catalogue()
    if effect in known:
        return known[effect]
    raise InputError(
        "unknown effect", where, effect, close(effect, known) or "`gsid effects` lists what there is"
    )


def close(name: str, names: Iterable[str]) -> str:
    """ "did you mean ...?", or nothing when no name is close."""
    matches = difflib.get_close_matches(name, list(names), n=1)
    return f"did you mean {matches[0]}?" if matches else ""


def _read(effect: Any) -> EffectType:
    confused = _text(effect.confused_with)
    return EffectType(
        id=_text(effect.id),
        sentence=_text(effect.sentence),
        confused_with=tuple(name.strip() for name in confused.split(",") if name.strip()),
        stage=STAGES[effect.stage],
        null_kind=NULL_KINDS[effect.null_kind],
        parameters=tuple(_read_parameter(effect.parameter[i]) for i in range(effect.n_parameters)),
    )


def _read_parameter(parameter: Any) -> EffectParameter:
    return EffectParameter(
        name=_text(parameter.name),
        unit=_text(parameter.unit),
        typical=parameter.typical,
        lower=parameter.lower,
        upper=parameter.upper,
        null_value=None if math.isnan(parameter.null_value) else parameter.null_value,
    )


def _text(pointer: Any) -> str:
    return "" if pointer == ffi.NULL else ffi.string(pointer).decode()
