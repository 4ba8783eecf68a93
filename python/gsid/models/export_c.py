"""Export of a model as C for firmware: a state update per sample, and a friction feed-forward."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import numpy as np

from gsid._lib import version
from gsid.base.c_text import comment, literal, refused_name
from gsid.base.errors import InputError
from gsid.effects.types import EffectType, catalogue
from gsid.models.piecewise import PiecewiseModel
from gsid.models.rational import RationalModel
from gsid.plant.effect import Effect
from gsid.plant.model import PlantModel
from gsid.plant.units import RADIANS

#: Longest delay [samples]: each takes four bytes of the target's memory.
DELAY_MAX = 1_000_000
#: Tolerance of the stability test for rounding [rad/s]; integrators may be exported.
ROUNDING_RAD_S = 1e-6

# Linear parts that the step function includes. The descriptors contain the other laws in C
# (`EffectType.as_c`): maps of the command u, which become part of the step, and torques over inertia as
# functions of `rate` and `angle`, for the feed-forward.
LINEAR_PARTS = ("gain", "damping", "spring", "delay", "lag", "mode")


class _NoLiteral(ValueError):
    """A number outside the range of single precision."""


@dataclass
class CSource:
    """A model as C99 header and source, which depend on the standard library only.

    Attributes
    ----------
    name : str
        Prefix of the function names.
    header, source : str
    fs_hz : float
        Rate at which the step function must be called [Hz].
    n_states : int
    delay_samples : float
    feedforward : list of str
        Effects that the step omits and the feed-forward compensates.
    """

    name: str
    header: str
    source: str
    fs_hz: float
    n_states: int
    delay_samples: float
    feedforward: list[str] = field(default_factory=list)


@dataclass
class _Step:
    """x[n+1] = a x + early u[n-d-1] + late u[n-d], y[n] = c x + direct u[n-d-passed]."""

    a: np.ndarray
    early: np.ndarray
    late: np.ndarray
    c: np.ndarray
    direct: float
    n_delay: int
    passed: int
    delay_samples: float


def export_c(
    model: RationalModel | PlantModel, name: str = "model", *, fs_hz: float | None = None, where: str = ""
) -> CSource:
    """Export a model as C in single precision.

    The exported model assumes a command that is held over each sample. If the model was fitted with hold
    "none", its delay includes half a sample of its rate for the hold; this half sample is subtracted.

    Parameters
    ----------
    model : RationalModel or PlantModel
    name : str
        Prefix of the C functions; a C identifier.
    fs_hz : float, optional
        Rate of the loop [Hz]; default: the rate of the model.
    where : str
        File name of the model, for messages.

    Returns
    -------
    CSource

    Raises
    ------
    ValueError
        `name` is not a C identifier, or is reserved in C or C++; `fs_hz` is not a positive number.
    InputError
        The model is not stable, is not causal, has no rate, is in z with another rate, or contains an effect
        that cannot be exported; a number exceeds single precision; the delay exceeds `DELAY_MAX`.
    """
    if reason := refused_name(name):
        raise ValueError(f"{name!r} is not a valid name in C: {reason}; use another name, for example rig.c")
    if fs_hz is not None and not (math.isfinite(fs_hz) and fs_hz > 0):
        raise ValueError(f"fs_hz must be a positive number, not {fs_hz}")
    fs_hz = fs_hz or model.fs_hz
    if not fs_hz:
        raise InputError("the model does not state the rate of the loop", where, None, "give it with --fs")
    if isinstance(model, PiecewiseModel):
        hint = "export one of its pieces: PiecewiseModel.pieces[0].save(...)"
        raise InputError("a set of models has no time response", where, None, hint)
    try:
        if isinstance(model, PlantModel):
            return _export_plant(model, name, fs_hz, where)
        return _write(model, name, fs_hz, _rational_step(model, fs_hz, where), "", [], [])
    except _NoLiteral as error:
        hint = "the code is in single precision: use units in which the numbers are of ordinary size"
        raise InputError("the model has a number that cannot be exported", where, error, hint) from error


# ---- the linear part ---------------------------------------------------------------------------------------


def _rational_step(model: RationalModel, fs_hz: float, where: str) -> _Step:
    from scipy import signal

    if model.domain == "z":
        if abs(fs_hz / model.fs_hz - 1) > 1e-6:
            hint = "leave --fs out, or fit with --domain s"
            rates = f"{fs_hz:g} and {model.fs_hz:g} Hz"
            raise InputError("a model in z is valid at its own rate only", where, rates, hint)
        delay = model.delay_s * fs_hz
        if delay < 0 or abs(delay - round(delay)) > 1e-6:
            hint = "fit with --domain s, or with --delay of whole samples"
            raise InputError(
                "the delay of a model in z must be a whole number of samples", where, delay, hint
            )
        _refuse_long(delay, where)
        n = max(len(model.num), len(model.den))
        padded = [np.pad(row, (0, n - len(row))) for row in (model.num, model.den)]
        a, b, c, d = _schur(signal.tf2ss(*padded))
        _refuse_unstable(np.abs(np.linalg.eigvals(a)) > 1 + 1e-9, model.poles, where)
        return _Step(a, np.zeros(len(a)), b, c, d, round(delay), 0, round(delay))
    if model.n_zeros > model.n_poles:
        hint = "lower the number of zeros"
        what = "more zeros than poles: the output would contain a derivative of the command"
        raise InputError(what, where, f"{model.n_poles}/{model.n_zeros}", hint)
    delay_s = model.delay_s - (0.5 / (model.fs_hz or fs_hz) if model.hold == "none" else 0.0)
    return _held_step_of(_schur(signal.tf2ss(model.num, model.den)), delay_s, fs_hz, where)


def _plant_step(model: PlantModel, fs_hz: float, where: str) -> _Step:
    """State space of the linear effects in series: actuator, axis in parallel with flexible modes, sensor."""
    import control

    body = _all(model, "gain")[0][0]

    def filter_of(num: list[float], den: list[float]) -> control.StateSpace:
        return control.tf2ss(control.tf(num, den))

    rate, spring = (sum(value for (value,) in _all(model, part)) for part in ("damping", "spring"))
    if model.output == "angle":
        axis = filter_of([body], [1, rate, spring])
    else:
        axis = filter_of([body, 0], [1, rate, spring]) if spring else filter_of([body], [1, rate])
    for f_hz, zeta, residue in _all(model, "mode"):
        w, bend = 2 * math.pi * f_hz, residue * body
        num = [bend] if model.output == "angle" else [bend, 0]
        axis = axis + filter_of(num, [1, 2 * zeta * w, w**2])
    for (lag_s,) in (*_all(model, "lag", "actuator"), *_all(model, "lag", "sensor")):
        if lag_s > 0:
            axis = axis * filter_of([1], [lag_s, 1])
    system = _schur((axis.A, axis.B, axis.C, axis.D))
    return _held_step_of(system, sum(value for (value,) in _all(model, "delay")), fs_hz, where)


def _all(model: PlantModel, part: str, stage: str | None = None) -> list[list[float]]:
    """Parameter values of all effects with this linear part."""
    having = [e for e in model.effects if e.type.linear_part == part and stage in (None, e.type.stage)]
    return [[effect.params[name].value for name in effect.type.names] for effect in having]


def _schur(system: tuple) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """The same system in balanced real Schur form. Rotations keep single precision sufficient."""
    from scipy import linalg

    a, b, c, d = (np.asarray(part, dtype=float) for part in system)
    if not all(np.isfinite(part).all() for part in (a, b, c, d)):
        raise _NoLiteral("a coefficient of the state space is not finite")
    if not len(a):
        return a.reshape(0, 0), np.zeros(0), np.zeros(0), float(d.ravel()[0])
    a, scale = linalg.matrix_balance(a)
    b, c = np.linalg.solve(scale, b), c @ scale
    a, turn = linalg.schur(a, output="real")
    return a, (turn.T @ b)[:, 0], (c @ turn)[0], float(d.ravel()[0])


def _held_step_of(system: tuple, delay_s: float, fs_hz: float, where: str) -> _Step:
    """Step for a held command behind a delay: the command switches inside a sample (MOD-2)."""
    from gsid.models.convert import held_step, split_delay

    a, b, c, d = system
    poles = np.linalg.eigvals(a)
    _refuse_unstable(poles.real > ROUNDING_RAD_S, poles, where)
    if delay_s < -1e-9 / fs_hz:
        hint = "such a model is not causal; fit with a delay >= 0 (half a sample without hold)"
        raise InputError("the delay after the hold is negative", where, f"{delay_s:.3g} s", hint)
    n_delay, part = split_delay(max(delay_s, 0.0) * fs_hz)
    _refuse_long(n_delay, where)
    return _Step(*held_step(a, b, part, 1 / fs_hz), c, d, n_delay, 1, n_delay + part)


def _refuse_long(delay: float, where: str) -> None:
    if delay > DELAY_MAX:
        hint = "lower the rate with --fs"
        raise InputError(f"the delay exceeds {DELAY_MAX} samples", where, f"{delay:.6g} samples", hint)


def _refuse_unstable(outside: np.ndarray, poles: np.ndarray, where: str) -> None:
    if outside.any():
        worst = poles[np.argmax(outside)]
        hint = "fit a stable model (the default of `gsid fit`), or lower the order"
        raise InputError("the model is not stable", where, f"pole {worst:.4g}", hint)


# ---- a plant's other effects -------------------------------------------------------------------------------


def _export_plant(model: PlantModel, name: str, fs_hz: float, where: str) -> CSource:
    for effect in model.effects:
        if not _is_exported(effect.type):
            known = ", ".join(sorted(one.id for one in catalogue().values() if _is_exported(one)))
            hint = f"effects that can be exported: {known}"
            raise InputError("this effect cannot be exported as C", where, effect.id, hint)
    gain = next(effect for effect in model.effects if effect.id == "rigid_body").params["gain"].value
    written = [effect for effect in model.effects if effect.type.as_c]
    # No map changes the command where its parameters are zero.
    changed = [e for e in written if e.type.stage == "actuator" and any(p.value for p in e.params.values())]
    maps = [_fill(effect, model) for effect in changed]
    laws = [(effect.id, _fill(effect, model)) for effect in written if effect.type.stage == "torque"]
    if laws and not gain:
        hint = "remove the nonlinear effects, or set the gain"
        what = "with a gain of 0 no command can compensate the friction"
        raise InputError(what, where, "rigid_body.gain 0", hint)
    per_torque = _number(1 / gain) if laws else ""
    return _write(model, name, fs_hz, _plant_step(model, fs_hz, where), per_torque, maps, laws)


def _is_exported(effect: EffectType) -> bool:
    return effect.as_c is not None or effect.linear_part in LINEAR_PARTS


def _fill(effect: Effect, model: PlantModel) -> str:
    values = {name: _number(param.value) for name, param in effect.params.items()}
    return effect.type.as_c.format(**values, unit_rad=_number(RADIANS[model.angle_unit]))


# ---- C ---------------------------------------------------------------------------------------------------


def _number(value: float) -> str:
    try:
        text = literal(value)
    except ValueError as error:
        raise _NoLiteral(error) from error
    return text if value >= 0 else f"({text})"


def _rounded(value: float) -> bool:
    """Whether a factor is not zero in single precision."""
    with np.errstate(over="ignore"):
        return np.float32(value) != 0


def _sum(terms: list[tuple[float, str]]) -> str:
    """C text of the sum of factor * variable, without the terms that are zero."""
    written = [f"{_number(factor)} * {variable}" for factor, variable in terms if _rounded(factor)]
    return " + ".join(written) or "0.0f"


def _write(
    model: RationalModel | PlantModel,
    name: str,
    fs_hz: float,
    step: _Step,
    per_torque: str,
    maps: list[str],
    laws: list[tuple[str, str]],
) -> CSource:
    units = f"{comment(model.u_unit or 'command')} to {comment(model.y_unit or 'output')}"
    made = f"Made by gsid {version()} export-c: {units}, {fs_hz:g} calls a second."
    angle_unit = model.angle_unit if isinstance(model, PlantModel) and laws else None
    header = _header(made, name, len(step.c), step.n_delay, angle_unit)
    source = _source(made, name, step, per_torque, maps, laws)
    return CSource(name, header, source, fs_hz, len(step.c), step.delay_samples, [law[0] for law in laws])


def _header(made: str, name: str, n_states: int, n_delay: int, angle_unit: str | None) -> str:
    """The header. `angle_unit` is that of the feed-forward's arguments; None: no feed-forward."""
    guard = f"{name.upper()}_H"
    states = f"    float x[{n_states}];\n" if n_states else ""
    feedforward = (
        f"""
/* Command that compensates friction and other torques that the step omits. With it added to the command, the
 * axis behaves like the step. Pass the reference motion [{angle_unit}/s, {angle_unit}], not the measured
 * one: noise in the rate would make the command chatter. */
float {name}_feedforward(float rate, float angle);
"""
        if angle_unit is not None
        else ""
    )
    return f"""/* {made} */
#ifndef {guard}
#define {guard}

#ifdef __cplusplus
extern "C" {{
#endif

typedef struct {{
{states}    float u[{n_delay + 2}]; /* the last commands */
    unsigned at;
}} {name};

/* Set the model to rest. */
void {name}_reset({name} *m);

/* One sample. Returns the output at the instant from which the command u is applied. Commands must be finite:
 * a NaN stays in the state until the reset. Every call takes about {n_states * (n_states + 3) + 1}
 * multiplications. */
float {name}_step({name} *m, float u);
{feedforward}
#ifdef __cplusplus
}}
#endif

#endif
"""


