"""Mutants of C, on the syntax tree of tree-sitter: the kinds of change of Python, and statements left out."""

from __future__ import annotations

from collections.abc import Iterator

import tree_sitter_c
from mutant import Mutant
from tree_sitter import Language, Node, Parser

PARSER = Parser(Language(tree_sitter_c.language()))
# Each operator by its neighbour, and a comparison by its negation too.
REPLACED = {
    "binary_expression": {
        "+": ["-"], "-": ["+"], "*": ["/"], "/": ["*"], "%": ["*"],
        "<": ["<=", ">="], "<=": ["<", ">"], ">": [">=", "<="], ">=": [">", "<"],
        "==": ["!="], "!=": ["=="], "&&": ["||"], "||": ["&&"],
        "&": ["|"], "|": ["&"], "^": ["&"], "<<": [">>"], ">>": ["<<"],
    },
    "assignment_expression": {
        "+=": ["-="], "-=": ["+="], "*=": ["/="], "/=": ["*="], "|=": ["&="], "&=": ["|="],
    },
    "update_expression": {"++": ["--"], "--": ["++"]},
    "unary_expression": {"!": [""], "-": [""], "~": [""]},
}  # fmt: skip
CONDITIONAL = ("if_statement", "while_statement", "do_statement")
NOT_RUN = ("preproc_include", "preproc_if", "preproc_ifdef", "comment", "enumerator_list")


def mutants(file: str, text: str) -> list[Mutant]:
    """All mutants of a file.

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
    source, made = text.encode(), []
    for node in _nodes(PARSER.parse(source).root_node):
        for operator, at, new in _changes(node, source):
            changed = source[: at.start_byte] + new.encode() + source[at.end_byte :]
            made.append(Mutant.of(file, at.start_point[0] + 1, operator, text, changed.decode()))
    return made


def meaning(text: str) -> str:
    """The tokens without comments, a line each."""
    source, tokens = text.encode(), []
    to_do = [PARSER.parse(source).root_node]
    while to_do:
        node = to_do.pop()
        if node.type == "comment":
            continue
        if node.children:
            to_do += reversed(node.children)
        else:
            tokens.append(node.text.decode())
    return "\n".join(tokens)


def _nodes(node: Node) -> Iterator[Node]:
    if node.type in NOT_RUN:
        return
    yield node
    for child in node.children:
        yield from _nodes(child)


def _changes(node: Node, source: bytes) -> Iterator[tuple[str, Node, str]]:
    """Kind of change, node that is replaced, and by which text."""
    sign = node.child_by_field_name("operator")
    if sign is not None:
        for new in REPLACED.get(node.type, {}).get(sign.type, []):
            yield f"{sign.type} to {new or 'nothing'}", sign, new
    if node.type == "number_literal":
        yield from (("number", node, new) for new in _numbers(node.text.decode()))
    elif node.type in CONDITIONAL:
        condition = node.child_by_field_name("condition")
        yield "negated condition", condition, f"(!{condition.text.decode()})"
    elif node.type == "conditional_expression":
        one, other = (node.child_by_field_name(name) for name in ("consequence", "alternative"))
        yield "always the first", node, f"({one.text.decode()})"
        yield "always the second", node, f"({other.text.decode()})"
    elif node.type == "expression_statement" and node.parent.type == "compound_statement":
        yield "statement left out", node, ";"


def _numbers(literal: str) -> list[str]:
    digits = literal.rstrip("uUlL")
    if digits.removeprefix("-").isdecimal():  # a sign before a number alone belongs to it
        suffix = literal[len(digits) :]
        return [f"{int(digits) + 1}{suffix}"] + ([f"{int(digits) - 1}{suffix}"] if int(digits) else [])
    try:
        value = float(literal.rstrip("fFlL"))
    except ValueError:
        return []  # in base 16
    return [repr(2 * value) if value else "1.0"]
