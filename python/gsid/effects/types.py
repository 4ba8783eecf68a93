"""Physical effects: the catalogue, as described by the C library, and user-defined effects.

A user-defined effect is an expression, a table (a measured curve, or a residual torque curve of `gsid
diagnose`), or a descriptor compiled from C (include/gsid/effect.h). The C code that simulates and fits the
effects of the catalogue also simulates and fits these three.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gsid._lib import ffi, lib
from gsid.base.errors import InputError, close
from gsid.base.tables import Table

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
    lib.GSID_LINEAR_BACKLASH: "backlash",
    lib.GSID_LINEAR_LOOP: "loop",
    lib.GSID_LINEAR_DYNAMICS: "dynamics",
}
SPACINGS = {
    lib.GSID_SPACING_GEOMETRIC: "geometric",
    lib.GSID_SPACING_INVERSE: "inverse",
    lib.GSID_SPACING_FROM_END: "from_end",
    lib.GSID_SPACING_TURNS: "turns",
    lib.GSID_SPACING_LIST: "list",
    lib.GSID_SPACING_DECADES: "decades",
    lib.GSID_SPACING_ROUNDING: "rounding",
    lib.GSID_SPACING_PER: "per",
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
    """Start values of a parameter in the search for missing effects (include/gsid/effect_facts.h).

    Attributes
    ----------
    spacing : str
        Spacing of the points, one of `SPACINGS`.
    of : str
        Quantity that the points are relative to, one of `SCALES`.
    first, last, step : float
        In units of `of`. Their meaning depends on the spacing.
    n : int
        Number of points; 0 if `step` determines it.
    points : tuple of float
        The points of the spacings "list" and "per".
    reason : str
        Reason for this choice.
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
        """Compute the points for a given scale.

        Parameters
        ----------
        scale : float
            Value of the quantity `of` in this motion.

        Returns
        -------
        (n,) ndarray
        """
        if self.spacing == "list":
            return scale * np.array(self.points)
        if self.spacing == "per":
            return np.array(self.points) / scale
        if self.spacing == "turns":
            return np.arange(self.first / scale, self.last / scale, self.step / scale)
        if self.spacing == "rounding":
            return scale / np.arange(self.first, self.last, self.step)
        if self.spacing == "decades":
            lowest, highest = self.first * scale, self.last * scale
            decades = 10.0 ** np.arange(np.floor(np.log10(lowest)), np.log10(scale))
            points = np.outer(decades, self.points).ravel()
            return points[(points >= lowest) & (points <= highest)]
        shares = np.geomspace(self.first, self.last, self.n)
        if self.spacing == "from_end":
            return (1 - shares) * scale
        return scale * shares if self.spacing == "geometric" else 1 / (scale * shares)


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes
    ----------
    name, unit : str
    typical : float
        Typical value of a gimbal, in `unit`.
    lower, upper : float
        Values outside are refused, except `null_value`. Infinite means no bound.
    null_value : float or None
        Value at which the effect vanishes. None: a shape parameter, which has no meaning without the effect.
    in_response : bool
        Whether the response of the linear part determines it.
    axis_field : str or None
        Its name in the simulated axis (include/gsid/host/axis.h); None: the axis does not have this law.
    grid : Grid or None
        Start values in the search for missing effects.
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
        """Return the parameter as in the output of `gsid effects --json`."""
        entry = dict(vars(self))
        del entry["axis_field"]
        return entry | {"grid": self.grid and vars(self.grid) | {"points": list(self.grid.points)}}


