"""What the page may ask for: the verbs that it offers, and their commands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from gsid.base.errors import InputError
from gsid.effects.types import catalogue
from gsid.study.folder import Study

READING = {"--u": str, "--y": str, "--r": str, "--fs": float, "--period": int, "--settle": int}
HOLDS = ("zoh", "none")
OUTPUTS = ("rate", "angle", "acceleration")
NAME_MOST = 200  # characters


@dataclass(frozen=True)
class Action:
    """A verb that the page offers.

    Attributes
    ----------
    verb : str
    title : str
        On its button.
    summary : str
        What it does, in one sentence.
    needs_model, may_have_model : bool
    writes : str
        Folder of the model that it writes; empty: none.
    """

    verb: str
    title: str
    summary: str
    needs_model: bool = False
    may_have_model: bool = False
    writes: str = ""


ACTIONS = {
    action.verb: action
    for action in (
        Action("look", "Look at the record", "Samples, period, settling, lost samples and excited lines."),
        Action("frf", "Measure the response", "Frequency response with its noise."),
        Action("distortion", "Noise and distortion", "Separates noise from what is not linear."),
        Action(
            "start", "Find the linear model", "Body, damping, spring, modes, lags and delay.", writes="models"
        ),
        Action("compare", "Where does the model fail?", "Tests the model line by line.", needs_model=True),
        Action("predict", "Output over time", "Simulated and measured output.", needs_model=True),
        Action(
            "diagnose",
            "What is missing?",
            "Ranks the physical effects that explain what is left.",
            may_have_model=True,
            writes="models",
        ),
        Action(
            "add",
            "Add the effect",
            "Adds it, fits again, and shows how the error falls.",
            True,
            writes="models",
        ),
    )
}


def command_of(study: Study, wish: Mapping[str, object]) -> tuple[list[str], list[str]]:
    """Words after `gsid` for a wish of the page, and the files that the command writes.

    Parameters
    ----------
    study : Study
    wish : mapping
        verb; records: names in the study; model, effect; options: of `READING`, hold and output.

    Returns
    -------
    arguments, outputs : list of str

    Raises
    ------
    InputError
        The wish names something that is not there, or an option that is not known.
    """
    verb = wish.get("verb")
    if verb not in ACTIONS:
        raise InputError("the page has no such step", "", verb, f"one of {', '.join(ACTIONS)}")
    action = ACTIONS[verb]
    arguments = [
        action.verb,
        *_effect(action, wish),
        *_records(study, wish),
        *_options(wish.get("options") or {}),
    ]
    arguments += _model(study, action, wish)
    number = study.next_number()
    outputs = [f"verdicts/{number}-{action.verb}.json"]
    if action.writes:
        outputs.append(f"{action.writes}/{number}-{action.verb}.json")
        arguments += ["-o", outputs[-1]]
    return [*arguments, "--plot", outputs[0], "--json"], outputs


def _records(study: Study, wish: Mapping[str, object]) -> list[str]:
    names = wish.get("records")
    if not isinstance(names, list) or not names:
        raise InputError("no record is chosen", "", None, "open a record and tick it")
    for name in names:
        _inside(study, name, "records/")
    return [str(name) for name in names]


def _model(study: Study, action: Action, wish: Mapping[str, object]) -> list[str]:
    name = wish.get("model")
    if not name and action.needs_model:
        raise InputError(f"{action.title}: no model is chosen", "", None, "find the linear model first")
    if not name or not (action.needs_model or action.may_have_model):
        return []
    _inside(study, name, "models/")
    return ["--model", str(name)]


def _inside(study: Study, name: object, folder: str) -> None:
    """A file of the study; its name cannot be taken for an option, since it begins with its folder."""
    if not isinstance(name, str) or not name.startswith(folder):
        raise InputError("no such file in the study", str(name)[:NAME_MOST], None, "choose one of the list")
    study.path(name)


def _effect(action: Action, wish: Mapping[str, object]) -> list[str]:
    if action.verb != "add":
        return []
    effect = wish.get("effect")
    if effect not in catalogue():
        raise InputError("no such effect", "", effect, "choose one of the catalogue")
    return [str(effect)]


def _options(given: object) -> list[str]:
    """Options as `--name=value`, so that a value cannot be taken for another option."""
    if not isinstance(given, Mapping):
        raise InputError("the options are not an object", "", type(given).__name__)
    words = []
    for name, value in given.items():
        if value in (None, ""):
            continue
        if (name == "--hold" and value in HOLDS) or (name == "--output" and value in OUTPUTS):
            words.append(f"{name}={value}")
        elif name in READING:
            words.append(f"{name}={_checked(name, value)}")
        else:
            raise InputError("the page has no such option", str(name)[:NAME_MOST], value)
    return words


def _checked(name: str, value: object) -> object:
    try:
        found = READING[name](value)
    except (TypeError, ValueError) as error:
        raise InputError("not a number", name, value) from error
    if isinstance(found, str) and (len(found) > NAME_MOST or not found.isprintable()):
        raise InputError("not a name of a column", name, found[:NAME_MOST])
    if isinstance(found, float) and not math.isfinite(found):
        raise InputError("not a finite number", name, value)
    return found
