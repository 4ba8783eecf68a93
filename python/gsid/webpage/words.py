"""What a command found, in sentences, and what comes next."""

from __future__ import annotations

import json
import signal
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gsid.base.errors import InputError
from gsid.study.folder import CRITERION, GOOD, INTERRUPTED

UNREADABLE = "The command's answer could not be read."


@dataclass(frozen=True)
class Outcome:
    """The result of a step for the page.

    Attributes
    ----------
    sentences : tuple of str
        The first is the answer.
    effects : tuple of str
        Laws that may be added, the best first.
    next : tuple of str
        Verbs that follow.
    """

    sentences: tuple[str, ...]
    effects: tuple[str, ...] = ()
    next: tuple[str, ...] = ()


def outcome_of(
    verb: str, exit_code: int, answer: bytes, messages: Sequence[str], stopped: bool = False
) -> Outcome:
    """Read the answer of a command.

    Parameters
    ----------
    verb : str
    exit_code : int
        Negative: the number of the signal that ended it.
    answer : bytes
        Its standard output.
    messages : sequence of str
        What it wrote on stderr.
    stopped : bool
        Whether the user stopped it.
    """
    try:
        values = json.loads(answer) if exit_code in (GOOD, CRITERION, INTERRUPTED) else None
    except ValueError:
        values = None
    if not isinstance(values, dict):
        return Outcome(_failure(exit_code, messages, stopped))
    notes = tuple(text for text in messages if text.startswith(("note:", "warning:")))
    try:
        found = READERS[verb](values)
    except (LookupError, TypeError, ValueError):
        return Outcome((UNREADABLE, *notes))
    return Outcome(found.sentences + notes, found.effects, found.next)


def followups_of(verb: str, answer: Mapping[str, Any] | None) -> Outcome:
    """What follows a step, by the answer that its study keeps; nothing if it has none.

    Parameters
    ----------
    verb : str
    answer : mapping or None
    """
    try:
        return READERS[verb](answer) if answer is not None else Outcome(())
    except (LookupError, TypeError, ValueError):
        return Outcome(())


def words_of(error: InputError) -> dict[str, str]:
    """Bad input for the page: what, where, the value and what to do.

    Parameters
    ----------
    error : InputError
    """
    place = ": ".join(str(part) for part in (error.where, error.value) if part not in (None, ""))
    return {"error": error.what, "where": place, "hint": error.hint or ""}


def _failure(exit_code: int, messages: Sequence[str], stopped: bool) -> tuple[str, ...]:
    """Why a command has no answer: its error with where and hint, before its warnings."""
    lines = [text.strip() for text in messages if not text.startswith(("note:", "wrote "))]
    begin = next((i for i, text in enumerate(lines) if text.startswith("error:")), 0)
    lines = lines[begin:] + lines[:begin]
    if stopped:
        return ("The step was stopped.", *lines)
    if exit_code < 0:
        return (f"The command was ended by {_signal_name(-exit_code)}.", *lines)
    return tuple(lines) or ("The command ended without an answer.",)


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _look(values: Mapping[str, Any]) -> Outcome:
    return Outcome(tuple(values["sentences"]), next=("frf", "start", "diagnose"))


def _frf(values: Mapping[str, Any]) -> Outcome:
    f = values["f_hz"]
    return Outcome(
        (f"The response is measured at {len(f)} lines from {f[0]:.4g} to {f[-1]:.4g} Hz.",),
        next=("distortion", "start"),
    )


def _distortion(values: Mapping[str, Any]) -> Outcome:
    return Outcome((values["verdict"],), next=("start", "next"))


def _start(values: Mapping[str, Any]) -> Outcome:
    return Outcome((values["summary"], *values["notes"]), next=("compare", "predict", "diagnose"))


def _compare(values: Mapping[str, Any]) -> Outcome:
    more = ("predict", "next") if values["adequate"] else ("predict", "diagnose")
    return Outcome((values["sentence"],), next=more)


def _predict(values: Mapping[str, Any]) -> Outcome:
    sentences = (
        f"{one['name']}: FIT {_percent(one['fit_percent'])}, "
        f"noise alone {_percent(one['fit_percent_of_noise'])}."
        for one in values["records"]
    )
    return Outcome(tuple(sentences), next=("compare", "diagnose"))


def _percent(value: float | None) -> str:
    return "not defined (constant output)" if value is None else f"{value:.4g} %"


