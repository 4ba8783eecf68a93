"""Which pictures an experiment has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gsid import plots
from gsid.excitation.limits import travel_unit
from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel
from gsid.prediction import PredictedOutput, predict
from gsid.report.pictures import Drawing
from gsid.report.words import error_fall

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.diagnosis.from_records.result import Diagnosis
    from gsid.diagnosis.ladder import Ladder
    from gsid.excitation.multisine import Multisine
    from gsid.excitation.periodic import Limits
    from gsid.fitting.estimators import Estimators
    from gsid.models.piecewise import PiecewiseModel
    from gsid.records.record import Record
    from gsid.response.frf import Frf
    from gsid.spectrum.noise import Noise
    from gsid.spectrum.spectra import Spectra


# --- measured and simulated signal ------------------------------------------------------------------------


def signal_of_model(
    model: RationalModel | PiecewiseModel | PlantModel, measured: Sequence[Spectra]
) -> list[Drawing]:
    """The record that the model predicts worst.

    Parameters
    ----------
    model : RationalModel, PiecewiseModel or PlantModel
    measured : sequence of Spectra
    """
    if not measured:
        return []
    predicted = predict(model, measured)
    worst = _worst(predicted)
    return [_signal([predicted[worst]], [""], len(measured))]


def signal_of_diagnosis(found: Diagnosis) -> list[Drawing]:
    """The record that the model found predicts worst, without the effects found or nearest and with them.

    Parameters
    ----------
    found : Diagnosis
    """
    if found.linear is None:
        return []
    after = found.model if found.named else found.law_model if found.nearest or found.effects else None
    without = predict(found.linear, found.measured)
    if after is None:
        return [_signal([without[_worst(without)]], [""], len(without))]
    names = " and ".join(" or ".join(effects) for effects in found.laws)
    with_them = predict(after, found.measured)
    worst = _worst(with_them)
    labels = [f"without {names}", f"with {names}"]
    return [_signal([without[worst], with_them[worst]], labels, len(without))]


def _worst(predicted: Sequence[PredictedOutput]) -> int:
    ratios = [one.rms_error / max(one.rms_noise, np.finfo(float).tiny) for one in predicted]
    return int(np.argmax(ratios))


def _signal(shown: Sequence[PredictedOutput], labels: Sequence[str], n_records: int) -> Drawing:
    name = shown[0].name or "the record"
    of_several = f", of {n_records} records the one with the largest error" if n_records > 1 else ""
    fits = ", ".join(
        f"{one.fit_percent:.4g} % {label}".rstrip() for one, label in zip(shown, labels, strict=True)
    )
    facts = (
        f"One period of {name}{of_several}. FIT {fits}; noise alone leaves "
        f"{shown[0].fit_percent_of_noise:.4g} %."
    )
    titled = [
        replace(one, name=label[0].upper() + label[1:] if label else name)
        for one, label in zip(shown, labels, strict=True)
    ]
    return Drawing("Measured and simulated signal", lambda: plots.predicted_output(titled), facts)


# --- response ---------------------------------------------------------------------------------------------


def response(
    frf: Frf | None, model: RationalModel | PiecewiseModel | PlantModel | None, measured: Sequence[Spectra]
) -> tuple[list[Drawing], list[Drawing]]:
    """The response with the model, and its details.

    Parameters
    ----------
    frf : Frf or None
    model : RationalModel, PiecewiseModel, PlantModel or None
    measured : sequence of Spectra
        Inputs of a plant.
    """
    if frf is None:
        return [], []
    alone = Drawing("Frequency response", lambda: plots.frf(frf))
    if isinstance(model, PlantModel) and measured:
        g = np.mean([model.predict(s).Y[frf.line] / s.u[frf.line] for s in measured], axis=0)
        fitted = Drawing("Measured and fitted", lambda: plots.bode_of_plant(frf, g))
        return [fitted], [Drawing("Complex residual", lambda: plots.residual_of_plant(frf, g)), alone]
    if model is None or isinstance(model, PlantModel):
        return [alone], []
    fitted = Drawing("Measured and fitted", lambda: model.plot(frf))
    return [fitted], [Drawing("Complex residual", lambda: plots.residual(model, frf)), alone]


def roots(model: object) -> list[Drawing]:
    """Poles and zeros of a transfer function.

    Parameters
    ----------
    model : model of any kind, or None
    """
    if not isinstance(model, RationalModel) or len(model.poles) + len(model.zeros) == 0:
        return []
    return [Drawing("Poles and zeros", lambda: plots.pole_zero(model))]


# --- measurement ------------------------------------------------------------------------------------------


def measurement(
    record: Record | None,
    measured: Sequence[Spectra],
    u_unit: str,
    model: object,
    multisine: Multisine | None,
    noise: Noise | None,
    limits: Limits | None,
) -> list[Drawing]:
    """Excitation, periods and noise.

    Parameters
    ----------
    record : Record or None
        The first one.
    measured : sequence of Spectra
    u_unit : str
    model : model of any kind, or None
        It predicts the travel.
    multisine : Multisine or None
        As designed.
    noise : Noise or None
    limits : Limits or None
    """
    drawings = []
    source = multisine or max(measured, key=lambda s: np.linalg.norm(s.u), default=None)
    if source is not None:

        def excite() -> Figure:
            turns = isinstance(model, RationalModel | PlantModel) and travel_unit(model) in ("deg", "m")
            return plots.excitation(source, u_unit, model=model if turns else None, limits=limits)

        drawings.append(Drawing("Excitation", excite))
    if record is not None and measured:
        drawings.append(Drawing("Periods", lambda: plots.periods(record, measured[0])))
    if noise is not None:
        drawings.append(Drawing("Noise", lambda: plots.noise(noise)))
    return drawings


# --- steps and estimators ---------------------------------------------------------------------------------


def ladder(steps: Ladder) -> list[Drawing]:
    """The error after each step.

    Parameters
    ----------
    steps : Ladder
        With at least one.
    """
    fall = error_fall(steps)
    return [Drawing("Ladder", lambda: plots.ladder(steps), f"{fall[0].upper()}{fall[1:]}.")]


def estimators(found: Estimators, frf: Frf) -> list[Drawing]:
    """The errors of several estimators.

    Parameters
    ----------
    found : Estimators
    frf : Frf
        The response fitted.
    """
    return [Drawing("Estimators", lambda: plots.estimators(found, frf))]
