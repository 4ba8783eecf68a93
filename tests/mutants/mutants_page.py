"""The page of the mutants that no test finds, each with its reason."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

REASONS = Path(__file__).with_name("reasons.json")
HEAD = """# Mutants that the tests do not find

A mutant is the source with one small change: a sign, a comparison, a number, a statement left out. A test
that fails with it has found it. `make mutants` draws {n} mutants of each part of the source from seed {seed},
judges each by the tests that execute its line, and writes this page. Changes that do not compile, or that
compile to the same program, are not counted. [Decisions](decisions.md) has the reasons for the tools.
A run that was stopped has judged fewer than {n}. This one was of commit {commit}.

| part | judged | found | not found | found, 95 % interval |
|---|---|---|---|---|
"""


def text(found: Mapping[str, Sequence[Mapping]], seed: int, n: int, commit: str) -> str:
    """The page as Markdown.

    Parameters
    ----------
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
    from scipy.stats import binomtest

    reasons = json.loads(REASONS.read_text(encoding="utf-8"))
    out = HEAD.format(seed=seed, n=n, commit=commit)
    for part, mutants in found.items():
        n_found = sum(one["status"] == "killed" for one in mutants)
        if mutants:
            interval = binomtest(n_found, len(mutants)).proportion_ci(method="wilson")
            low_high = f"{interval.low:.0%} to {interval.high:.0%}".replace("%", " %")
        else:
            low_high = ""
        out += f"| {part} | {len(mutants)} | {n_found} | {len(mutants) - n_found} | {low_high} |\n"
    for part, mutants in found.items():
        out += f"\n## {part.capitalize()}\n\n| file | change | why no test finds it |\n|---|---|---|\n"
        left = [one for one in mutants if one["status"] != "killed"]
        for one in sorted(left, key=lambda one: (one["file"], one["line"])):
            change = f"{_code(one['before'])} → {_code(one['after'])}"
            out += f"| {one['file']}:{one['line']} | {change} | {_reason(one, reasons)} |\n"
    return out


def _code(line: str) -> str:
    line = line.replace("|", "\\|")
    return f"`{line}`" if line else "nothing"


def _reason(one: Mapping, reasons: Mapping[str, str]) -> str:
    if one["key"] in reasons:
        return reasons[one["key"]]
    return "no test executes the line" if one["status"] == "uncovered" else "not looked into yet"
