"""The page of the mutants that no test finds, each with its reason."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from gsid.base.tables import Table

REASONS = Path(__file__).with_name("reasons.json")
HEAD = """# Mutants that the tests do not find

A mutant is the source with one small change: a sign, a comparison, a number, or a removed statement. A test
that fails with it has found it. `make mutants` draws {n} mutants of each part of the source from seed {seed},
judges each by the tests that execute its line, and writes this page. Changes that do not compile, or that
compile to the same program, are not counted. [Decisions](decisions.md) has the reasons for the tools.
A run that was stopped early has judged fewer than {n}. `make mutants PART=...` judges one part again. Files
and lines are those of the commit in the table.

Tests were added where this sample showed a gap. The share found is therefore too large for the source as a
whole: of mutants drawn from another seed, the tests find fewer.
"""


COLUMNS = ["part", "commit", "judged", "found", "not found", "found, 95 % interval"]


def text(known: str, found: Mapping[str, Sequence[Mapping]], seed: int, n: int, commit: str) -> str:
    """The page as Markdown: the parts that were judged, and those of the known page that were not.

    Parameters
    ----------
    known : str
        The page so far, or nothing.
    found : mapping of sequences of mappings
        Of each part the mutants judged, as `run_mutants` keeps them.
    seed, n : int
        Of the sample.
    commit : str
        Of the sources that were judged.

    Returns
    -------
    str
    """
    reasons = json.loads(REASONS.read_text(encoding="utf-8"))
    rows, sections = _parts_of(known)
    for part, mutants in found.items():
        rows[part] = [part, commit, *_counts(mutants)]
        left = [one for one in mutants if one["status"] != "killed"]
        left.sort(key=lambda one: (one["file"], one["line"]))
        head = ["file", "change", "why no test finds it"]
        sections[part] = _markdown(head, (_survivor(one, reasons) for one in left))
    parts = [HEAD.format(seed=seed, n=n), _markdown(COLUMNS, rows.values())]
    parts += [f"\n## {part.capitalize()}\n\n{section}" for part, section in sections.items()]
    return "\n".join(parts) + "\n"


def _parts_of(page: str) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Of each part of a page its row of the first table, and its section."""
    head, *parts = page.split("\n## ")
    table = [line[2:-2].split(" | ") for line in head.splitlines() if line.startswith("| ")]
    rows = {row[0]: row for row in table if row != COLUMNS}
    named = [part.partition("\n") for part in parts]
    return rows, {name.lower(): section.strip() for name, _, section in named}


def _markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return Table(head, list(rows), left=head).markdown()


def _counts(mutants: Sequence[Mapping]) -> list[str]:
    from scipy.stats import binomtest

    n_found = sum(one["status"] == "killed" for one in mutants)
    low_high = ""
    if mutants:
        interval = binomtest(n_found, len(mutants)).proportion_ci(method="wilson")
        low_high = f"{interval.low:.0%} to {interval.high:.0%}".replace("%", " %")
    return [str(len(mutants)), str(n_found), str(len(mutants) - n_found), low_high]


def _survivor(one: Mapping, reasons: Mapping[str, str]) -> list[str]:
    change = f"{_code(one['before'])} → {_code(one['after'])}"
    return [f"{one['file']}:{one['line']}", change, _reason(one, reasons)]


def _code(line: str) -> str:
    return f"`{line}`" if line else "nothing"


def _reason(one: Mapping, reasons: Mapping[str, str]) -> str:
    if one["key"] in reasons:
        return reasons[one["key"]]
    return "no test executes the line" if one["status"] == "uncovered" else "not looked into yet"
