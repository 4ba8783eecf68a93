"""Sphinx directives of the reference pages: Python names, C headers, commands.

Each page is made from the code when the site is built, and a public name without documentation is a
warning, which `make docs` treats as an error.
"""

import importlib
import inspect
import re
from pathlib import Path

import c_headers
import click
from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.util import logging
from sphinx.util.nodes import nested_parse_with_titles

import gsid

ROOT = Path(__file__).resolve().parents[2]
log = logging.getLogger(__name__)


def escaped(text: str) -> str:
    """Text without meaning to reStructuredText."""
    return re.sub(r"([\\*`|_])", r"\\\1", text)


def indented(text: str, by: str) -> list[str]:
    return [by + line if line else "" for line in text.splitlines()]


class Made(Directive):
    """A part of a page that is made by `lines`."""

    def lines(self) -> list[str]:
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        node = nodes.section(document=self.state.document)
        nested_parse_with_titles(self.state, StringList(self.lines(), source=type(self).__name__), node)
        return node.children


def title(text: str, mark: str) -> list[str]:
    return ["", text, mark * len(text), ""]


# ---- C -------------------------------------------------------------------------------------------------


def paragraphs(text: str, by: str) -> list[str]:
    """A comment's text as paragraphs: its line breaks and columns have no meaning."""
    lines = []
    for part in re.split(r"\n\s*\n", text):
        lines += [by + escaped(" ".join(part.split())), ""]
    return lines


def c_function(function: c_headers.Function) -> list[str]:
    """One function as a `c:function` with its comment."""
    lines = ["", f".. c:function:: {function.prototype}", ""]
    if function.text is None:
        log.warning("%s has no documentation comment", function.name)
        return lines
    lines += paragraphs(function.text, "   ")
    for names, text in (*function.parameters, *([("returns", function.returns)] if function.returns else [])):
        lines += [f"   {escaped(names)}", *paragraphs(text, "      ")]
    return lines


class CHeaders(Made):
    """Every public header: its text, types and functions."""

    def lines(self) -> list[str]:
        lines = []
        for header in c_headers.headers(ROOT / "include"):
            if not header.functions and not header.types:
                continue
            if not header.text:
                log.warning("%s has no opening comment", header.name)
            lines += [*title(header.name, "-"), *paragraphs(header.text, "")]
            for _, declaration in header.types:
                lines += [".. code-block:: c", "", *indented(declaration, "   "), ""]
            for function in header.functions:
                lines += c_function(function)
        return "\n".join(lines).splitlines()


# ---- Python --------------------------------------------------------------------------------------------


class PythonNames(Made):
    """Every public name with its docstring: functions, then classes, then modules."""

    def lines(self) -> list[str]:
        found = {name: getattr(gsid, name) for name in sorted(gsid.__all__) if not name.startswith("_")}
        lines = []
        for heading, is_kind, directive in (
            ("Functions", inspect.isfunction, "autofunction"),
            ("Classes", inspect.isclass, "autoclass"),
            ("Modules", inspect.ismodule, "automodule"),
        ):
            lines += title(heading, "-")
            for name, thing in found.items():
                if is_kind(thing):
                    lines += ["", f".. {directive}:: gsid.{name}"]
                    lines += [] if directive == "autofunction" else ["   :members:"]
                    lines += ["   :undoc-members:"] if directive == "autoclass" else []
        return [*lines, ""]


def skip_fields(app, what, name, thing, skip, options):
    """Fields stand in their class's docstring; names imported into a module have another home."""
    if (
        what == "class"
        and not callable(thing)
        and not isinstance(thing, property | classmethod | staticmethod)
    ):
        return True
    return None


def require_docstring(app, what, name, thing, options, lines):
    """A public name without a docstring is a warning."""
    if not any(line.strip() for line in lines):
        log.warning("%s %s has no docstring", what, name)


def escape_bars(app, what, name, thing, options, lines):
    """Bars are absolute values, not substitutions."""
    lines[:] = [line.replace("|", r"\|") for line in lines]


# ---- the command ---------------------------------------------------------------------------------------


def help_of(command: click.Command, words: str) -> list[str]:
    """The help of one command, as it prints it at 100 columns."""
    context = click.Context(command, info_name=words, terminal_width=100, max_content_width=100)
    return [".. code-block:: text", "", *indented(command.get_help(context), "   "), ""]


class Commands(Made):
    """`--help` of every verb."""

    def lines(self) -> list[str]:
        from gsid.cli.main import VERBS

        lines = []
        for verb in VERBS:
            word = verb.replace("-", "_")
            command = getattr(importlib.import_module(f"gsid.cli.{word}"), word)
            lines += [*title(f"gsid {verb}", "-"), *help_of(command, f"gsid {verb}")]
            for name, kind in getattr(command, "commands", {}).items():
                lines += [*title(f"gsid {verb} {name}", "^"), *help_of(kind, f"gsid {verb} {name}")]
        return lines


def setup(app):
    app.add_directive("c-headers", CHeaders)
    app.add_directive("python-names", PythonNames)
    app.add_directive("commands", Commands)
    app.connect("autodoc-skip-member", skip_fields)
    app.connect("autodoc-process-docstring", require_docstring, priority=100)  # before numpydoc adds sections
    app.connect("autodoc-process-docstring", escape_bars, priority=900)
    return {"parallel_read_safe": True}
