"""Physical effects: the catalogue, as the C library describes it, and those of the user's own.

An effect of your own is an expression, a table (a curve that was measured, or that `gsid diagnose` left
unexplained), or a descriptor compiled from C, see include/gsid/effect.h. All three are simulated and fitted
by the same C code as the catalogue's.
"""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import html
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.errors import InputError, close
from gsid.tables import read_table, short_name

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
    known = catalogue() | _loaded
    if effect in known:
        return known[effect]
    hint = close(effect, known) or "`gsid effects` lists what there is; `gsid add --help` how to add others"
    raise InputError("unknown effect", where, effect, hint)


_loaded: dict[str, EffectType] = {}


def entry_keys(effect: str) -> tuple[str, ...]:
    """Keys that an entry of a model file may have, by the id of its effect."""
    own = {EXPRESSION: ("torque", "bounds"), TABLE: ("variable", "unit", "at", "torque")}
    return ("effect", "params", *own.get(effect, ("library",)))


def of_entry(entry: Mapping[str, Any], where: str = "") -> EffectType | None:
    """The effect of one's own that an entry of a model file describes; None for one of the catalogue.

    Parameters
    ----------
    entry : mapping
        {"effect": id, "params": {name: value or {"value": value}}, ...}.
    where : str
        For messages.

    Raises
    ------
    InputError
        The description is wrong, or it is of a library that was not loaded.
    """
    effect = entry["effect"]
    try:
        if effect == EXPRESSION:
            start = {n: v["value"] if isinstance(v, Mapping) else v for n, v in entry["params"].items()}
            return expression(entry["torque"], start, bounds=entry.get("bounds"))
        if effect == TABLE:
            return table((entry["variable"], entry["at"], entry["torque"]), unit=entry.get("unit", ""))
    except KeyError as error:
        raise InputError(f"the description of the {effect} lacks {error}", where) from error
    except InputError as error:
        raise InputError(error.what, f"{where} {error.where}".strip(), error.value, error.hint) from error
    if "library" in entry and effect not in _loaded:
        typed = shlex.join(["gsid", "--library", str(entry["library"])])
        hint = f"its code runs only when you say so: {typed} ..., or gsid.effects.load"
        raise InputError("the effect is of a library that was not loaded", where, effect, hint)
    return _loaded.get(effect)


# ---- effects of one's own ------------------------------------------------------------------------------

EXPRESSION, TABLE = "expression", "table"
ANY = 1e9  # bound of what has no natural one
TABLE_KINDS = {"w": lib.GSID_TABLE_RATE, "theta": lib.GSID_TABLE_ANGLE, "u": lib.GSID_TABLE_COMMAND}


def expression(
    text: str, params: Mapping[str, float], *, bounds: Mapping[str, Sequence[float]] | None = None
) -> EffectType:
    """A torque law written as an expression.

    Parameters
    ----------
    text : str
        Torque over inertia against the motion, unit of angle / s^2, for example "c*tanh(w/0.1)"; see
        `gsid.expression` for what it may have.
    params : dict of float
        Its parameters and where a fit starts.
    bounds : dict of (lo, hi), optional
        Limits of parameters.

    Returns
    -------
    EffectType

    Raises
    ------
    InputError
        The text is no such expression, or a parameter is not as it must be.
    """
    from gsid.expression import as_c, is_reserved, parse

    if not isinstance(text, str):
        raise InputError("a torque law is not text", "", text, "write it as in c*tanh(w/0.1)")
    for what, given in (("params", params), ("bounds", bounds or {})):
        if not isinstance(given, Mapping):
            raise InputError(f"{what} of a torque law are not given by name", text, given)
    params, limits = dict(params), {name: (-ANY, ANY) for name in params} | dict(bounds or {})
    if len(params) > lib.GSID_EFFECT_PARAMETERS_MAX:
        most = f"{len(params)} of at most {lib.GSID_EFFECT_PARAMETERS_MAX}"
        raise InputError("a torque law has too many parameters", text, most, "write some as numbers")
    for name in limits:
        if not name.isidentifier() or is_reserved(name) or name not in params:
            raise InputError("not a name of a parameter", text, name, "w, theta, u and functions have theirs")
    parameters = tuple(_own_parameter(text, name, params[name], limits[name]) for name in params)
    steps = parse(text, list(params))
    law, tape = as_c(steps, ffi)
    c, keep = _descriptor(EXPRESSION, text, parameters)
    if lib.gsid_expression_effect(law, c) != lib.GSID_OK:
        most = f"{lib.GSID_EXPRESSION_DEPTH_MAX} open terms at a time"
        raise InputError("the torque law nests too deep", text, None, f"it may have {most}: write it flatter")
    definition = {"torque": text} | ({"bounds": {k: list(v) for k, v in bounds.items()}} if bounds else {})
    return _own(EXPRESSION, f"Torque {text}.", "smooth", parameters, definition, c, (law, tape, *keep))