@dataclass(frozen=True, repr=False)
class EffectType:
    """An effect of the catalogue, or a user-defined one: :func:`expression`, :func:`table`, :func:`load`.

    Attributes
    ----------
    id, sentence : str
        Name of the effect, and a description in one sentence.
    confused_with : tuple of str
        Effects with a similar signature in the data.
    stage : {"controller", "actuator", "torque", "structure", "sensor"}
        Place in the chain from command to output.
    null_kind : {"smooth", "one_sided", "threshold", "never"}
        Validity of the derivative with respect to its strength at the null value. "never": a plant always has
        the effect, or the effect is known.
    parameters : tuple of EffectParameter
    law : str
        The law in readable form: u command, w rate, theta angle, y output; may be empty.
    as_c : str or None
        The law in C, with {parameter} for values. None: it is not exported, or its linear part is exported.
    linear_part : str or None
        Form of its linear part in the frequency domain, one of `LINEAR_PARTS`.
    turns_only : bool
        Whether the law requires an angle. Such a law has no meaning for an axis whose unit is a length.
    simpler : str or None
        Simpler law that it becomes for special values of its shape parameters.
    enlarged : tuple of str
        Similar laws from outside the catalogue, as expressions with the coefficient c. If one of them
        explains the data better, this law is not the missing one.
    not_searched : str or None
        Why the search for missing effects omits it; None: the search includes it.
    definition : dict
        Keys of a user-defined effect in a model file besides id and parameters; empty in the catalogue.
    c, data : cffi pointers
        The gsid_effect, and the data that its functions need besides the values.
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
    enlarged: tuple[str, ...] = ()
    not_searched: str | None = None
    definition: Mapping[str, Any] = field(default_factory=dict)
    c: Any = field(default=None, compare=False)
    data: Any = field(default=None, compare=False)
    keep: tuple = field(default=(), compare=False)  # memory that c and data point to

    def __deepcopy__(self, memo: dict) -> EffectType:
        return self  # immutable, and C memory cannot be copied

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
        """Return the effect as in the output of `gsid effects --json`."""
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
            "enlarged": list(self.enlarged),
            "not_searched": self.not_searched,
            "parameters": [parameter.to_dict() for parameter in self.parameters],
        }

    def _table(self) -> Table:
        rows = [
            (p.name, p.unit or "1", f"{p.typical:g}", f"{p.lower:g} .. {p.upper:g}") for p in self.parameters
        ]
        return Table(("parameter", "unit", "typical", "bounds"), rows, title=f"{self.id}: {self.sentence}")

    def __repr__(self) -> str:
        lines = [f"{self.id} ({self.stage}): {self.sentence}"]
        lines += [f"  {self.law}"] if self.law else []
        lines += [
            f"  {name:18} {unit:22} typical {typical:10} {bounds}"
            for name, unit, typical, bounds in self._table().rows
        ]
        if self.confused_with:
            lines.append(f"  easily confused with {', '.join(self.confused_with)}")
        if self.not_searched:
            lines.append(f"  not searched by gsid diagnose: {self.not_searched}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return self._table().html()


@functools.cache
def catalogue() -> dict[str, EffectType]:
    """Return all effects of the library by id, in the order of the chain from command to output."""
    types = [_with_facts(lib.gsid_catalogue_facts[i]) for i in range(lib.gsid_n_catalogue)]
    return {effect.id: effect for effect in types}


def linear_part(effect: str) -> EffectType | None:
    """Return an effect of the catalogue if it has a linear part, else None.

    Parameters
    ----------
    effect : str
    """
    known = catalogue().get(effect)
    return known if known is not None and known.linear_part else None


def find(effect: str, where: str = "") -> EffectType:
    """Find an effect by its id.

    Parameters
    ----------
    effect : str
    where : str
        File or place that names it, for the error message.

    Raises
    ------
    InputError
        The effect is unknown. The hint names the closest one.
    """
    known = catalogue() | LOADED
    if effect in known:
        return known[effect]
    hint = (
        close(effect, known) or "`gsid effects` lists all effects; `gsid add --help` shows how to add others"
    )
    raise InputError("unknown effect", where, effect, hint)


LOADED: dict[str, EffectType] = {}


# ---- conversion from C ---------------------------------------------------------------------------------


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
    """Make an effect of the catalogue from its descriptor and its further facts."""
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
        enlarged=tuple(law.strip() for law in read_text(facts.enlarged).split(";") if law.strip()),
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
