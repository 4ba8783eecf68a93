"""Changes of a model on the page: values, effects left out, effects added; and the step that fits it."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gsid.base.errors import InputError
from gsid.diagnosis.ladder import ladder
from gsid.effects.law_text import names_of
from gsid.effects.types import EffectParameter, EffectType, catalogue
from gsid.models.load import load_plant
from gsid.plant.effect import Effect
from gsid.plant.model import PlantModel
from gsid.study.folder import Study
from gsid.webpage.actions import command_of, inside, typed_law
from gsid.webpage.words import words_of

SHOWN = 60  # characters of a wrong value in a message
ADDED_MOST = 20
EDITED = "-edited-from-"  # in the name of the file


@dataclass(frozen=True)
class Added:
    """An effect that the page adds: of the catalogue, or a law that was typed.

    Attributes
    ----------
    effect : str
        Id of the catalogue; empty for a law.
    law : str
    params : mapping of float
        Start values of the parameters of a law.
    """

    effect: str = ""
    law: str = ""
    params: Mapping[str, float] = field(default_factory=dict)

    def type(self) -> EffectType:
        """What is added. A law is parsed, never run.

        Raises
        ------
        InputError
            There is no such effect, or the law is not valid.
        """
        if self.law:
            return typed_law(self.law, self.params)
        if self.effect not in catalogue():
            raise InputError("no such effect", "", self.effect[:SHOWN], "choose one of the catalogue")
        return catalogue()[self.effect]


@dataclass(frozen=True)
class Edit:
    """A model as the page has changed it.

    Attributes
    ----------
    values : mapping of float
        By "effect.parameter".
    out : tuple of str
        Labels of the effects that are left out.
    added : tuple of Added
    """

    values: Mapping[str, float] = field(default_factory=dict)
    out: tuple[str, ...] = ()
    added: tuple[Added, ...] = ()


def edit_of(request: Mapping[str, Any]) -> Edit:
    """The changes that a page sends.

    Parameters
    ----------
    request : mapping
        values: {"effect.parameter": number}; out: labels; added: {"effect": id} or {"law": text, "params":
        {name: number}}.

    Raises
    ------
    InputError
        They have another form.
    """
    values, out, added = (
        request.get(key) or empty for key, empty in (("values", {}), ("out", []), ("added", []))
    )
    for what, given, kind in (("values", values, dict), ("out", out, list), ("added", added, list)):
        if not isinstance(given, kind):
            raise InputError(f"{what} of a model have another form", "", type(given).__name__)
    if not all(isinstance(label, str) for label in out) or len(added) > ADDED_MOST:
        raise InputError("effects of a model have another form", "", str(out)[:SHOWN])
    return Edit(values, tuple(out), tuple(_added(one) for one in added))


def _added(given: object) -> Added:
    if not isinstance(given, dict) or not set(given) <= {"effect", "law", "params"}:
        raise InputError("an added effect has another form", "", str(given)[:SHOWN])
    effect, law, params = given.get("effect", ""), given.get("law", ""), given.get("params", {})
    if not isinstance(effect, str) or not isinstance(law, str) or not isinstance(params, dict):
        raise InputError("an added effect has another form", "", str(given)[:SHOWN])
    return Added(effect, law, params)


def extended(model: PlantModel, edit: Edit) -> PlantModel:
    """A model with the effects that are added, at their typical values; the fit and its uncertainty stay.

    Parameters
    ----------
    model : PlantModel
    edit : Edit
    """
    larger = copy.deepcopy(model)
    for one in edit.added:
        larger.effects = larger.with_effect(one.type(), dict(one.params)).effects
    return larger


def check_value(name: str, value: object, known: EffectParameter) -> None:
    """Refuse a value that is not a number in the range of its parameter.

    Parameters
    ----------
    name : str
        "effect.parameter".
    value : object
    known : EffectParameter
    """
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not is_number or not (known.lower <= value <= known.upper or value == known.null_value):
        hint = f"the range is {known.lower:g} .. {known.upper:g} {known.unit}".rstrip()
        raise InputError("a value is out of its range", name, str(value)[:SHOWN], hint)


def check_out(model: PlantModel, out: tuple[str, ...] | frozenset[str]) -> None:
    """Refuse to leave out what is not there, or what every plant has.

    Parameters
    ----------
    model : PlantModel
    out : labels
    """
    known = dict(model.labels())
    for label in out:
        if label not in known:
            raise InputError("the model has no such effect", "", label[:SHOWN])
        if not may_be_out(known[label]):
            raise InputError("this effect cannot be left out", "", label)


def may_be_out(effect: Effect) -> bool:
    """Whether a plant may be without an effect.

    Parameters
    ----------
    effect : Effect
    """
    return effect.id != "rigid_body"


def edited(model: PlantModel, edit: Edit) -> PlantModel:
    """The model with all changes, to be fitted. Its ladder ends before the first effect that is left out.

    Parameters
    ----------
    model : PlantModel
    edit : Edit

    Raises
    ------
    InputError
        A change is not possible.
    """
    whole = extended(model, edit)
    check_out(whole, edit.out)
    whole.cov, whole.cov_names, whole.fit = None, None, None
    for name, value in edit.values.items():
        check_value(name, value, whole.parameter(name))
        whole[name].value, whole[name].std = float(value), None
    gone = {one.id for label, one in whole.labels() if label in edit.out}
    whole.effects = [one for label, one in whole.labels() if label not in edit.out]
    if gone:
        effects = [rung.effect.partition("#")[0] for rung in ladder(model).rungs]
        kept = next((i for i, effect in enumerate(effects) if effect in gone), len(effects))
        whole.history = whole.history[:kept] if len(effects) == len(whole.history) else []
    return whole


# ---- as a job ------------------------------------------------------------------------------------------


def step_of_edit(study: Study, request: Mapping[str, Any]) -> tuple[dict[str, Any], PlantModel | None]:
    """The step that fits a changed model, and the model that it starts from; None: as it is.

    An effect that was added last is added by the command, which shows how the error falls; without one, the
    values are fitted.

    Parameters
    ----------
    study : Study
    request : mapping
        model: name in the study; edit: as of `edit_of`.

    Raises
    ------
    InputError
        The changes are not possible.
    """
    given = request.get("edit")
    if not isinstance(given, dict):
        raise InputError("the changes are not an object", "", type(given).__name__)
    edit = edit_of(given)
    model = load_plant(inside(study, request.get("model"), "models/"))
    step = {key: request[key] for key in ("records", "model", "options") if key in request}
    whole, last = edited(model, edit), _last_added(model, edit)
    if last is None:
        return step | {"verb": "fit"}, whole
    place = max(i for i, one in enumerate(whole.effects) if one.id == last.type().id)
    label, added = whole.labels()[place]
    whole.effects.pop(place)
    moved = {
        name.removeprefix(f"{label}."): value
        for name, value in edit.values.items()
        if name.startswith(f"{label}.")
    }
    if last.law:
        what = {"law": last.law, "params": {name: param.value for name, param in added.params.items()}}
    else:
        what = {"effect": last.effect, "params": moved}  # what was not moved, the command begins at itself
    is_as_it_was = len(moved) == len(edit.values) and len(edit.added) == 1 and not edit.out
    return step | {"verb": "add"} | what, None if is_as_it_was else whole


def _last_added(model: PlantModel, edit: Edit) -> Added | None:
    """The added effect that stands last, of those that are not left out."""
    labels = [label for label, _ in extended(model, edit).labels()][len(model.effects) :]
    stays = [one for label, one in zip(labels, edit.added, strict=True) if label not in edit.out]
    return stays[-1] if stays else None


def unedited(name: str) -> str:
    """The model from which an edited one was made; any other name as it is.

    Parameters
    ----------
    name : str
    """
    return re.sub(rf"(?<=^models/)\d+{EDITED}", "", name)


def step_command(study: Study, request: Mapping[str, Any]) -> tuple[int, list[str], list[str]]:
    """The number of a requested step, words after `gsid`, and the files that it makes.

    Parameters
    ----------
    study : Study
    request : mapping
        As of `command_of`; or with an edit of the model, which is saved first.

    Raises
    ------
    InputError
        As `command_of` and `step_of_edit`.
    """
    if "edit" not in request:
        return command_of(study, request)
    step, model = step_of_edit(study, request)
    number, arguments, outputs = command_of(study, step)
    if model is None:
        return number, arguments, outputs
    name = f"models/{number}{EDITED}{Path(unedited(request['model'])).name}"
    model.save(study.folder / name)
    arguments[arguments.index("--model") + 1] = name
    return number, arguments, [name, *outputs]


def law_of(request: Mapping[str, Any]) -> dict[str, Any]:
    """What a typed law is: its parameters, or why it is not a law. It is parsed, never run.

    Parameters
    ----------
    request : mapping
        law: text.
    """
    text = request.get("law")
    if not isinstance(text, str):
        raise InputError("the law is not text", "", type(text).__name__)
    try:
        start = dict.fromkeys(names_of(text), 1.0)
        typed_law(text, start)
    except InputError as error:  # half a law, while it is typed, is no fault
        return words_of(error)
    return {"law": text, "params": start}