def table(source: Any, *, unit: str = "") -> EffectType:
    """A torque law given by points: a cubic between them, a line beyond.

    Parameters
    ----------
    source : path, or (variable, at, torque)
        A CSV file with a header `w,torque`, `theta,torque` or `u,torque`; what `gsid diagnose --curve`
        writes; or the name of the variable and the points: torque over inertia against the motion.
    unit : str
        Of the variable, where the source does not say; "" is believed to be the model's.

    Returns
    -------
    EffectType
        Its one parameter is a scale.

    Raises
    ------
    InputError
        The file cannot be read, or the points are too few, not numbers, or two at one place.
    """
    where = ""
    if isinstance(source, str | Path):
        where = str(source)
        variable, at, torque, said = read_table(source)
        unit = said or unit
    else:
        name, at, torque = source
        variable = short_name(name)
    at, torque, slope = _points(at, torque, where)
    struct = ffi.new("gsid_table *", {"variable": TABLE_KINDS[variable], "n_points": len(at)})
    arrays = [ffi.from_buffer("double[]", x) for x in (at, torque, slope)]
    struct.at, struct.torque, struct.slope = arrays
    parameters = (EffectParameter("scale", "", 1.0, -ANY, ANY, 0.0),)
    sentence = f"Torque by a table of {len(at)} points over {variable}."
    c, keep = _descriptor(TABLE, sentence, parameters)
    check(lib.gsid_table_effect(struct, c), "making an effect of a table")
    definition = {"variable": variable, "at": at.tolist(), "torque": torque.tolist()}
    definition |= {"unit": unit} if unit else {}
    return _own(TABLE, sentence, "smooth", parameters, definition, c, (struct, *arrays, *keep))


def load(library: str | Path, name: str) -> EffectType:
    """Load an effect compiled from C; from then on its id is known to model files and to :func:`find`.

    This runs code of the shared object, in this process and without any guard: load only what you trust. A
    model file does not load anything by itself.

    Parameters
    ----------
    library : path
        Shared object, made by `cc -shared -fPIC -Iinclude my_effect.c -o my_effect.so`.
    name : str
        Of the gsid_effect in it, which stands in GSID_SHARE_EFFECT(name).

    Returns
    -------
    EffectType

    Raises
    ------
    InputError
        It cannot be loaded, has no such effect, or was compiled for another version or precision.
    """
    path = Path(library).expanduser().resolve()
    where = str(library)
    if not path.is_file():
        raise InputError(
            "there is no such shared object", where, None, "compile it first: cc -shared -fPIC ..."
        )
    try:
        shared = ctypes.CDLL(str(path))
    except OSError as error:
        hint = "functions of gsid that it calls are linked in with build/double/libgsid_core.a"
        raise InputError(f"the shared object cannot be loaded: {error}", where, None, hint) from error
    try:
        found = ffi.cast(
            "gsid_shared_effect *", ctypes.addressof(ctypes.c_char.in_dll(shared, f"{name}_shared_f64"))
        )
    except ValueError:
        hint = f"write GSID_SHARE_EFFECT({name}); behind its definition, and compile it in double precision"
        raise InputError("the shared object has no such effect", where, name, hint) from None
    if found.size != ffi.sizeof("gsid_effect"):
        hint = "compile it again with this version's include/gsid/effect.h"
        raise InputError("the effect was compiled for another version of gsid", where, name, hint)
    effect = _checked(found.effect, where)
    known = dataclasses.replace(effect, definition={"library": f"{where}:{name}"}, keep=(shared,))
    _loaded[known.id] = known
    return known


def _checked(c: Any, where: str) -> EffectType:
    """What a descriptor says, when it can be true."""
    functions = ("linear", "torque", "command", "control", "refresh_hz", "disturbance")
    wrong = ""
    if ffi.NULL in (c.id, c.sentence) or not _text(c.id):
        wrong = "it has no id or sentence"
    elif _text(c.id) in catalogue() or _text(c.id) in (EXPRESSION, TABLE):
        wrong = f"its id {_text(c.id)} is one of gsid's own"
    elif c.n_parameters > lib.GSID_EFFECT_PARAMETERS_MAX:
        wrong = f"it has {c.n_parameters} parameters of at most {lib.GSID_EFFECT_PARAMETERS_MAX}"
    elif any(
        c.parameter[i].name == ffi.NULL or c.parameter[i].unit == ffi.NULL for i in range(c.n_parameters)
    ):
        wrong = "a parameter has no name or unit"
    elif c.stage not in STAGES or c.null_kind not in NULL_KINDS:
        wrong = "its stage or null_kind is unknown"
    elif all(getattr(c, function) == ffi.NULL for function in functions):
        wrong = "it has no function that does anything"
    if wrong:
        raise InputError(
            f"the effect's descriptor is wrong: {wrong}", where, None, "see include/gsid/effect.h"
        )
    return _read(c)


