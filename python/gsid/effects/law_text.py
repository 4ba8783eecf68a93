"""Torque laws as text: `c*tanh(w/0.1)` becomes a list of steps that the C library evaluates.

Python's parser builds the syntax tree, and only the node types listed here are accepted. The text is never
executed as code. The variables of a law are

    w      rate of the axis, unit of angle / s
    theta  angle of the axis, unit of angle
    u      command that drives the motor: after nonlinearities such as a dead zone, delay and lags

A law may also contain numbers, its parameters, + - * / ^, parentheses, pi, rad (radians per unit of angle,
as in sin(24*theta*rad)) and the functions abs, sqrt, exp, log, sin, cos, tanh, min and max. Its value is a
torque over inertia, positive against the motion, unit of angle / s^2. Time is not a variable: the plant is
time-invariant.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from gsid._lib import lib
from gsid.base.errors import InputError, close

LENGTH_MAX = 500  # characters
VARIABLES = {"w": "RATE", "theta": "ANGLE", "u": "COMMAND", "rad": "UNIT_RAD"}
CONSTANTS = {"pi": math.pi}
FUNCTIONS = {name: 1 for name in ("abs", "sqrt", "exp", "log", "sin", "cos", "tanh")} | {"min": 2, "max": 2}
OPERATORS = {
    ast.Add: "ADD",
    ast.Sub: "SUBTRACT",
    ast.Mult: "MULTIPLY",
    ast.Div: "DIVIDE",
    ast.Pow: "POWER",
}
TIME = "t"
JUMPS = "sign", "heaviside", "step", "round", "floor"
GRAMMAR = f"a law has w, theta, u, numbers, parameters, + - * / ^ ( ), pi, rad and {', '.join(FUNCTIONS)}"


@dataclass(frozen=True)
class Step:
    """One step of the stack machine: kind (gsid_expression_kind), index of a parameter, number."""

    kind: int
    index: int = 0
    number: float = 0.0


def parse(text: str, parameters: Collection[str]) -> list[Step]:
    """Parse a law into the steps that evaluate it.

    Parameters
    ----------
    text : str
    parameters : collection of str
        Names of the law's parameters, in their order.

    Returns
    -------
    list of Step

    Raises
    ------
    InputError
        The text is not an expression, or it contains something that a law must not contain. `where` names the
        column.
    """
    return _Parser(text, list(parameters)).steps()


def names_of(text: str) -> list[str]:
    """Names in a law that are neither variables, constants nor functions: its parameters, in their order.

    Parameters
    ----------
    text : str

    Raises
    ------
    InputError
        The text is not an expression.
    """
    tree = _Parser(text, []).tree()
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    names = sorted(
        (node for node in ast.walk(tree) if isinstance(node, ast.Name) and id(node) not in called),
        key=lambda node: node.col_offset,
    )
    return list(dict.fromkeys(node.id for node in names if node.id != TIME and not is_reserved(node.id)))


def is_reserved(name: str) -> bool:
    """Whether a parameter cannot have this name."""
    return name in VARIABLES or name in CONSTANTS or name in FUNCTIONS or name in JUMPS


class _Parser:
    def __init__(self, text: str, parameters: list[str]) -> None:
        self.text = " ".join(text.split())
        self.parameters = parameters
        self.used: set[str] = set()
        # Python writes a power as **. The column numbers of its tree count bytes of that text.
        self.python = self.text.replace("^", "**")
        self.origin = [i for i, char in enumerate(self.text) for _ in ("**" if char == "^" else char)]
        self.out: list[Step] = []

    def tree(self) -> ast.expr:
        """The syntax tree of the text, which is not run."""
        if not self.text or len(self.text) > LENGTH_MAX:
            hint = f"write a law of up to {LENGTH_MAX} characters, for example c*tanh(w/0.1)"
            raise InputError("a torque law is empty or too long", "", f"{len(self.text)} characters", hint)
        try:
            return ast.parse(self.python, mode="eval").body
        except SyntaxError as error:
            at = (error.offset or len(self.python) + 1) - 1  # 0: it ends too early
            raise self._fault("a torque law is not an expression", at, GRAMMAR) from error
        except (ValueError, RecursionError, MemoryError) as error:
            raise self._fault("a torque law cannot be read", 0, GRAMMAR) from error

    def steps(self) -> list[Step]:
        self._visit(self.tree())
        unused = [name for name in self.parameters if name not in self.used]
        if unused:
            hint = f"its parameters: {', '.join(sorted(self.used)) or 'none'}; remove --param {unused[0]}"
            raise InputError("the torque law has no such parameter", self.text, ", ".join(unused), hint)
        self._check_size()
        return self.out

    # ---- the tree, depth first ----

    def _visit(self, node: ast.expr) -> None:
        if isinstance(node, ast.Constant):
            self._number(node)
        elif isinstance(node, ast.Name):
            self._name(node)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            self._visit(node.operand)
            if isinstance(node.op, ast.USub):
                self._add("NEGATE")
        elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            self._visit(node.left)
            self._visit(node.right)
            self._add(OPERATORS[type(node.op)])
        elif isinstance(node, ast.Call):
            self._call(node)
        else:
            raise self._fault("a torque law must not contain this", self._column(node), GRAMMAR)

    def _number(self, node: ast.Constant) -> None:
        value = node.value
        try:
            number = float(value) if type(value) in (int, float) else math.nan
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self._fault("a torque law has finite real numbers only", self._column(node), GRAMMAR)
        self.out.append(Step(lib.GSID_EXPRESSION_NUMBER, number=number))

    def _name(self, node: ast.Name) -> None:
        name = node.id
        if name in VARIABLES:
            self._add(VARIABLES[name])
        elif name in CONSTANTS:
            self.out.append(Step(lib.GSID_EXPRESSION_NUMBER, number=CONSTANTS[name]))
        elif name in self.parameters:
            self.used.add(name)
            self.out.append(Step(lib.GSID_EXPRESSION_PARAMETER, self.parameters.index(name)))
        elif name in FUNCTIONS:
            raise self._fault(f"{name} is a function", self._column(node), f"write {name}(...)")
        elif name == TIME:
            hint = "the plant is time-invariant; for a fan or similar use periodic_disturbance"
            raise self._fault("a torque law must not depend on time", self._column(node), hint)
        else:
            known = [*VARIABLES, *CONSTANTS, *self.parameters]
            hint = close(name, known) or f"known names: {', '.join(known)}"
            hint += f"; --param {name}=VALUE makes it a parameter"
            raise self._fault(f"unknown name {name}", self._column(node), hint)

    def _call(self, node: ast.Call) -> None:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name in JUMPS:
            hint = (
                "for friction that jumps with the direction and holds the axis at rest use `gsid add "
                "coulomb_friction`; in a user-defined law use a smooth transition such as tanh(w/0.1)"
            )
            raise self._fault(
                f"{name} is discontinuous, which a torque law must not be", self._column(node), hint
            )
        if name not in FUNCTIONS:
            hint = close(name, FUNCTIONS) or f"known functions: {', '.join(FUNCTIONS)}"
            raise self._fault(f"unknown function {name}".rstrip(), self._column(node), hint)
        plain = not node.keywords and not any(isinstance(arg, ast.Starred) for arg in node.args)
        if not plain or len(node.args) != FUNCTIONS[name]:
            several = f"{FUNCTIONS[name]} arguments" if FUNCTIONS[name] > 1 else "one argument"
            raise self._fault(f"{name} takes {several}", self._column(node), GRAMMAR)
        for arg in node.args:
            self._visit(arg)
        self._add(name.upper())

    def _add(self, kind: str) -> None:
        self.out.append(Step(getattr(lib, f"GSID_EXPRESSION_{kind}")))

    def _check_size(self) -> None:
        if len(self.out) > lib.GSID_EXPRESSION_STEPS_MAX:
            what, most = "a torque law has too many steps", lib.GSID_EXPRESSION_STEPS_MAX
            raise InputError(what, self.text, f"{len(self.out)} of at most {most}", "add it in several parts")

    # ---- position of an error ----

    def _column(self, node: ast.expr) -> int:
        return len(self.python.encode()[: node.col_offset].decode())

    def _fault(self, what: str, column: int, hint: str) -> InputError:
        """Make an error that shows the text with a caret under the given column of Python's text."""
        at = self.origin[column] if 0 <= column < len(self.origin) else len(self.text)
        return InputError(what, f"column {at + 1}", f"\n    {self.text}\n    {' ' * at}^", hint)


def as_c(steps: list[Step], ffi: Any) -> tuple[Any, Any]:
    """Make a gsid_expression and the memory that it points to.

    Parameters
    ----------
    steps : list of Step
    ffi : FFI
        The interface of the double-precision or the single-precision build.
    """
    tape = ffi.new("gsid_expression_step[]", [(s.kind, s.index, s.number) for s in steps])
    return ffi.new("gsid_expression *", {"n_steps": len(steps), "step": tape}), tape
