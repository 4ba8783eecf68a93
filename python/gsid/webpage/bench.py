"""A model beside one record, prepared for simulations with other values of its parameters."""

from __future__ import annotations

import base64
import contextlib
import copy
import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from gsid.base.deadline import OutOfTime
from gsid.base.errors import GsidError, InputError
from gsid.base.extremes import extremes
from gsid.effects.types import EffectParameter
from gsid.greybox.weights import has_common_zero
from gsid.models.confidence import NORMAL_95
from gsid.plant.effect import Effect, Param
from gsid.plant.measured_start import has_several_orbits
from gsid.plant.model import PlantModel
from gsid.plant.periodic import PeriodicPlant
from gsid.prediction import PredictedOutput, predict
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra, read_as
from gsid.webpage.edits import Edit, check_out, check_value, extended, may_be_out

MOVES_MOST = 2e7  # of one simulation: a hundred times the usual, some seconds
STRUCTURES_KEPT = 8  # simulations that stay prepared, one for each choice of effects
POINTS = (100, 4000)  # fewest and most points of a drawn signal
DECADES = 2  # of a logarithmic slider, on either side of its centre
UNITS = ("s", "hz", "deg", "rad")
WIDE = 100.0  # a range that is so much larger than a typical value has a slider of its own


class Bench:
    """A model beside one record.

    Where the record does not state its hold, all values are simulated under the one that is likelier for
    the given ones.

    Parameters
    ----------
    model : PlantModel
    record : Record or Spectra
    edit : Edit, optional
        With effects that are added to the model.

    Raises
    ------
    InputError, GsidError
        As `gsid.predict`.
    """

    def __init__(self, model: PlantModel, record: Record | Spectra, edit: Edit | None = None) -> None:
        self.model = extended(model, edit) if edit else model
        (measured,) = spectra_of(record)
        (self.fitted,) = predict(model, [measured])
        hold = self.fitted.hold
        self._measured = read_as([measured], hold)[0] if hold and measured.hold is None else measured
        self._plants: dict[frozenset[str], tuple[PlantModel, PeriodicPlant]] = {}

    def simulated(self, values: Mapping[str, float], out: Collection[str]) -> PredictedOutput:
        """The output with other values, beside the measured one.

        Parameters
        ----------
        values : mapping of float
            By "effect.parameter"; the others have those of the model.
        out : collection of str
            Labels of the effects that are left out.

        Raises
        ------
        InputError
            An unknown parameter or effect, a value out of its bounds, or one with which the plant has no
            finite output.
        """
        part, plant = self._plant(frozenset(out))
        known = self.model.stack()
        for name, value in values.items():
            check_value(name, value, self.model.parameter(name))
            label, _, parameter = name.rpartition(".")
            known[label][parameter] = float(value)
        moved = [known[label][name] for label, name in _names(part, out, self.model)]
        try:
            if has_several_orbits(part):  # the search begins where `gsid.predict` begins it
                plant = PeriodicPlant.of(part.with_values(moved), self._measured)
            plant.bound(MOVES_MOST)
            answer = plant.run_near(moved)
        except OutOfTime as error:
            raise InputError("the simulation with these values takes too long", hint=STEEP) from error
        except GsidError as error:
            raise InputError(error.message, hint=error.hint) from error
        mean = 0.0 if has_common_zero(part) else float(np.mean(self.fitted.y) - np.mean(answer.y))
        unsettled = 0.0 if answer.settled else answer.residual
        return replace(self.fitted, y_model=answer.y + mean, unsettled=unsettled)

    def _plant(self, out: frozenset[str]) -> tuple[PlantModel, PeriodicPlant]:
        """The simulation without some effects; that of the last choices stays prepared."""
        if out not in self._plants:
            check_out(self.model, out)
            part = copy.deepcopy(self.model)
            part.effects = [_free(one) for label, one in part.labels() if label not in out]
            part.cov, part.cov_names, part.fit = None, None, None
            if len(self._plants) >= STRUCTURES_KEPT:
                self._plants.pop(next(iter(self._plants)))
            plant = PeriodicPlant.of(part, self._measured)
            self._plants[out] = part, plant
            if has_several_orbits(part):
                return part, plant
            with contextlib.suppress(GsidError, OutOfTime):  # then each search is a cold one
                plant.bound(MOVES_MOST)
                if plant.run().settled:
                    plant.keep()
        return self._plants[out]


STEEP = "a spring, a lag or a law may be too steep: move the value back"


def _free(effect: Effect) -> Effect:
    """An effect whose values the simulation takes as its arguments, all of them."""
    params = {name: Param(param.value) for name, param in effect.params.items()}
    return replace(effect, params=params)