def _source(
    made: str, name: str, step: _Step, per_torque: str, maps: list[str], laws: list[tuple[str, str]]
) -> str:
    n, ring = len(step.c), step.n_delay + 2
    state = [f"x[{i}]" for i in range(n)]
    inputs = [(step.early, "early"), (step.late, "late")]
    lines = [f"    u = {one};" for one in maps]
    lines.append("    m->u[m->at] = u;")
    if step.late.any() or not step.passed:
        lines.append(f"    const float late = m->u[(m->at + {ring - step.n_delay}u) % {ring}u];")
    if step.early.any() or (step.passed and step.direct):
        lines.append(f"    const float early = m->u[(m->at + 1u) % {ring}u];")
    through = [(step.direct, "early" if step.passed else "late")]
    if n:
        lines.append("    const float *x = m->x;")
    lines.append(f"    const float y = {_sum([*zip(step.c, state, strict=True), *through])};")
    if n:
        rows = [
            _sum([*zip(step.a[i], state, strict=True), *((part[i], word) for part, word in inputs)])
            for i in range(n)
        ]
        lines.append("    const float next[] = {\n        " + ",\n        ".join(rows) + "};")
        lines += [f"    for (int i = 0; i < {n}; i++)", "        m->x[i] = next[i];"]
    lines += [f"    m->at = (m->at + 1u) % {ring}u;", "    return y;"]
    body = "\n".join(lines)
    text = f"""/* {made} */
#include "{name}.h"

#include <math.h>
#include <string.h>

void {name}_reset({name} *m) {{
    memset(m, 0, sizeof *m);
}}

float {name}_step({name} *m, float u) {{
{body}
}}
"""
    return text + _feedforward(name, per_torque, laws) if laws else text


def _feedforward(name: str, per_torque: str, laws: list[tuple[str, str]]) -> str:
    rad = "#define RAD_PER_DEG 0.0174532925f\n\n" if any("RAD_PER_DEG" in law for _, law in laws) else ""
    lines = "\n".join(f"    torque += {law}; /* {effect} */" for effect, law in laws)
    unused = [
        word for word in ("rate", "angle") if not any(re.search(rf"\b{word}\b", law) for _, law in laws)
    ]
    ignore = "".join(f"    (void){word};\n" for word in unused)
    return f"""
{rad}float {name}_feedforward(float rate, float angle) {{
{ignore}    float torque = 0.0f; /* over the inertia */
{lines}
    return torque * {per_torque};
}}
"""
