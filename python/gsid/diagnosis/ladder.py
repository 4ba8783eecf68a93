"""The ladder of effects added to a model, with the error before and after each step."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsid.base.errors import InputError
from gsid.base.json_files import band_of, number, numbers, text, texts
from gsid.base.plottable import Plottable
from gsid.base.tables import Table
from gsid.diagnosis.error_fall import FALL_ALARM
from gsid.plant.model import PlantModel

HARDLY = 0.99  # error after a step over that before: what is left is not explained
SAME_FIT = 0.02  # largest relative difference between the end of a rung and the start of the next

# Kinds of validation data, and the heading of the column of their errors. Files of old versions have None.
JUDGED_ON = {
    "kept_out": "kept out",
    "not_fitted": "not fitted",
    "used_before": "used before",
    "later_periods": "later periods",
    "search_records": "search records",
    None: "judged",
}

STATE = ("effects", "covariance", "fit")  # keys of a model file that a step changes


@dataclass(frozen=True)
class Rung:
    """One step of the ladder.

    Attributes
    ----------
    effect : str
        Label of the effect added.
    params : dict of {"value": float, "std": float or None}
        Its parameters, in the units of the catalogue.
    before, after : dict
        Errors on the fitted data, without and with the effect: cost_per_dof, rms_error, noise_floor_rms (unit
        of y).
    held_out : dict
        Rms error on the validation data, "before" and "after" (unit of y).
    noise_floor_rms : float
        Rms error of a perfect model on the validation data, due to noise alone (unit of y).
    kept_out : str
        Description of the validation data.
    y_unit : str
    data : dict or None
        Names of the records "fitted" and "kept_out" of this fit, and "band_hz"; None in old files.
    judged_on : {"kept_out", "not_fitted", "used_before", "later_periods", "search_records"} or None
        Kind of validation data. "kept_out": records that the caller keeps out. "not_fitted": records left
        out of this fit that may have been used to choose the effect. "used_before": records that an earlier
        step of the model used. "later_periods": later periods of the fitted realisations. "search_records":
        records that the search for this effect used. None in old files.
    fall_p_value : float or None
        Probability of a reduction this large if the effect does not bring the model nearer to the truth
        (CMP-3). It does not account for the selection of the effect by a search. None in old files.
    """

    effect: str
    params: dict[str, dict[str, float | None]]
    before: dict[str, float]
    after: dict[str, float]
    held_out: dict[str, float]
    noise_floor_rms: float
    kept_out: str
    y_unit: str = ""
    data: dict[str, list[str] | list[float]] | None = None
    judged_on: str | None = None
    fall_p_value: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """The numbers of `gsid add --json`."""
        return dict(vars(self))

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Rung:
        """Read a step from a model file.

        Raises
        ------
        ValueError
            A value is missing or has the wrong type.
        """
        judged_on, used = text(data, "judged_on", None), data.get("data")
        floor = number(data, "noise_floor_rms")
        if floor is None:
            raise ValueError("noise_floor_rms is missing")
        if judged_on not in JUDGED_ON:
            raise ValueError(f"judged_on is {judged_on!r}")
        fit = ("cost_per_dof", "rms_error", "noise_floor_rms")
        return cls(
            effect=text(data, "effect"),
            params={name: numbers(data["params"], name, ("value",)) for name in data["params"]},
            before=numbers(data, "before", fit),
            after=numbers(data, "after", fit),
            held_out=numbers(data, "held_out", ("before", "after")),
            noise_floor_rms=floor,
            kept_out=text(data, "kept_out"),
            y_unit=text(data, "y_unit"),
            data=used and {name: texts(used, name) for name in ("fitted", "kept_out")} | band_of(used),
            judged_on=judged_on,
            fall_p_value=number(data, "fall_p_value"),
        )

    @property
    def falls(self) -> bool:
        """Whether the error on the validation data falls significantly (at 5 %)."""
        falls = self.held_out["after"] < self.held_out["before"]
        return falls and (self.fall_p_value is None or self.fall_p_value <= FALL_ALARM)

    @property
    def sentence(self) -> str:
        """The reduction of the error as a sentence."""
        floor = f"{self.noise_floor_rms:.3g} {self.y_unit}".rstrip()
        held = f"{self.held_out['before']:.3g} -> {self.held_out['after']:.3g}"
        cost = f"{self.before['cost_per_dof']:.4g} -> {self.after['cost_per_dof']:.4g}"
        falls = "falls" if self.falls else "DOES NOT FALL"
        if not self.falls and self.held_out["after"] < self.held_out["before"]:
            falls = f"does NOT fall significantly (p = {self.fall_p_value:.2g})"
        elif self.falls and self.held_out["after"] > HARDLY * self.held_out["before"]:
            falls = f"falls by less than {100 * (1 - HARDLY):.0f} %"
        return (
            f"With {self.effect} the rms error on {self.kept_out} {falls}: {held}, where noise alone leaves "
            f"{floor}; cost per degree of freedom on the data fitted {cost}."
        )

    def same_data(self, other: Rung) -> bool:
        """Whether both steps use the same data to fit and validate, as far as their files state this."""
        stated = self.data is not None and other.data is not None
        return self.kept_out == other.kept_out and (not stated or self.data == other.data)

    def leads_to(self, other: Rung) -> bool:
        """Whether another rung starts where this one ends: same data, and errors equal within `SAME_FIT`."""
        ends = (self.after["cost_per_dof"], self.held_out["after"], self.noise_floor_rms)
        begins = (other.before["cost_per_dof"], other.held_out["before"], other.noise_floor_rms)
        return self.same_data(other) and np.allclose(begins, ends, rtol=SAME_FIT, atol=0)


@dataclass(eq=False, repr=False)
class Ladder(Plottable):
    """All steps of a model, in the order in which they were added."""

    rungs: list[Rung]

    @property
    def judged_on(self) -> str:
        """Heading of the column of errors on the validation data."""
        kinds = {rung.judged_on for rung in self.rungs}
        return JUDGED_ON[kinds.pop() if len(kinds) == 1 else None]

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """Step; cost per degree of freedom; rms error of fitted data, of validation data, and of noise."""
        return [
            (step, f"{fitted['cost_per_dof']:.4g}", *(f"{x:.4g}" for x in (fitted["rms_error"], held, floor)))
            for step, fitted, held, floor in self.levels()
        ]

    def levels(self) -> list[tuple[str, dict[str, float], float, float]]:
        """Step; `before` or `after` of its rung; rms error on validation data and of noise alone (unit of y).

        A step with other data than the previous step, or from another fit, gets a row for its start.
        """
        levels, last = [], None
        for r in self.rungs:
            if last is None or not last.leads_to(r):
                title = "initial model" if last is None else _again(last, r)
                levels.append((title, r.before, r.held_out["before"], r.noise_floor_rms))
            levels.append((f"+ {r.effect}", r.after, r.held_out["after"], r.noise_floor_rms))
            last = r
        return levels

    def _repr_html_(self) -> str:
        unit = f" [{self.rungs[0].y_unit}]" if self.rungs and self.rungs[0].y_unit else ""
        errors = (f"{name}{unit}" for name in ("rms error fitted", self.judged_on, "noise alone"))
        return Table(("step", "cost per d.o.f.", *errors), self.rows(), title="Ladder").html()

    def __repr__(self) -> str:
        unit = f" [{self.rungs[0].y_unit}]" if self.rungs and self.rungs[0].y_unit else ""
        table = [
            ("step", "cost/dof", f"fitted{unit}", f"{self.judged_on}{unit}", f"noise{unit}"),
            *self.rows(),
        ]
        widths = [max(len(row[i]) for row in table) for i in range(5)]
        return "\n".join(
            "  ".join(
                [row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))]
            )
            for row in table
        )


def undo(model: PlantModel) -> PlantModel:
    """Remove the last step of the ladder.

    Parameters
    ----------
    model : PlantModel

    Returns
    -------
    PlantModel
        The model that was given to :func:`add`.

    Raises
    ------
    InputError
        The ladder has no step.
    """
    if not model.history or not isinstance(model.history[-1].get("previous"), dict):
        hint = "its history is empty; `gsid add` adds a step"
        raise InputError("the model has no step to remove", "", None, hint)
    data = {key: value for key, value in model.to_dict().items() if key not in STATE}
    data |= copy.deepcopy(model.history[-1]["previous"]) | {"history": copy.deepcopy(model.history[:-1])}
    return PlantModel.from_dict(data)


def ladder(model: PlantModel) -> Ladder:
    """The ladder of a model, from its history.

    Parameters
    ----------
    model : PlantModel

    Raises
    ------
    InputError
        The history does not have the format that `add` writes.
    """
    with _history_of_file():
        return Ladder([Rung.from_dict(entry["rung"]) for entry in model.history if "rung" in entry])


def used_records(model: PlantModel) -> set[str]:
    """Digests of the records that earlier steps fitted, or used to search for an effect."""
    with _history_of_file():
        return {digest for entry in model.history for digest in texts(entry, "used_records") if digest}


@contextlib.contextmanager
def _history_of_file() -> Iterator[None]:
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        hint = "delete the history from the model file, or write the model again with `gsid add`"
        raise InputError("the model's history cannot be read", "", error, hint) from error


def _again(last: Rung, new: Rung) -> str:
    """Label of the start of a step that does not start where the last step ended."""
    if last.same_data(new):
        return "same, fitted again"
    return f"same, on {new.kept_out if new.kept_out != last.kept_out else 'other data'}"


def undo_state(model: PlantModel) -> dict[str, Any]:
    """The part of a model that `undo` restores."""
    return {key: value for key, value in model.to_dict().items() if key in STATE}
