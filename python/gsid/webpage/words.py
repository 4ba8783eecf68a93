"""What a command found, in sentences, and what comes next."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

GOOD, CRITERION = 0, 1


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


def outcome_of(verb: str, exit_code: int, answer: bytes, messages: Sequence[str]) -> Outcome:
    """Read the answer of a command.

    Parameters
    ----------
    verb : str
    exit_code : int
    answer : bytes
        Its standard output.
    messages : sequence of str
        What it wrote on stderr.
    """
    if exit_code < 0:
        return Outcome(("The step was stopped.",))
    try:
        values = json.loads(answer) if exit_code in (GOOD, CRITERION, 130) else None
    except ValueError:
        values = None
    if not isinstance(values, dict):
        return Outcome(_failure(messages))
    notes = tuple(text for text in messages if text.startswith(("note:", "warning:")))
    found = READERS[verb](values)
    return Outcome(found.sentences + notes, found.effects, found.next)


def _failure(messages: Sequence[str]) -> tuple[str, ...]:
    """The error of a command: what, where, and the hint."""
    lines = [text.strip() for text in messages if not text.startswith(("note:", "wrote "))]
    return tuple(lines) or ("The command ended without an answer.",)


def _look(values: Mapping[str, Any]) -> Outcome:
    return Outcome(tuple(values["sentences"]), next=("frf", "start", "diagnose"))


def _frf(values: Mapping[str, Any]) -> Outcome:
    f = values["f_hz"]
    return Outcome(
        (f"The response is measured at {len(f)} lines from {f[0]:.4g} to {f[-1]:.4g} Hz.",),
        next=("distortion", "start"),
    )


def _distortion(values: Mapping[str, Any]) -> Outcome:
    return Outcome((str(values.get("verdict", "The picture shows noise and distortion.")),), next=("start",))


def _start(values: Mapping[str, Any]) -> Outcome:
    return Outcome((values["summary"], *values["notes"]), next=("compare", "predict", "diagnose"))


def _compare(values: Mapping[str, Any]) -> Outcome:
    more = ("predict",) if values["adequate"] else ("predict", "diagnose")
    return Outcome((values["sentence"],), next=more)


def _predict(values: Mapping[str, Any]) -> Outcome:
    sentences = (
        f"{one['name']}: FIT {one['fit_percent']:.4g} %, noise alone {one['fit_percent_of_noise']:.4g} %."
        for one in values["records"]
    )
    return Outcome(tuple(sentences), next=("compare", "diagnose"))


def _diagnose(values: Mapping[str, Any]) -> Outcome:
    words = (values["sentence"], *values["notes"])
    if values["verdict"] == "missing_effect":  # the model that was written has the effect
        return Outcome(words, next=("predict", "compare"))
    effects = [one["effects"][0] for one in values["ranking"] if one["effects"]]
    return Outcome(words, tuple(dict.fromkeys(effects)), ("start",))


def _add(values: Mapping[str, Any]) -> Outcome:
    return Outcome((values["sentence"],), next=("predict", "compare", "diagnose"))


READERS = {
    "look": _look,
    "frf": _frf,
    "distortion": _distortion,
    "start": _start,
    "compare": _compare,
    "predict": _predict,
    "diagnose": _diagnose,
    "add": _add,
}