def _names(part: PlantModel, out: Collection[str], whole: PlantModel) -> list[tuple[str, str]]:
    """Label in the whole model, and name, of each parameter of a part, in the order of its simulation."""
    return [(label, name) for label, one in whole.labels() if label not in out for name in one.params]


# ---- what the page shows -----------------------------------------------------------------------------


def sheet_of(model: PlantModel, n_added: int = 0) -> list[dict[str, Any]]:
    """The effects of a model with a slider for each parameter.

    Parameters
    ----------
    model : PlantModel
    n_added : int
        How many of the last effects were added by the page: their values are start values.
    """
    return [
        {
            "label": label,
            "sentence": effect.type.sentence,
            "may_be_out": may_be_out(effect),
            "added": number >= len(model.effects) - n_added,
            "parameters": [_slider(model, label, effect, name) for name in effect.params],
        }
        for number, (label, effect) in enumerate(model.labels())
    ]


def _slider(model: PlantModel, label: str, effect: Effect, name: str) -> dict[str, Any]:
    known, param = effect.type[name], effect.params[name]
    low, high, is_log = slider_range(known, param.value)
    std = param.std if param.std is not None and math.isfinite(param.std) else None
    return {
        "name": f"{label}.{name}",
        "words": _words(name),
        "unit": model.unit_of(effect, name).replace("command", model.u_unit or "command"),
        "value": param.value,
        "half_interval": None if std is None else NORMAL_95 * std,
        "free": param.free,
        "low": low,
        "high": high,
        "is_log": is_log,
        "has_zero": is_log and (known.null_value == 0 or known.lower == 0),
        "least": known.lower,
        "most": known.upper,
    }


def _words(name: str) -> str:
    """Name of a parameter without its unit, which stands beside it."""
    own, _, last = name.rpartition("_")
    return (own if own and last in UNITS else name).replace("_", " ")


def slider_range(known: EffectParameter, value: float) -> tuple[float, float, bool]:
    """Ends of the slider of a parameter, and whether it is logarithmic.

    The descriptor's range where a slider can resolve it, else the part of it around the value: four decades
    of a range of many, or from minus to plus three times the value.

    Parameters
    ----------
    known : EffectParameter
    value : float
    """
    centre = abs(value) or abs(known.typical) or 1.0
    if known.lower >= 0 and known.upper > WIDE * (known.typical or known.upper):
        low = max(known.lower, centre / 10**DECADES)
        return low, min(known.upper, centre * 10**DECADES), True
    if known.upper - known.lower <= WIDE * centre or not known.typical:
        return known.lower, known.upper, False
    return max(known.lower, -3 * centre), min(known.upper, 3 * centre), False


def picture_of(
    one: PredictedOutput,
    points: int,
    window: tuple[float, float] | None = None,
    *,
    with_measured: bool = True,
) -> dict[str, Any]:
    """Measured and simulated output over time and their difference, as few points as the picture can show.

    Each signal has "x" [s] and "y": little-endian float32, in base64, which a browser decodes at once.

    Parameters
    ----------
    one : PredictedOutput
    points : int
        About as many for each signal.
    window : (from, to), optional
        The part that is shown [s].
    with_measured : bool
        Whether the measured output, which no slider moves, is among them.
    """
    n, most = len(one.y_model), int(np.clip(points, *POINTS))
    begin, end = 0, n
    if window is not None:
        begin = int(np.clip(math.floor(window[0] * one.fs_hz), 0, n - 1))
        end = int(np.clip(math.ceil(window[1] * one.fs_hz) + 1, begin + 1, n))
    mean = np.mean(one.y, axis=0)
    signals = {"measured": mean} if with_measured else {}
    signals |= {"model": one.y_model, "difference": mean - one.y_model}
    return {name: _drawn(signal[begin:end], begin, one.fs_hz, most) for name, signal in signals.items()}


def _drawn(signal: np.ndarray, begin: int, fs_hz: float, most: int) -> dict[str, str]:
    place, shown = extremes(signal, most)
    return {"x": _packed((place + begin) / fs_hz), "y": _packed(shown)}


def _packed(values: np.ndarray) -> str:
    return base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()


def numbers_of(one: PredictedOutput) -> dict[str, Any]:
    """FIT % and rms error of a simulated output.

    Parameters
    ----------
    one : PredictedOutput
    """
    fit = one.fit_percent
    return {
        "fit_percent": fit if math.isfinite(fit) else None,
        "fit_percent_of_noise": one.fit_percent_of_noise if math.isfinite(fit) else None,
        "rms_error": one.rms_error,
        "unsettled": one.unsettled,
        "rms_noise": one.rms_noise,
        "noise_of_mean": NORMAL_95 * one.rms_noise / math.sqrt(len(one.y)),
        "unit": one.y_unit,
    }
