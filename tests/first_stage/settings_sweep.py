"""Which verdicts change if one constant of the diagnosis is halved or doubled.

Constants of the first stage: the first stage runs again on each problem, from a model whose values are 5 %
off. Constants of the decision on fits by simulation: the fits of each problem are made once, from the records
alone, and judged again; constants that change the fits themselves are not swept.

Results stay in a file, one line for each constant and factor; the same command goes on where it stopped.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import functools
import inspect
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path

import from_records_study as study
import hard
import study_pool
from first_stage_study import put_into

from gsid.base.deadline import Deadline
from gsid.diagnosis.from_records import evidence, verdict
from gsid.diagnosis.from_records import settings as of_decision
from gsid.diagnosis.from_records.draw_up import draw_up
from gsid.diagnosis.from_records.evidence import Evidence
from gsid.diagnosis.from_records.find_structure import find_structure
from gsid.diagnosis.from_records.fit_laws import confirm
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.verdict import decide
from gsid.diagnosis.missing_torque import settings as of_search
from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.plant.model import PlantModel
from gsid.spectrum.realisation import spectra_of

TARGET = "diagnosis-settings-study"
FACTORS = (0.5, 2.0)
LISTED = 10  # constants that are not run yet, with their names
# Seed, kind, index, and whether the family of the effect is taken out.
PROBLEMS = (
    (21710, "single", 0, False),
    (21710, "single", 1, False),
    (21710, "single", 2, False),
    (21710, "single", 3, False),
    (21710, "single", 5, False),
    (21710, "single", 9, False),
    (21710, "single", 13, False),
    (21711, "single", 10, False),
    (21711, "single", 24, False),
    (21710, "single", 0, True),
    (21711, "single", 16, True),
    (21710, "null", 2, False),
)
SEARCH, DECISION = "search", "decision"


def deciding() -> list[str]:
    """Constants that the decision on fits by simulation reads."""
    sources = inspect.getsource(evidence) + inspect.getsource(verdict)
    read = set(re.findall(r"settings\.(\w+)", sources))
    return [field.name for field in fields(of_decision.DecisionSettings) if field.name in read]


def changed(value: object, factor: float) -> object:
    """A constant times a factor; a whole number stays one, and is at least 1.

    Parameters
    ----------
    value : int, float or tuple of float
    factor : float
    """
    if isinstance(value, tuple):
        return tuple(factor * one for one in value)
    return max(round(factor * value), 1) if isinstance(value, int) else factor * value


@functools.cache
def _problem(at: int) -> tuple:
    """Spectra, model and left-out effects of a problem."""
    seed, kind, index, is_removed = PROBLEMS[at]
    trial = hard.make_hard(seed, index, kind)
    measured = spectra_of([study.record_of(u, y) for u, y in trial.records])
    out = study.family_of(trial.key["effects"][0]["id"]) if is_removed else set()
    return measured, PlantModel.from_dict(trial.models[hard.ERRORS[0]], "null"), out


@functools.cache
def _evidence(at: int) -> Evidence | None:
    """The fits by simulation of a problem; None where no law was fitted."""
    measured, _, out = _problem(at)
    run = Run(Deadline(study.BUDGET_S), of_decision.DEFAULTS, None, out, lambda step: None)
    find_structure(run, measured, None, None, None)
    draw_up(run)
    confirm(run)
    return run.evidence().weighed() if run.laws else None


def _verdict(group: str, name: str, factor: float, at: int) -> list:
    if group == SEARCH:
        settings = of_search.DEFAULTS
        if name:
            settings = replace(settings, **{name: changed(getattr(settings, name), factor)})
        measured, model, out = _problem(at)
        found = first_stage(measured, model, without=out, settings=settings).conclusion
        return [found.kind, *found.effects]
    evidence = _evidence(at)
    if evidence is None:
        return ["no fit"]
    settings = evidence.settings
    if name:
        settings = replace(settings, **{name: changed(getattr(settings, name), factor)})
    found = decide(replace(evidence, settings=settings))
    return [found.verdict, *found.effects]


def work(task: study_pool.Task, n_done: int) -> Iterator[tuple[str, dict]]:
    """One row: the verdicts of all problems with a constant changed.

    Parameters
    ----------
    task : tuple
        Group, constant and factor.
    n_done : int
        Rows that are known.
    """
    row = {"task": list(task)}
    for part in (row,)[n_done:]:
        yield "begin", part
        try:
            yield "row", part | {"verdicts": [_verdict(*task, at) for at in range(len(PROBLEMS))]}
        except Exception as error:  # a constant for which the search does not run is a result
            yield "row", part | {"verdict": f"{type(error).__name__}: {error}"}


def tasks() -> list[study_pool.Task]:
    """The default first, then each constant with each factor; those that cost least first."""
    names = {DECISION: deciding(), SEARCH: [field.name for field in fields(of_search.SearchSettings)]}
    changes = [(group, name, factor) for group in names for name in names[group] for factor in FACTORS]
    return [(DECISION, "", 1.0), (SEARCH, "", 1.0), *changes]


def table(rows: Sequence[dict]) -> str:
    """The results as Markdown.

    Parameters
    ----------
    rows : sequence of dict
    """
    by_task = {tuple(row["task"]): row for row in rows}
    text = [f"Made by `make {TARGET}`, on {len(PROBLEMS)} problems.", ""]
    for group, title, settings in (
        (SEARCH, "`SearchSettings`: the first stage", of_search.DEFAULTS),
        (DECISION, "`DecisionSettings`: the decision on fits by simulation", of_decision.DEFAULTS),
    ):
        lines, silent, later = [], [], []
        default = by_task[group, "", 1.0]["verdicts"]
        for name in dict.fromkeys(name for of, name, _ in tasks() if of == group and name):
            if not all((group, name, factor) in by_task for factor in FACTORS):
                later.append(f"`{name}`")
                continue
            cells = [_difference(by_task[group, name, factor], default) for factor in FACTORS]
            if any(cells):
                lines.append([f"`{name}`", str(getattr(settings, name)), *(cell or "none" for cell in cells)])
            else:
                silent.append(f"`{name}`")
        unchanged = f"No verdict changes: {', '.join(silent) or 'none'}."
        if lines:
            text += [f"{title}. Verdicts that change:", ""]
            text += study.markdown(["constant", "value", "halved", "doubled"], lines)
            text += [unchanged, ""]
        else:
            text += [f"{title}. {unchanged}", ""]
        if later:
            left = ", ".join(later) if len(later) <= LISTED else f"the other {len(later)} constants"
            text += [f"Not run yet: {left}.", ""]
    return "\n".join(text).rstrip()


def _difference(row: dict, default: list) -> str:
    """Problems whose verdict differs, with both."""
    if "verdicts" not in row:
        return row["verdict"]
    pairs = zip(PROBLEMS, default, row["verdicts"], strict=True)
    return "; ".join(
        f"{_title(problem)}: {_words(before)}, now {_words(after)}"
        for problem, before, after in pairs
        if before != after
    )


def _title(problem: tuple) -> str:
    seed, kind, index, is_removed = problem
    return f"{seed} {'removed' if is_removed else kind} {index}"


def _words(verdict: list) -> str:
    return " ".join([verdict[0].removesuffix("_effect"), " or ".join(verdict[1:])]).strip()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the sweep and write its table."""
    parser = argparse.ArgumentParser(description="Halve and double each constant of the diagnosis.")
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--known", action="store_true", help="the table of what is known, without a run")
    args = parser.parse_args(arguments)

    def on_done(task: study_pool.Task, rows: list, left_s: float) -> None:
        print(json.dumps(rows), f"{left_s / 60:.0f} min left", flush=True)

    wanted = [] if args.known else tasks()
    study_pool.run(
        work, wanted, args.results, bound_s=study.BOUND_S, n_processes=args.processes, on_done=on_done
    )
    text = table([entry["rows"][0] for entry in study_pool.read_lines(args.results)])
    print(text)
    if args.page:
        put_into(args.page, text, TARGET)


if __name__ == "__main__":
    main()
