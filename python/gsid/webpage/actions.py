"""What the page may ask for: the verbs that it offers, and their commands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsid.base.arguments import is_one_line
from gsid.base.errors import InputError
from gsid.effects.custom import expression
from gsid.effects.types import EffectType, catalogue
from gsid.records.files import KINDS
from gsid.study.folder import Study
from gsid.webpage.body import number_of

TEXTS = ("--u", "--y", "--r")
CHOICES = {"--hold": ("zoh", "none"), "--output": ("rate", "angle", "acceleration")}
UNITS = {"--u-unit": "--u", "--y-unit": "--y"}  # and the column whose unit it is
FACTORS = {"--u-factor": "--u", "--y-factor": "--y", "--r-factor": "--r"}
FORM = (*TEXTS, "--fs", "--period", "--settle", *CHOICES, *UNITS, *FACTORS)  # what the page asks for
RECORD = tuple(one for one in FORM if one not in ("--r", "--r-factor", "--output"))
AS_MEASURED = tuple(one for one in RECORD if one not in (*UNITS, *FACTORS))  # converted later
LOOP = (*RECORD, "--r", "--r-factor")  # with the reference of a closed loop
LIMITS = {"limit_command": "--limit-command", "limit_travel_deg": "--limit-travel-deg"}
SIGMAS = {"response": "--sigma", "parameters": "--parameter-sigma", "rival": ""}  # of the next experiment
READING = ("u", "y", "r", "fs", "period", "settle", "hold")
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
        Folder of the file that it writes; empty: none.
    suffix : str
        Of this file.
    draws : bool
        Whether it has a picture.
    records : str
        How many it reads: "any", "one" or "none".
    options : tuple of str
        Those of `FORM` that the verb has.
    """

    verb: str
    title: str
    summary: str
    needs_model: bool = False
    may_have_model: bool = False
    writes: str = ""
    suffix: str = ".json"
    draws: bool = True
    records: str = "any"
    options: tuple[str, ...] = LOOP


ACTIONS = {
    action.verb: action
    for action in (
        Action(
            "look",
            "Look at the record",
            "Samples, period, settling, lost samples and excited lines.",
            options=RECORD,
        ),
        Action("frf", "Measure the response", "Frequency response with its noise."),
        Action(
            "distortion",
            "Noise and distortion",
            "Separates noise from what is not linear.",
            options=RECORD,
        ),
        Action(
            "start",
            "Find the linear model",
            "Body, damping, spring, modes, lags and delay.",
            writes="models",
            options=FORM,
        ),
        Action(
            "fit",
            "Fit the values",
            "Fits the free values of the model, from those in its file.",
            needs_model=True,
            writes="models",
        ),
        Action("compare", "Where does the model fail?", "Tests the model line by line.", needs_model=True),
        Action("predict", "Output over time", "Simulated and measured output.", needs_model=True),
        Action(
            "diagnose",
            "What is missing?",
            "Ranks the physical effects that explain what is left.",
            may_have_model=True,
            writes="models",
            options=FORM,
        ),
        Action(
            "add",
            "Add the effect",
            "Adds it, fits again, and shows how the error falls.",
            needs_model=True,
            writes="models",
        ),
        Action(
            "next",
            "Propose the next experiment",
            "Amplitude of each line, periods and time, from what was measured.",
            writes="excitation",
            suffix=".csv",
            options=RECORD,
        ),
        Action(
            "cut",
            "Keep this part",
            "Writes the part of the record that the picture shows as a record.",
            writes="records",
            suffix=".csv",
            draws=False,
            records="one",
            options=AS_MEASURED,
        ),
        Action(
            "report",
            "Report",
            "One page to print or send, which opens without gsid.",
            may_have_model=True,
            writes="verdicts",
            suffix=".html",
            draws=False,
            options=RECORD,
        ),
        Action(
            "export-c",
            "C for firmware",
            "The chosen model as C99 source and header.",
            needs_model=True,
            writes="models",
            suffix=".c",
            draws=False,
            records="none",
            options=("--fs",),
        ),
    )
}


