"""Mutants of Python, by the operators of Cosmic Ray.

Of the replacements of an operator only its neighbours are made (< to <= and >=, + to -): a float shifted by a
float raises TypeError in any test, and says nothing of the tests.
"""

from __future__ import annotations

import ast
import re

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.operators.provider import OperatorProvider
from mutant import Mutant

NEIGHBOURS = {
    "Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul", "FloorDiv_Mul", "Mod_Mul",
    "BitOr_BitAnd", "BitAnd_BitOr", "Lt_LtE", "Lt_GtE", "LtE_Lt", "LtE_Gt", "Gt_GtE", "Gt_LtE", "GtE_Gt",
    "GtE_Lt", "Eq_NotEq", "NotEq_Eq", "Is_IsNot", "IsNot_Is", "Delete_Not", "Delete_USub", "Delete_Invert",
}  # fmt: skip
REPLACEMENT = re.compile(r"Replace(?:Binary|Comparison|Unary)Operator_(.*)")
NEEDS_NAMES = {"VariableReplacer", "VariableInserter"}


def mutants(file: str, text: str) -> list[Mutant]:
    """All mutants of a file that mean something else than the file.

    Parameters
    ----------
    file : str
        Path in the repository.
    text : str
        Its text.

    Returns
    -------
    list of Mutant
    """
    made, unchanged = [], meaning(text)
    provider, nodes = OperatorProvider(), list(ast_nodes(get_ast(text)))
    for name in provider:
        replaced = REPLACEMENT.fullmatch(name)
        if name in NEEDS_NAMES or (replaced and replaced[1] not in NEIGHBOURS):
            continue
        operator = provider[name]()
        places = [start for node in nodes for start, _ in operator.mutation_positions(node)]
        for occurrence, (line, _) in enumerate(places):
            changed = _mutated(text, operator, occurrence)
            if changed is not None and meaning(changed) not in (None, unchanged):
                made.append(Mutant.of(file, line, name, text, changed))
    return made


def _mutated(text: str, operator: Operator, occurrence: int) -> str | None:
    try:
        return mutate_code(text, operator, occurrence)
    except AttributeError:  # an exception with a dotted name, which Cosmic Ray cannot replace
        return None


class _Bare(ast.NodeTransformer):
    """Removes what is not run: annotations, docstrings, and what only a type checker reads."""

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        node.returns = None
        return self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AnnAssign:
        node.annotation = ast.Constant(0)
        return self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        """A docstring."""
        is_text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if is_text else self.generic_visit(node)

    def visit_If(self, node: ast.If) -> ast.AST | None:
        if "TYPE_CHECKING" in ast.unparse(node.test):
            return None
        return self.generic_visit(node)


def meaning(text: str) -> str | None:
    """The syntax tree without what is not run; None where the text has none."""
    try:
        return ast.dump(_Bare().visit(ast.parse(text)))
    except SyntaxError:
        return None


def statement_lines(text: str, line: int) -> range:
    """Lines of the statement around a line; of a compound statement those of its head.

    Parameters
    ----------
    text : str
        Of the whole file.
    line : int
        From 1.

    Returns
    -------
    range
    """
    best = range(line, line + 1)
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.stmt) or not node.lineno <= line <= node.end_lineno:
            continue
        body = getattr(node, "body", None)
        end = max(body[0].lineno - 1, node.lineno) if body else node.end_lineno
        if line <= end:
            best = range(node.lineno, end + 1)
    return best


def assigned(text: str, line: int) -> set[str]:
    """Names that the assignment on a line gives a value, such as a constant or a default of a dataclass.

    Parameters
    ----------
    text : str
        Of the whole file.
    line : int
        From 1.

    Returns
    -------
    set of str
    """
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.lineno <= line <= node.end_lineno:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)}
    return found


def lines_that_use(text: str, names: set[str]) -> list[int]:
    """Lines of a file that read any of these names, alone or as an attribute.

    Parameters
    ----------
    text : str
        Of the whole file.
    names : set of str

    Returns
    -------
    list of int
        From 1.
    """
    return [
        node.lineno
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Name | ast.Attribute)
        and isinstance(node.ctx, ast.Load)
        and (node.id if isinstance(node, ast.Name) else node.attr) in names
    ]
