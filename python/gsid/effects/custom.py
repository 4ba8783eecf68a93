"""User-defined effects: a torque law given as an expression, as a table of points, or as compiled C code."""

from __future__ import annotations

import ctypes
import dataclasses
import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.errors import InputError
from gsid.effects.table_file import read_table, short_name
from gsid.effects.types import (
    LOADED,
    NULL_KINDS,
    STAGES,
    EffectParameter,
    EffectType,
    catalogue,
    read_text,
    read_type,
)


def entry_keys(effect: str) -> tuple[str, ...]:
    """Return the keys that an entry of a model file may have, for the id of its effect."""
    special = {EXPRESSION: ("torque", "bounds"), TABLE: ("variable", "unit", "at", "torque")}
    return ("effect", "params", *special.get(effect, ("library",)))


def of_entry(entry: Mapping[str, Any], where: str = "") -> EffectType | None:
    """Make the user-defined effect that an entry of a model file describes; None for a catalogue effect.

    Parameters
    ----------
    entry : mapping
        {"effect": id, "params": {name: value or {"value": value}}, ...}.
    where : str
        File and entry, for error messages.

    Raises
    ------
    InputError
        The description is wrong, or the effect belongs to a library that was not loaded.
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
    if "library" in entry and effect not in LOADED:
        typed = shlex.join(["gsid", "--library", str(entry["library"])])
        hint = f"load the library explicitly, which runs its code: {typed} ..., or gsid.effects.load"
        raise InputError("the effect belongs to a library that was not loaded", where, effect, hint)
    return LOADED.get(effect)


# ---- user-defined effects ------------------------------------------------------------------------------

EXPRESSION, TABLE = "expression", "table"
ANY = 1e9  # bound of a parameter without a natural bound
TABLE_KINDS = {"w": lib.GSID_TABLE_RATE, "theta": lib.GSID_TABLE_ANGLE, "u": lib.GSID_TABLE_COMMAND}


def expression(
    text: str, params: Mapping[str, float], *, bounds: Mapping[str, Sequence[float]] | None = None
) -> EffectType:
    """Make an effect from a torque law written as an expression.

    Parameters
    ----------
    text : str
        Torque over inertia, positive against the motion, unit of angle / s^2, for example "c*tanh(w/0.1)".
        `gsid.effects.law_text` describes the syntax.
    params : dict of float
        Names of the parameters, and their start values for a fit.
    bounds : dict of (lo, hi), optional
        Limits of the parameters.

    Returns
    -------
    EffectType

    Raises
    ------
    InputError
        The text is not a valid expression, or a parameter is not valid.
    """
    from gsid.effects.law_text import as_c, is_reserved, parse

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
            hint = "w, theta, u and the names of functions are reserved"
            raise InputError("not a valid parameter name", text, name, hint)
    parameters = tuple(_parameter(text, name, params[name], limits[name]) for name in params)
    steps = parse(text, list(params))
    law, tape = as_c(steps, ffi)
    c, keep = _descriptor(EXPRESSION, text, parameters)
    if lib.gsid_expression_effect(law, c) != lib.GSID_OK:
        most = f"{lib.GSID_EXPRESSION_DEPTH_MAX} open terms at a time"
        hint = f"the limit is {most}: write it with fewer levels of parentheses"
        raise InputError("the torque law is nested too deeply", text, None, hint)
    definition = {"torque": text} | ({"bounds": {k: list(v) for k, v in bounds.items()}} if bounds else {})
    sentence = f"Torque {text}."
    return _torque_law(EXPRESSION, sentence, "smooth", parameters, definition, c, (law, tape, *keep))


def table(source: Any, *, unit: str = "") -> EffectType:
    """Make an effect from a torque law given by points: cubic interpolation, linear extrapolation.

    Parameters
    ----------
    source : path, or (variable, at, torque)
        A CSV file with a header `w,torque`, `theta,torque` or `u,torque`, as `gsid diagnose --curve` writes;
        or the name of the variable and the points. Torque is over inertia, positive against the motion.
    unit : str
        Unit of the variable if the file does not state one. "" means the unit of the model.

    Returns
    -------
    EffectType
        Its only parameter is a scale.

    Raises
    ------
    InputError
        The file cannot be read, there are too few points, a value is not a number, or two points have the
        same abscissa.
    """
    where = ""
    if isinstance(source, str | Path):
        where = str(source)
        variable, at, torque, unit_of_file = read_table(source)
        unit = unit_of_file or unit
    else:
        name, at, torque = source
        variable = short_name(name)
    x, law, slope = _points(at, torque, where)
    struct = ffi.new("gsid_table *", {"variable": TABLE_KINDS[variable], "n_points": len(x)})
    arrays = [ffi.from_buffer("double[]", each) for each in (x, law, slope)]
    struct.at, struct.torque, struct.slope = arrays
    parameters = (EffectParameter("scale", "", 1.0, -ANY, ANY, 0.0),)
    sentence = f"Torque by a table of {len(x)} points over {variable}."
    c, keep = _descriptor(TABLE, sentence, parameters)
    check(lib.gsid_table_effect(struct, c), "making an effect of a table")
    definition = {"variable": variable, "at": x.tolist(), "torque": law.tolist()}
    definition |= {"unit": unit} if unit else {}
    return _torque_law(TABLE, sentence, "smooth", parameters, definition, c, (struct, *arrays, *keep))


def load(library: str | Path, name: str) -> EffectType:
    """Load an effect compiled from C. Model files and :func:`find` then accept its id.

    This runs code of the shared object in this process, without protection. Load only code that you trust. A
    model file alone never loads a library.

    Parameters
    ----------
    library : path
        Shared object, made by `cc -shared -fPIC -Iinclude my_effect.c -o my_effect.so`.
    name : str
        Name of its gsid_effect, the argument of GSID_SHARE_EFFECT(name).

    Returns
    -------
    EffectType

    Raises
    ------
    InputError
        The library cannot be loaded, does not contain the effect, or was compiled for another version or
        precision.
    """
    path = Path(library).expanduser().resolve()
    where = str(library)
    if not path.is_file():
        raise InputError(
            "the shared object does not exist", where, None, "compile it first: cc -shared -fPIC ..."
        )
    try:
        shared = ctypes.CDLL(str(path))
    except OSError as error:
        hint = "if it calls functions of gsid, link it with build/double/libgsid_core.a"
        raise InputError(f"the shared object cannot be loaded: {error}", where, None, hint) from error
    try:
        found = ffi.cast(
            "gsid_shared_effect *", ctypes.addressof(ctypes.c_char.in_dll(shared, f"{name}_shared_f64"))
        )
    except ValueError:
        hint = f"write GSID_SHARE_EFFECT({name}); after its definition, and compile it in double precision"
        raise InputError("the shared object does not contain the effect", where, name, hint) from None
    if found.size != ffi.sizeof("gsid_effect"):
        hint = "compile it again with this version's include/gsid/effect.h"
        raise InputError("the effect was compiled for another version of gsid", where, name, hint)
    effect = _checked(found.effect, where)
    known = dataclasses.replace(effect, definition={"library": f"{where}:{name}"}, keep=(shared,))
    LOADED[known.id] = known
    return known


def _checked(c: Any, where: str) -> EffectType:
    """Check the descriptor of a loaded effect and read it."""
    functions = ("linear", "torque", "command", "control", "refresh_hz", "disturbance")
    wrong = ""
    if ffi.NULL in (c.id, c.sentence) or not read_text(c.id):
        wrong = "it has no id or sentence"
    elif read_text(c.id) in catalogue() or read_text(c.id) in (EXPRESSION, TABLE):
        wrong = f"its id {read_text(c.id)} is reserved by gsid"
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
    return read_type(c)


def _parameter(text: str, name: str, start: Any, limits: Sequence[float]) -> EffectParameter:
    where = f"{text}: {name}"
    try:
        start, (lower, upper) = float(start), (float(limit) for limit in limits)
    except (TypeError, ValueError):
        raise InputError("a parameter or its bounds are not numbers", where, start) from None
    if not (math.isfinite(start) and lower <= start <= upper):
        raise InputError(
            "a value is out of its bounds", where, f"{start:g}", f"the bounds are {lower:g} .. {upper:g}"
        )
    # A parameter that may be 0 is a strength; its start value gives the typical size. Any other is a shape.
    return EffectParameter(name, "", abs(start) or 1.0, lower, upper, 0.0 if lower <= 0 <= upper else None)


def _points(at: Any, torque: Any, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sort the points in ascending order, and compute the slopes (TAB-1)."""
    try:
        at, torque = np.asarray(at, float), np.asarray(torque, float)
    except (TypeError, ValueError):
        raise InputError("the points of a table are not numbers", where) from None
    n, least, most = at.size, lib.GSID_TABLE_POINTS_MIN, lib.GSID_TABLE_POINTS_MAX
    if at.ndim != 1 or at.shape != torque.shape or not least <= n <= most:
        what = "a table needs two lists of equal length, abscissas and torques"
        raise InputError(what, where, f"{n} and {torque.size}", f"{least} .. {most} points")
    if not np.all(np.isfinite(at) & np.isfinite(torque)):
        bad = int(np.flatnonzero(~(np.isfinite(at) & np.isfinite(torque)))[0])
        raise InputError("a point of a table is not finite", where, f"point {bad + 1}")
    order = np.argsort(at, kind="stable")
    at, torque = np.ascontiguousarray(at[order]), np.ascontiguousarray(torque[order])
    if np.any(np.diff(at) == 0):
        twice = at[1:][np.diff(at) == 0][0]
        raise InputError(
            "two points of a table have the same abscissa", where, f"{twice:g}", "remove one of them"
        )
    slope = np.empty(n)
    arrays = [ffi.from_buffer("double[]", x) for x in (at, torque, slope)]
    check(lib.gsid_table_slopes(n, *arrays), "finding the slopes of a table")
    return at, torque, slope


def _descriptor(effect: str, sentence: str, parameters: Sequence[EffectParameter]) -> tuple[Any, list[Any]]:
    """Make a gsid_effect without its functions, and the texts that it points to."""
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


def _torque_law(
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
