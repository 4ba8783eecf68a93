"""Studies beside each other: verdict, parameters, fit and responses of each, and how far they differ."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gsid.base.errors import GsidError, InputError
from gsid.models.load import load_single
from gsid.plant.model import PlantModel
from gsid.prediction import predict
from gsid.records.files import read_record
from gsid.records.record import Record
from gsid.spectrum.lines import lines_of
from gsid.spectrum.realisation import spectra
from gsid.spectrum.spectra import Spectra
from gsid.study.folder import SESSION, Step, Study
from gsid.webpage.actions import FORM, reading_of

JUDGES = ("compare", "diagnose")  # verbs whose first sentence is a verdict
MOST = 6  # studies or records in one picture: as many colours as one can distinguish


def studies_beside(study: Study, named: Sequence[str | Path] = ()) -> dict[str, Path]:
    """Folders of other studies: those that were named, and those beside this one.

    Parameters
    ----------
    study : Study
    named : sequence of path_like
        Folders on the command line.

    Returns
    -------
    dict of Path
        By the name of the folder; with that of its parent, or the whole path, where two have one name.
    """
    siblings = [one for one in sorted(study.folder.parent.iterdir()) if not one.is_symlink()]
    folders = [Path(one).resolve() for one in named] + [one for one in siblings if is_study(one)]
    found: dict[str, Path] = {}
    for folder in dict.fromkeys(folders):
        if folder != study.folder:
            names = (folder.name, f"{folder.parent.name}/{folder.name}", str(folder))
            found[next(one for one in names if one not in (*found, study.folder.name))] = folder
    return found


def is_study(folder: Path) -> bool:
    """Whether a folder holds a study.

    Parameters
    ----------
    folder : Path
    """
    try:
        return (folder / SESSION).is_file()
    except OSError:  # a folder without permission
        return False


@dataclass
class Curve:
    """A measured response, and that of a model at the same lines.

    Attributes
    ----------
    f_hz : (F,) ndarray
    measured, model : (F,) complex ndarray
        Unit of the output per unit of the input; `model` is empty without one.
    unit : str
    """

    f_hz: np.ndarray
    measured: np.ndarray
    model: np.ndarray
    unit: str


@dataclass
class Summary:
    """What a study has found.

    Attributes
    ----------
    name, model, verdict : str
        Empty: none yet.
    parameters : dict of (value, std or None, unit)
        Of the newest model, by "effect.parameter".
    fit_percent : float or None
        Over the last experiment; the least of its records.
    cost : float or None
        Per degree of freedom; 1 is noise alone.
    curve : Curve or None
        Of the first record.
    note : str
        Why something could not be computed.
    """

    name: str
    model: str = ""
    verdict: str = ""
    parameters: dict[str, tuple[float, float | None, str]] = field(default_factory=dict)
    fit_percent: float | None = None
    cost: float | None = None
    curve: Curve | None = None
    note: str = ""


def summary_of(study: Study, name: str) -> Summary:
    """What a study has found, with its newest model on the records of its last experiment.

    Parameters
    ----------
    study : Study
    name : str
        In the table.
    """
    made = Summary(name)
    judged = [one for one in study.steps if one.verb in JUDGES and one.has_result and one.words]
    made.verdict = judged[-1].words[0] if judged else ""
    try:
        _add_model(made, study)
    except (InputError, GsidError, OSError, ValueError) as error:
        made.note = str(error).splitlines()[0]
    return made


def _add_model(made: Summary, study: Study) -> None:
    newest = study.newest_models
    model = load_single(study.path(newest[-1])) if newest else None
    if model is not None:
        made.model = newest[-1]
        made.cost = (getattr(model, "fit", None) or {}).get("cost_per_dof")
    if isinstance(model, PlantModel):
        made.parameters = parameters_of(model)
    measured = [spectra(one) for one in records_of(study, study.last_experiment)]
    if not measured:
        return
    made.curve = curve_of(measured[0])
    if model is not None:
        predicted = predict(model, measured)
        fits = [one.fit_percent for one in predicted if math.isfinite(one.fit_percent)]
        made.fit_percent = min(fits, default=None)
        made.curve = curve_of(measured[0], predicted[0].y_model)


def parameters_of(model: PlantModel) -> dict[str, tuple[float, float | None, str]]:
    """Value, standard deviation and unit of each parameter.

    Parameters
    ----------
    model : PlantModel
    """
    return {
        f"{label}.{name}": (param.value, _finite(param.std), model.unit_of(effect, name))
        for label, effect in model.labels()
        for name, param in effect.params.items()
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def records_of(study: Study, names: Sequence[str]) -> list[Record]:
    """Records of a study, read as its last step that used one of them did.

    Parameters
    ----------
    study : Study
    names : sequence of str
        Relative to the study.
    """
    how: dict[str, Any] = {}
    for step in study.steps:
        if step.has_result and set(names) & set(step.arguments):
            how = reading_of(options_of(step)) | conversions_of(step)
    how.pop("r", None)
    return [read_record(study.path(name), **how) for name in names]


def options_of(step: Step) -> dict[str, str]:
    """The options of a step by which its records were read.

    Parameters
    ----------
    step : Step
    """
    return {name: value for name, value in _typed(step) if name in FORM}


def conversions_of(step: Step) -> dict[str, Any]:
    """The units and factors of its columns, as arguments of `read_record`.

    Parameters
    ----------
    step : Step
    """
    pairs = [(option, *value.partition("=")) for option, value in _typed(step)]
    units = {name: unit for option, name, _, unit in pairs if option == "--unit"}
    factors = {name: float(factor) for option, name, _, factor in pairs if option == "--factor"}
    return {key: found for key, found in (("units", units), ("factors", factors)) if found}


def _typed(step: Step) -> list[tuple[str, str]]:
    """Options and their values, as --name=value or --name value."""
    words = [*step.arguments, ""]
    found = []
    for word, after in itertools.pairwise(words):
        name, equals, value = word.partition("=")
        found.append((name, value if equals else after))
    return found


def curve_of(one: Spectra, y_model: np.ndarray | None = None) -> Curve:
    """The response at the excited lines.

    Parameters
    ----------
    one : Spectra
    y_model : (N,) ndarray, optional
        One period of the output of a model.
    """
    use = one.excited & (one.f_hz > 0)
    model = np.empty(0, complex) if y_model is None else lines_of(y_model)[use] / one.u[use]
    unit = f"{one.y_unit or 'output'} per {one.u_unit or 'command'}" if one.y_unit or one.u_unit else ""
    return Curve(one.f_hz[use], np.mean(one.Y, axis=0)[use] / one.u[use], model, unit)


# ---- beside each other ---------------------------------------------------------------------------------


def comparison_of(summaries: Sequence[Summary]) -> dict[str, Any]:
    """Table and picture of several studies; differences are to the first one.

    Parameters
    ----------
    summaries : sequence of Summary
    """
    names = dict.fromkeys(name for one in summaries for name in one.parameters)
    heads = [
        {key: getattr(one, key) for key in ("name", "model", "verdict", "fit_percent", "cost", "note")}
        for one in summaries
    ]
    rows = [{"name": name, "cells": _cells(summaries, name)} for name in names]
    curves = {one.name: one.curve for one in summaries if one.curve is not None}
    return {"studies": heads, "rows": rows, "curves": curves_of(curves)}


def _cells(summaries: Sequence[Summary], name: str) -> list[dict[str, Any] | None]:
    first = summaries[0].parameters.get(name)
    cells: list[dict[str, Any] | None] = []
    for number, one in enumerate(summaries):
        own = one.parameters.get(name)
        if own is None:
            cells.append(None)
            continue
        apart = differences_sd(first, own) if number and first is not None else None
        cells.append({"value": own[0], "std": own[1], "unit": own[2], "differs_sd": apart})
    return cells


def differences_sd(
    one: tuple[float, float | None, str], other: tuple[float, float | None, str]
) -> float | None:
    """Difference of two independent estimates in standard deviations of that difference.  Eq: VAL-3

    None if the units differ, or if neither has an uncertainty.

    Parameters
    ----------
    one, other : (value, std or None, unit)
    """
    if one[2] != other[2] or one[1] is None or other[1] is None:
        return None
    std = math.hypot(one[1], other[1])
    return (other[0] - one[0]) / std if std > 0 else None


def curves_of(curves: Mapping[str, Curve]) -> list[dict[str, Any]]:
    """Responses as the page draws them: gain in dB, phase in degrees.

    Parameters
    ----------
    curves : mapping of Curve
        By their names.
    """
    return [
        {
            "name": name,
            "f_hz": one.f_hz.tolist(),
            "unit": one.unit,
            "measured": _gain_phase(one.measured),
            "model": _gain_phase(one.model),
        }
        for name, one in curves.items()
    ]


def _gain_phase(g: np.ndarray) -> dict[str, list[float | None]]:
    size = np.abs(g)
    gain = 20 * np.log10(np.where(size > 0, size, np.nan))
    phase = np.degrees(np.angle(g))
    return {"db": _plain(gain), "deg": _plain(phase)}


def _plain(values: np.ndarray) -> list[float | None]:
    return [round(float(one), 3) if np.isfinite(one) else None for one in values]


def responses_of(study: Study, names: Sequence[str]) -> dict[str, Any]:
    """Responses of several records of one study, for one picture.

    Parameters
    ----------
    study : Study
    names : sequence of str
        Relative to the study.

    Raises
    ------
    InputError
        There are none, or too many, or one cannot be read.
    """
    if not 0 < len(names) <= MOST:
        raise InputError("not so many responses fit into one picture", "", len(names), f"tick 1 to {MOST}")
    curves = {}
    for name, record in zip(names, records_of(study, names), strict=True):
        curves[name.removeprefix("records/")] = curve_of(spectra(record))
    return {"curves": curves_of(curves)}
