"""Physical effects: the catalogue, as the C library describes it, and those of the user's own.

An effect of your own is an expression, a table (a curve that was measured, or that `gsid diagnose` left
unexplained), or a descriptor compiled from C, see include/gsid/effect.h. All three are simulated and fitted
by the same C code as the catalogue's.
"""

from __future__ import annotations

import dataclasses
import functools
import html
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gsid._lib import ffi, lib
from gsid.base.errors import InputError, close

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
LINEAR_PARTS = {
    lib.GSID_LINEAR_NONE: None,
    lib.GSID_LINEAR_GAIN: "gain",
    lib.GSID_LINEAR_DAMPING: "damping",
    lib.GSID_LINEAR_SPRING: "spring",
    lib.GSID_LINEAR_PENDULUM: "pendulum",
    lib.GSID_LINEAR_DELAY: "delay",
    lib.GSID_LINEAR_LAG: "lag",
    lib.GSID_LINEAR_HOLD: "hold",
    lib.GSID_LINEAR_MODE: "mode",
    lib.GSID_LINEAR_JOINT: "joint",
    lib.GSID_LINEAR_LOOP: "loop",
}
SPACINGS = {
    lib.GSID_SPACING_GEOMETRIC: "geometric",
    lib.GSID_SPACING_INVERSE: "inverse",
    lib.GSID_SPACING_FROM_END: "from_end",
    lib.GSID_SPACING_TURNS: "turns",
    lib.GSID_SPACING_LIST: "list",
    lib.GSID_SPACING_DECADES: "decades",
    lib.GSID_SPACING_ROUNDING: "rounding",
}
SCALES = {
    lib.GSID_SHARE_OF_RATE: "largest rate",
    lib.GSID_SHARE_OF_ANGLE: "largest angle",
    lib.GSID_SHARE_OF_TRAVEL: "travel",
    lib.GSID_SHARE_OF_COMMAND: "largest command",
    lib.GSID_SHARE_OF_SAMPLE: "sample",
    lib.GSID_SHARE_OF_FS: "sampling rate",
    lib.GSID_SHARE_OF_BAND: "highest excited line",
    lib.GSID_SHARE_OF_ONE: "1",
}