def command_of(study: Study, request: Mapping[str, object]) -> tuple[int, list[str], list[str]]:
    """Number of a step that the page requests, its words after `gsid`, and the files that it writes.

    Parameters
    ----------
    study : Study
    request : mapping
        verb; records: names in the study; model; effect or law, params: its start values; of the next
        experiment goal, sigma, realisation, rival and `LIMITS`; options: of `FORM`. Those that the verb lacks
        are left out.

    Returns
    -------
    number : int
    arguments, outputs : list of str

    Raises
    ------
    InputError
        The request names something that is not there, or an option that is not known.
    """
    verb = request.get("verb")
    if not isinstance(verb, str) or verb not in ACTIONS:
        raise InputError("the page has no such step", "", verb, f"one of {', '.join(ACTIONS)}")
    action = ACTIONS[verb]
    arguments = [
        action.verb,
        *_effect(action, request),
        *_records(study, action, request),
        *_interval(action, request),
        *_options(action, request.get("options") or {}),
        *_model(study, action, request),
        *_goal(study, action, request),
    ]
    number = study.begin_step()
    picture, made = _outputs(action, number)
    if made:
        arguments += ["-o", made]
    if picture:
        arguments += ["--plot", picture]
    outputs = [one for one in (picture, made, header_of(made)) if one]
    return number, [*arguments, "--json"], outputs


def header_of(source: str) -> str:
    """The header that is written beside a C source; empty for other files.

    Parameters
    ----------
    source : str
    """
    return f"{source[:-2]}.h" if source.endswith(".c") else ""


def _outputs(action: Action, number: int) -> tuple[str, str]:
    """Picture and file that are written, or empty."""
    own = f"{number}-{action.verb}"
    name = f"axis_{number}" if action.suffix == ".c" else own  # also the name of its functions
    picture = f"verdicts/{own}.json" if action.draws else ""
    return picture, f"{action.writes}/{name}{action.suffix}" if action.writes else ""


def _records(study: Study, action: Action, request: Mapping[str, object]) -> list[str]:
    if action.records == "none":
        return []
    names = request.get("records")
    if not isinstance(names, list) or not names:
        raise InputError("no record is chosen", "", None, "open a record and tick it")
    for name in names:
        inside(study, name, "records/")
        if Path(name).suffix.lower() not in KINDS:
            raise InputError("not a record", name, None, f"records are {', '.join(KINDS)}")
    if action.records == "one" and len(names) != 1:
        raise InputError(f"{action.title}: one record at a time", "", f"{len(names)} are chosen")
    return [str(name) for name in names]


def _interval(action: Action, request: Mapping[str, object]) -> list[str]:
    """Of the part that is kept."""
    if action.verb != "cut":
        return []
    return [f"--{name}={_finite(name, request.get(name))!r}" for name in ("from", "to")]


def _model(study: Study, action: Action, request: Mapping[str, object]) -> list[str]:
    name = request.get("model")
    if not name and action.needs_model:
        raise InputError(f"{action.title}: no model is chosen", "", None, "find the linear model first")
    if not name or not (action.needs_model or action.may_have_model):
        return []
    inside(study, name, "models/")
    return [str(name)] if action.records == "none" else ["--model", str(name)]


def _goal(study: Study, action: Action, request: Mapping[str, object]) -> list[str]:
    """Of the next experiment: what it is for, its limits, and the models that these need."""
    if action.verb != "next":
        return []
    goal = request.get("goal") or "response"
    if not isinstance(goal, str) or goal not in SIGMAS:
        raise InputError("not a valid choice", "goal", str(goal)[:NAME_MOST], f"one of {', '.join(SIGMAS)}")
    numbers = LIMITS if goal == "rival" else {**LIMITS, "sigma": SIGMAS[goal], "realisation": "--realisation"}
    given = {key: request[key] for key in numbers if request.get(key) not in (None, "")}
    if goal == "parameters" and "sigma" not in given:
        raise InputError("no required sigma is given", "", None, "fill it in, for example 0.05")
    words = [f"{numbers[key]}={_plain(numbers[key], value)}" for key, value in given.items()]
    if goal == "response" and "limit_travel_deg" not in given:
        return words
    inside(study, request.get("model"), "models/")
    words += ["--model", str(request["model"])]
    if goal != "rival":
        return words
    inside(study, request.get("rival"), "models/")
    if request.get("rival") == request.get("model"):
        raise InputError(
            "both models are the same", "", request.get("model"), "choose another one to compare with"
        )
    return [*words, "--rival", str(request["rival"])]


def _plain(name: str, value: object) -> str:
    """A number as it is typed."""
    return repr(_finite(name, value)).removesuffix(".0")


def inside(study: Study, name: object, folder: str) -> Path:
    """A file of the study; its name cannot be taken for an option, since it begins with its folder.

    Parameters
    ----------
    study : Study
    name : object
        As the page gave it.
    folder : str
        With a slash at its end.

    Raises
    ------
    InputError
        There is no such file in this folder.
    """
    if not isinstance(name, str) or not name.startswith(folder) or not is_one_line(name):
        raise InputError("no such file in the study", str(name)[:NAME_MOST], None, "choose one of the list")
    return study.path(name)


