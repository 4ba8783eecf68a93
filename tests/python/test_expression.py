"""Torque laws as text: what the C library makes of them against numpy; what is refused, and where."""

import numpy as np
import pytest

from gsid import effects
from gsid._lib import ffi, ffi32, lib32
from gsid.base.errors import InputError
from gsid.effects.law_text import as_c, parse

SEED = 20260412
LAWS = {
    "c*tanh(w/0.1)": {"c": 2.0},
    "-w^2^0.5 + 2**-1*theta": {},
    "k*theta^3 - -b*w*abs(w)": {"k": 3.0, "b": 0.2},
    "(c + s*exp(-(w/v)^2))*tanh(w/0.01)": {"c": 2.0, "s": 1.0, "v": 0.3},
    "a*u*sin(24*theta*rad + p)": {"a": 0.1, "p": 0.4},
    "min(max(w, -1), 1) + log(1 + w*w) - cos(pi*theta)/sqrt(2 + u)": {},
    "abs(w)^n*w": {"n": 0.7},
    "1.5e0": {},
}
UNIT_RAD = np.pi / 180


def reference(text, w, theta, u, params):
    """The same text by Python itself: only a test may run it."""
    names = {name: getattr(np, name) for name in ("abs", "sqrt", "exp", "log", "sin", "cos", "tanh", "pi")}
    names |= {"min": np.minimum, "max": np.maximum, "rad": UNIT_RAD, "w": w, "theta": theta, "u": u}
    return eval(text.replace("^", "**"), {"__builtins__": {}}, names | params)


def answer(effect, w, theta, u, params):
    item = ffi.new("gsid_plant_item *", {"effect": effect.c, "data": effect.data})
    item.value[0 : len(params)] = list(params.values())
    motion = ffi.new("gsid_motion *", {"angle": theta, "rate": w, "command": u, "unit_rad": UNIT_RAD})
    result = ffi.new("gsid_torque *")
    effect.c.torque(item, motion, result)
    return result


@pytest.mark.parametrize("text", LAWS)
def test_values_and_derivatives(text):
    """Values to rounding, derivatives to what differences of steps of 1e-6 can tell."""
    params = LAWS[text]
    effect = effects.expression(text, params)
    print("seed", SEED)
    for point in np.random.default_rng(SEED).uniform(0.05, 1.5, (20, 3)) * [[1, -1, 1]]:
        got = answer(effect, *point, params)
        assert got.torque == pytest.approx(reference(text, *point, params), rel=1e-12)
        slopes = [got.by_rate, got.by_angle, got.by_command, *got.by_value[0 : len(params)]]
        places = [*point, *params.values()]
        for i, slope in enumerate(slopes):
            sides = []
            for h in (1e-6, -1e-6):
                moved = [x + h * (i == j) for j, x in enumerate(places)]
                sides.append(reference(text, *moved[:3], dict(zip(params, moved[3:], strict=True))))
            assert slope == pytest.approx((sides[0] - sides[1]) / 2e-6, rel=1e-6, abs=1e-7)


def test_what_it_depends_on():
    looks = {"w": (0, 0), "theta": (1, 0), "u + w": (0, 1), "theta*u": (1, 1)}
    for text, wanted in looks.items():
        c = effects.expression(text, {}).c
        assert (c.looks_at_angle, c.looks_at_command) == wanted