def _diagnose(values: Mapping[str, Any]) -> Outcome:
    words = (values["sentence"], *values["notes"])
    if values["verdict"] == "adequate":
        return Outcome(words, next=("predict", "compare"))
    if values["verdict"] == "missing_effect":  # the model that was written has the effect
        more = ("diagnose",) if values.get("nearest") else ()
        return Outcome(words, next=("predict", "compare", *more))
    return Outcome(words, tuple(values["effects"]), ("predict", "compare"))


def _add(values: Mapping[str, Any]) -> Outcome:
    if "undone" in values:
        return Outcome((f"Removed {values['undone']}.",), next=("predict", "compare", "diagnose"))
    return Outcome((values["sentence"],), next=("predict", "compare", "diagnose"))


def _design(values: Mapping[str, Any]) -> Outcome:
    if "experiments" in values:  # the next one
        return Outcome((values["sentence"],))
    if "crest_factor" not in values:  # the budget of measurement time
        return Outcome((f"{values['n_periods']} periods are needed.",))
    sizes = f"{values['n_lines']} lines in {values['period_samples']} samples"
    return Outcome((f"Excitation of {sizes}, crest factor {values['crest_factor']:.4g}.",))


def _run(values: Mapping[str, Any]) -> Outcome:
    counts = f"{values['n_periods']} good periods, {values['n_spoiled']} lost"
    words = [f"Measured {values['record']}: {counts}."]
    if "noise" in values:
        level = values["noise"]["level"]
        words += [values["noise"]["sentence"], f"{level[0].upper()}{level[1:]}."]
    if values["n_spoiled"]:
        words.append("Lost samples spoil a period: check cable, grounding and baud rate if this repeats.")
    return Outcome(tuple(words), next=() if "noise" in values else ("look", "frf", "start", "diagnose"))


def _cut(values: Mapping[str, Any]) -> Outcome:
    text = f"{values['record']} has {values['samples']} samples, {values['time_s']:.4g} s."
    return Outcome((text, "The next steps use the ticked records."), next=("look", "start"))


def _noise(values: Mapping[str, Any]) -> Outcome:
    return Outcome(tuple(f"{one['record']}: {one['sentence']}" for one in values["records"]))


def _fit(values: Mapping[str, Any]) -> Outcome:
    method = values.get("method")
    by = f" by {method}" if method else ""
    ends = {True: " The fit has converged.", False: " The fit has NOT converged."}
    text = f"The model is fitted{by}.{ends.get(values.get('converged'), '')}"
    if method == "ml" and "cost_per_dof" in values:
        text += f" Cost per degree of freedom {values['cost_per_dof']:.4g}; noise alone gives 1."
    kinds = (("at_bound", "At a bound"), ("undetermined", "Not determined by the records"))
    more = [f"{words}: {', '.join(values[key])}." for key, words in kinds if values.get(key)]
    return Outcome((text, *more), next=("predict", "compare"))


def _export(values: Mapping[str, Any]) -> Outcome:
    return Outcome((f"C for {values['fs_hz']:g} Hz with {values['n_states']} states.",))


def _report(values: Mapping[str, Any]) -> Outcome:
    verdict = {True: " The model is adequate.", False: " The model is not adequate."}
    return Outcome((f"Report {values['report']}.{verdict.get(values['adequate'], '')}",))


def _join(values: Mapping[str, Any]) -> Outcome:
    return Outcome((values["sentence"],), next=("fit",))


def _next(values: Mapping[str, Any]) -> Outcome:
    if "experiments" in values:  # to distinguish two models
        return Outcome((values["reason"],), next=("run",) if values["amplitude"] is not None else ())
    n_realisations, n_periods = values["n_realisations"], values["n_periods"]
    size = f"{n_periods} periods of a command up to {values['amplitude']:.4g}"
    if n_realisations > 1:
        size = f"{n_realisations} realisations of {size}"
    sentence = f"{size}, {values['time_s']:.4g} s with waiting. {values['reason']}"
    return Outcome((sentence,), next=("run",))


READERS = {
    "join": _join,
    "next": _next,
    "design": _design,
    "run": _run,
    "cut": _cut,
    "noise": _noise,
    "fit": _fit,
    "export-c": _export,
    "report": _report,
    "look": _look,
    "frf": _frf,
    "distortion": _distortion,
    "start": _start,
    "compare": _compare,
    "predict": _predict,
    "diagnose": _diagnose,
    "add": _add,
}