def _effect(action: Action, request: Mapping[str, object]) -> list[str]:
    """An effect of the catalogue or a law, with its start values; a law is parsed here and never run."""
    if action.verb != "add":
        return []
    effect, law = request.get("effect"), request.get("law")
    params = _start_values(request.get("params"))
    start = [f"--param={name}={value}" for name, value in params.items()]
    if law is not None:
        typed_law(law, params)
        return [f"--torque={law}", *start]
    if not isinstance(effect, str) or effect not in catalogue():
        raise InputError("no such effect", "", effect, "choose one of the catalogue")
    known = catalogue()[effect]
    for name, value in params.items():
        if name not in known.names or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError("not a start value", f"{effect}.{name}"[:NAME_MOST], str(value)[:NAME_MOST])
    return [effect, *start]


def typed_law(text: object, params: Mapping[str, float]) -> EffectType:
    """A law that was typed on the page. It is parsed, never run.

    Parameters
    ----------
    text : object
        As the page gave it.
    params : mapping of float
        Start values of its parameters.

    Raises
    ------
    InputError
        It is not a valid law, or not one line: the log of the study has one command a line.
    """
    if isinstance(text, str) and not text.isprintable():
        hint = "write it on one line, without tabs"
        shown = f"{text!a}"[:NAME_MOST]
        raise InputError("a torque law has a character that cannot be printed", "", shown, hint)
    return expression(text, params)


def _start_values(given: object) -> dict[str, Any]:
    if given is not None and not isinstance(given, dict):
        raise InputError("the start values are not an object", "", type(given).__name__)
    return given or {}


def _options(action: Action, given: object) -> list[str]:
    """Options as `--name=value`, so that a value cannot be taken for another option."""
    if not isinstance(given, Mapping):
        raise InputError("the options are not an object", "", type(given).__name__)
    words = []
    for name, value in given.items():
        if name not in FORM:
            raise InputError("the page has no such option", str(name)[:NAME_MOST], value)
        if name in action.options and value not in (None, ""):
            found = _checked(name, value)
            if name in UNITS:
                words.append(f"--unit={_column(given, UNITS[name])}={found}")
            elif name in FACTORS:
                words.append(f"--factor={_column(given, FACTORS[name])}={found!r}")
            else:
                words.append(f"{name}={found}")
    return words


def _column(given: Mapping[str, object], option: str) -> object:
    """The column to which a unit or a factor belongs."""
    name = _checked(option, given.get(option) or option.removeprefix("--"))
    if "=" in str(name) or "," in str(name):
        hint = "rename the column, or give one name"
        raise InputError("the page has no unit for such a column", option, name, hint)
    return name


def reading_of(options: object) -> dict[str, object]:
    """How the page wants records to be read: arguments of `read_record`, and r, the reference of a loop.

    Parameters
    ----------
    options : object
        As the page gave it.

    Raises
    ------
    InputError
        An option is not known, or has no valid value.
    """
    if not isinstance(options, Mapping):
        raise InputError("the options are not an object", "", type(options).__name__)
    names = {f"--{name}": "fs_hz" if name == "fs" else name for name in READING}
    how = {names[name]: _checked(name, value) for name, value in options.items() if name in names and value}
    for key, kind in (("units", UNITS), ("factors", FACTORS)):
        found = {
            _column(options, kind[name]): _checked(name, value)
            for name, value in options.items()
            if name in kind and value
        }
        how |= {key: found} if found else {}
    return how


def _checked(name: str, value: object) -> object:
    if name in CHOICES:
        if value not in CHOICES[name]:
            raise InputError("not a valid choice", name, value, f"one of {', '.join(CHOICES[name])}")
        return value
    if name in (*TEXTS, *UNITS):
        if not isinstance(value, str) or len(value) > NAME_MOST or not is_one_line(value):
            what = "a unit" if name in UNITS else "a name of a column"
            raise InputError(f"not {what}", name, str(value)[:NAME_MOST])
        return value
    return _number(name, value)


def _number(name: str, value: object) -> float | int:
    found = _finite(name, value)
    if name == "--fs" or name in FACTORS:
        return found
    if found != int(found):
        raise InputError("not a whole number of samples", name, value)
    return int(found)


def _finite(name: str, value: object) -> float:
    found = number_of(value)
    if not math.isfinite(found):
        raise InputError("not a finite number", name, str(value)[:NAME_MOST])
    return found