@pytest.mark.parametrize(
    ("text", "what", "column", "hint"),
    [
        ("c*tanh(v/0.1)", "unknown name v", 8, "--param v=VALUE"),
        ("c*w^2*thetta^2", "unknown name thetta", 7, "did you mean theta?"),
        ("c*sign(w)", "sign is discontinuous", 3, "gsid add coulomb_friction"),
        ("c*w + tan(w)", "unknown function tan", 7, "did you mean tanh?"),
        ("c*w^2 + t", "must not depend on time", 9, "periodic_disturbance"),
        ("c*min(w)", "min takes 2 arguments", 3, "a law has"),
        ("c*tanh(w, theta)", "tanh takes one argument", 3, "a law has"),
        ("c*tanh(x=w)", "tanh takes one argument", 3, "a law has"),
        ("c*w if w else 1", "must not contain this", 1, "a law has"),
        ("c*w.real", "must not contain this", 3, "a law has"),
        ("c*(w == 1)", "must not contain this", 4, "a law has"),
        ("c*[1][0]", "must not contain this", 3, "a law has"),
        ("c*1e999", "finite real numbers", 3, "a law has"),
        ("c*1j", "finite real numbers", 3, "a law has"),
        ("c*True", "finite real numbers", 3, "a law has"),
        ("c*tanh", "tanh is a function", 3, "write tanh(...)"),
        ("c*w^2 +", "not an expression", 8, "a law has"),
        ("c*w^2^^3", "not an expression", 7, "a law has"),
        ("c*__import__('os').system('true')", "unknown function", 3, "known functions: abs"),
        ("c*(lambda: 1)()", "unknown function", 3, "known functions: abs"),
    ],
)
def test_what_is_refused_and_where(text, what, column, hint):
    with pytest.raises(InputError, match=what) as refused:
        parse(text, ["c"])
    assert refused.value.where == f"column {column}"
    shown, caret = refused.value.value.splitlines()[1:]
    assert shown == f"    {text}"
    assert caret.index("^") == 4 + column - 1
    assert hint in refused.value.hint


@pytest.mark.parametrize(
    ("text", "params", "bounds", "what"),
    [
        ("", {}, None, "empty or too long"),
        ("w" + "+w" * 250, {}, None, "empty or too long"),
        ("w" + "+w" * 64, {}, None, "too many steps"),
        ("-" * 300 + "w", {}, None, "too many steps"),
        ("(" * 240 + "w" + ")" * 240, {}, None, "(cannot be read|not an expression)"),
        ("w+(" * 16 + "w" + ")" * 16, {}, None, "nested too deeply"),
        ("w", {"c": 1.0}, None, "no such parameter"),
        ("a*w", {"a": 1.0, "w": 1.0}, None, "not a valid parameter name"),
        ("a*w", {"a": 1.0, "tanh": 1.0}, None, "not a valid parameter name"),
        ("a*w", {"a": 1.0}, {"b": (0, 1)}, "not a valid parameter name"),
        ("a*w", {"a": 1.0}, {"a": (2, 3)}, "out of its bounds"),
        ("a*w", {"a": np.nan}, None, "out of its bounds"),
        ("a*w", {"a": "much"}, None, "not numbers"),
        ("a*w", {"a": 1.0}, {"a": (1, 2, 3)}, "not numbers"),
        ("a+b+c+d+e", dict.fromkeys("abcde", 1.0), None, "too many parameters"),
        (3.0, {}, None, "not text"),
    ],
)
def test_laws_that_are_no_effect(text, params, bounds, what):
    with pytest.raises(InputError, match=what):
        effects.expression(text, params, bounds=bounds)


def test_float_evaluates_the_same_steps():
    text, params = "(c + s*exp(-(w/v)^2))*tanh(w/0.01)", {"c": 2.0, "s": 1.0, "v": 0.3}
    law, _tape = as_c(parse(text, list(params)), ffi32)
    effect = ffi32.new("gsid_effect *", {"n_parameters": 3})
    assert lib32.gsid_expression_effect(law, effect) == 0
    item = ffi32.new("gsid_plant_item *", {"effect": effect, "data": law, "value": list(params.values())})
    motion, result = ffi32.new("gsid_motion *", {"rate": 0.2}), ffi32.new("gsid_torque *")
    effect.torque(item, motion, result)
    assert result.torque == pytest.approx(reference(text, 0.2, 0.0, 0.0, params), rel=1e-6)