def _own_parameter(text: str, name: str, start: Any, limits: Sequence[float]) -> EffectParameter:
    where = f"{text}: {name}"
    try:
        start, (lower, upper) = float(start), (float(limit) for limit in limits)
    except (TypeError, ValueError):
        raise InputError("a parameter or its bounds are not numbers", where, start) from None
    if not (math.isfinite(start) and lower <= start <= upper):
        raise InputError(
            "a value is out of its bounds", where, f"{start:g}", f"it lies in {lower:g} .. {upper:g}"
        )
    # A parameter that may be 0 counts as a strength, of the size it starts with; any other is a shape.
    return EffectParameter(name, "", abs(start) or 1.0, lower, upper, 0.0 if lower <= 0 <= upper else None)


def _points(at: Any, torque: Any, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points in ascending order, and the slopes (TAB-1)."""
    try:
        at, torque = np.asarray(at, float), np.asarray(torque, float)
    except (TypeError, ValueError):
        raise InputError("the points of a table are not numbers", where) from None
    n, least, most = at.size, lib.GSID_TABLE_POINTS_MIN, lib.GSID_TABLE_POINTS_MAX
    if at.ndim != 1 or at.shape != torque.shape or not least <= n <= most:
        what = "a table needs as many torques as places, in two lists"
        raise InputError(what, where, f"{n} and {torque.size}", f"{least} .. {most} points")
    if not np.all(np.isfinite(at) & np.isfinite(torque)):
        bad = int(np.flatnonzero(~(np.isfinite(at) & np.isfinite(torque)))[0])
        raise InputError("a point of a table is not finite", where, f"point {bad + 1}")
    order = np.argsort(at, kind="stable")
    at, torque = np.ascontiguousarray(at[order]), np.ascontiguousarray(torque[order])
    if np.any(np.diff(at) == 0):
        twice = at[1:][np.diff(at) == 0][0]
        raise InputError("a table has two points at one place", where, f"{twice:g}", "leave one of them out")
    slope = np.empty(n)
    arrays = [ffi.from_buffer("double[]", x) for x in (at, torque, slope)]
    check(lib.gsid_table_slopes(n, *arrays), "finding the slopes of a table")
    return at, torque, slope


def _descriptor(effect: str, sentence: str, parameters: Sequence[EffectParameter]) -> tuple[Any, list[Any]]:
    """A gsid_effect without its functions, and the texts that it points to."""
    c = ffi.new("gsid_effect *")
    keep = [ffi.new("char[]", text.encode()) for text in (effect, sentence, "")]
    c.id, c.sentence, c.confused_with = keep
    c.n_parameters = len(parameters)
    for i, known in enumerate(parameters):
        texts = [ffi.new("char[]", text.encode()) for text in (known.name, known.unit)]
        keep += texts
        p = c.parameter[i]
        p.name, p.unit = texts
        p.typical, p.lower, p.upper = known.typical, known.lower, known.upper
        p.null_value = math.nan if known.null_value is None else known.null_value
    return c, keep


def _own(
    effect: str,
    sentence: str,
    null_kind: str,
    parameters: tuple[EffectParameter, ...],
    definition: dict[str, Any],
    c: Any,
    keep: tuple,
) -> EffectType:
    return EffectType(
        effect,
        sentence,
        (),
        "torque",
        null_kind,
        parameters,
        definition=definition,
        c=c,
        data=ffi.cast("void *", keep[0]),
        keep=keep,
    )


# ---- reading the library ---------------------------------------------------------------------------------


def _read(effect: Any) -> EffectType:
    confused = _text(effect.confused_with)
    return EffectType(
        id=_text(effect.id),
        sentence=_text(effect.sentence),
        confused_with=tuple(name.strip() for name in confused.split(",") if name.strip()),
        stage=STAGES[effect.stage],
        null_kind=NULL_KINDS[effect.null_kind],
        parameters=tuple(_read_parameter(effect.parameter[i]) for i in range(effect.n_parameters)),
        c=effect,
        data=ffi.NULL,
    )


def _with_facts(facts: Any) -> EffectType:
    """An effect of the catalogue: its descriptor, and the facts that stand beside it."""
    known = _read(facts.effect)
    parameters = tuple(
        dataclasses.replace(
            parameter,
            in_response=bool(more.in_response),
            axis_field=_text(more.axis_field) or None,
            grid=_read_grid(more.grid),
        )
        for parameter, more in zip(known.parameters, facts.parameter, strict=False)  # C has room for more
    )
    return dataclasses.replace(
        known,
        parameters=parameters,
        law=_text(facts.law),
        as_c=_text(facts.as_c) or None,
        linear_part=LINEAR_PARTS[facts.linear_part],
        turns_only=bool(facts.turns_only),
        simpler=_text(facts.simpler) or None,
        not_searched=_text(facts.not_searched) or None,
    )


def _read_grid(grid: Any) -> Grid | None:
    if grid.spacing == lib.GSID_SPACING_NONE:
        return None
    points = tuple(grid.list[0 : grid.n]) if grid.list != ffi.NULL else ()
    spacing, of = SPACINGS[grid.spacing], SCALES[grid.of]
    return Grid(spacing, of, grid.first, grid.last, grid.step, grid.n, points, _text(grid.reason))


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