@dataclass(frozen=True)
class Grid:
    """Points of a parameter at which the search for missing effects begins; include/gsid/effect_facts.h.

    Attributes
    ----------
    spacing : str
        How the points lie, of `SPACINGS`.
    of : str
        What they are shares of, of `SCALES`.
    first, last, step : float
        In units of `of`; meaning by the spacing.
    n : int
        Number of points; 0 where `step` gives it.
    points : tuple of float
        Of a list.
    reason : str
    """

    spacing: str
    of: str
    first: float
    last: float
    step: float
    n: int
    points: tuple[float, ...]
    reason: str

    def at(self, scale: float) -> np.ndarray:
        """The points, for the size of what they are shares of.

        Parameters
        ----------
        scale : float
            Of this motion, in the unit of `of`.

        Returns
        -------
        (n,) ndarray
        """
        if self.spacing == "list":
            return scale * np.array(self.points)
        if self.spacing == "turns":
            return np.arange(self.first / scale, self.last / scale, self.step / scale)
        if self.spacing == "rounding":
            points = [self.first * scale]
            for _ in range(self.n):
                points.append(points[-1] - self.gap(scale, points[-1]))
            return np.array(points)
        if self.spacing == "decades":
            lowest, highest = self.first * scale, self.last * scale
            decades = 10.0 ** np.arange(np.floor(np.log10(lowest)), np.log10(scale))
            points = np.outer(decades, self.points).ravel()
            return points[(points >= lowest) & (points <= highest)]
        shares = np.geomspace(self.first, self.last, self.n)
        if self.spacing == "from_end":
            return (1 - shares) * scale
        return scale * shares if self.spacing == "geometric" else 1 / (scale * shares)

    def gap(self, scale: float, point: float) -> float:
        """Distance of neighbours of the spacing "rounding".

        Parameters
        ----------
        scale, point : float
        """
        return point**2 / (self.step * scale)


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
    in_response : bool
        The response of the linear part determines it.
    axis_field : str or None
        What the simulated axis calls it (include/gsid/host/axis.h); None: the axis has no such law.
    grid : Grid or None
        Where the search for missing effects begins.
    """

    name: str
    unit: str
    typical: float
    lower: float
    upper: float
    null_value: float | None
    in_response: bool = False
    axis_field: str | None = None
    grid: Grid | None = None

    def to_dict(self) -> dict[str, Any]:
        """Its part of the entry of `gsid effects --json`."""
        entry = dict(vars(self))
        del entry["axis_field"]
        return entry | {"grid": self.grid and vars(self.grid) | {"points": list(self.grid.points)}}


@dataclass(frozen=True, repr=False)
class EffectType:
    """One effect of the catalogue, or one of your own: :func:`expression`, :func:`table`, :func:`load`.

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
    law : str
        For a reader: u command, w rate, theta angle, y output; "" where none is written.
    as_c : str or None
        The law in C, with {parameter} for values; None: it is not exported, or by its linear part.
    linear_part : str or None
        Form of its linear part in the frequency domain, of `LINEAR_PARTS`.
    turns_only : bool
        The law takes an angle: it has no meaning for an axis whose unit is a length.
    simpler : str or None
        The law that it becomes at one end of its shapes.
    not_searched : str or None
        Why the search for missing effects leaves it out; None: it is searched.
    definition : dict
        What a model file says of an effect of your own besides its id and parameters; empty in the catalogue.
    c, data : cffi pointers
        The gsid_effect, and what its functions need besides the values.
    """

    id: str
    sentence: str
    confused_with: tuple[str, ...]
    stage: str
    null_kind: str
    parameters: tuple[EffectParameter, ...]
    law: str = ""
    as_c: str | None = None
    linear_part: str | None = None
    turns_only: bool = False
    simpler: str | None = None
    not_searched: str | None = None
    definition: Mapping[str, Any] = field(default_factory=dict)
    c: Any = field(default=None, compare=False)
    data: Any = field(default=None, compare=False)
    keep: tuple = field(default=(), compare=False)  # memory that c and data point to

    def __deepcopy__(self, memo: dict) -> EffectType:
        return self  # never changed; and memory of C cannot be copied

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
            "law": self.law,
            "linear_part": self.linear_part,
            "turns_only": self.turns_only,
            "simpler": self.simpler,
            "not_searched": self.not_searched,
            "parameters": [parameter.to_dict() for parameter in self.parameters],
        }

    def _rows(self) -> list[tuple[str, str, str, str]]:
        return [
            (p.name, p.unit or "1", f"{p.typical:g}", f"{p.lower:g} .. {p.upper:g}") for p in self.parameters
        ]

    def __repr__(self) -> str:
        lines = [f"{self.id} ({self.stage}): {self.sentence}"]
        lines += [f"  {self.law}"] if self.law else []
        lines += [
            f"  {name:18} {unit:22} typical {typical:10} {bounds}"
            for name, unit, typical, bounds in self._rows()
        ]
        if self.confused_with:
            lines.append(f"  easily taken for {', '.join(self.confused_with)}")
        if self.not_searched:
            lines.append(f"  not searched by gsid diagnose: {self.not_searched}")
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
    types = [_with_facts(lib.gsid_catalogue_facts[i]) for i in range(lib.gsid_n_catalogue)]
    return {effect.id: effect for effect in types}


def linear_part(effect: str) -> EffectType | None:
    """The effect of an id if it has a linear part, else None; an id outside the catalogue has none.

    Parameters
    ----------
    effect : str
    """
    known = catalogue().get(effect)
    return known if known is not None and known.linear_part else None


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
    known = catalogue() | LOADED
    if effect in known:
        return known[effect]
    hint = close(effect, known) or "`gsid effects` lists what there is; `gsid add --help` how to add others"
    raise InputError("unknown effect", where, effect, hint)


LOADED: dict[str, EffectType] = {}


# ---- reading the library ---------------------------------------------------------------------------------


def read_type(effect: Any) -> EffectType:
    confused = read_text(effect.confused_with)
    return EffectType(
        id=read_text(effect.id),
        sentence=read_text(effect.sentence),
        confused_with=tuple(name.strip() for name in confused.split(",") if name.strip()),
        stage=STAGES[effect.stage],
        null_kind=NULL_KINDS[effect.null_kind],
        parameters=tuple(_read_parameter(effect.parameter[i]) for i in range(effect.n_parameters)),
        c=effect,
        data=ffi.NULL,
    )


def _with_facts(facts: Any) -> EffectType:
    """An effect of the catalogue: its descriptor, and the facts that stand beside it."""
    known = read_type(facts.effect)
    parameters = tuple(
        dataclasses.replace(
            parameter,
            in_response=bool(more.in_response),
            axis_field=read_text(more.axis_field) or None,
            grid=_read_grid(more.grid),
        )
        for parameter, more in zip(known.parameters, facts.parameter, strict=False)  # C has room for more
    )
    return dataclasses.replace(
        known,
        parameters=parameters,
        law=read_text(facts.law),
        as_c=read_text(facts.as_c) or None,
        linear_part=LINEAR_PARTS[facts.linear_part],
        turns_only=bool(facts.turns_only),
        simpler=read_text(facts.simpler) or None,
        not_searched=read_text(facts.not_searched) or None,
    )


def _read_grid(grid: Any) -> Grid | None:
    if grid.spacing == lib.GSID_SPACING_NONE:
        return None
    points = tuple(grid.list[0 : grid.n]) if grid.list != ffi.NULL else ()
    spacing, of = SPACINGS[grid.spacing], SCALES[grid.of]
    return Grid(spacing, of, grid.first, grid.last, grid.step, grid.n, points, read_text(grid.reason))


def _read_parameter(parameter: Any) -> EffectParameter:
    return EffectParameter(
        name=read_text(parameter.name),
        unit=read_text(parameter.unit),
        typical=parameter.typical,
        lower=parameter.lower,
        upper=parameter.upper,
        null_value=None if math.isnan(parameter.null_value) else parameter.null_value,
    )


def read_text(pointer: Any) -> str:
    return "" if pointer == ffi.NULL else ffi.string(pointer).decode()
