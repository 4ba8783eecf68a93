"""Adapt a rational model to the sample rate of a measurement, and check the hold."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from gsid.base.errors import InputError
from gsid.models.piecewise import PiecewiseModel

if TYPE_CHECKING:
    from gsid.models.mimo import MimoModel
    from gsid.models.rational import RationalModel
    from gsid.records.mimo import MimoRecord
    from gsid.response.frf import Frf
    from gsid.spectrum.spectra import Spectra

AnyModel = TypeVar("AnyModel", "RationalModel", "MimoModel", PiecewiseModel)
SingleModel = TypeVar("SingleModel", "RationalModel", "MimoModel")

_log = logging.getLogger(__name__)

SAME_RATE = 1e-6  # relative tolerance of the sample rate


def at_rate_of(model: AnyModel, measured: Spectra | Frf | MimoRecord) -> AnyModel:
    """Return the model at the sample rate of a measurement.

    A model in s behind a hold is valid for a hold at any rate. A model in z has a fixed rate. If only one of
    model and measurement has a hold, they differ by half a sample, and a warning is logged.

    Parameters
    ----------
    model : RationalModel, MimoModel or PiecewiseModel
    measured : Spectra, Frf or MimoRecord

    Returns
    -------
    RationalModel, MimoModel or PiecewiseModel

    Raises
    ------
    InputError
        The model is in z and has another sample rate.
    """
    _warn_of_hold(getattr(model, "pieces", (model,))[0], measured)
    if not isinstance(model, PiecewiseModel):
        return _at_rate(model, measured)
    return replace(model, pieces=tuple(_at_rate(piece, measured) for piece in model.pieces))


def _warn_of_hold(model: RationalModel | MimoModel, measured: Spectra | Frf | MimoRecord) -> None:
    if model.domain == "z" or model.hold == measured.hold:  # a model in z includes its hold
        return
    if model.hold_assumed and measured.hold is None:  # both come from records that do not state it
        return
    name = measured.name or "the record"
    if model.hold == "zoh":
        text = (
            "the model is for a command that is held over each sample, but %s does not state a hold: they "
            "differ by half a sample; if the command was held, add the line `# hold: zoh` to the file"
        )
    else:
        text = (
            "%s has a command that is held over each sample, but the model has no hold: they differ by half "
            "a sample, unless the delay of the model includes it; fit the model to records with this hold"
        )
    _log.warning(text, name)


def _at_rate(model: SingleModel, measured: Spectra | Frf | MimoRecord) -> SingleModel:
    needs_rate = model.domain == "z" or model.hold == "zoh"
    if not needs_rate or not math.isfinite(measured.fs_hz):  # an imported response may lack the rate
        return model
    if abs(measured.fs_hz / model.fs_hz - 1) < SAME_RATE:
        return model
    if model.domain == "z":
        rates = f"{measured.fs_hz:g} and {model.fs_hz:g} Hz"
        hint = "fit with --domain s, which is valid at any rate, or measure at the rate of the model"
        raise InputError("the sample rate differs from that of the model in z", measured.name, rates, hint)
    return replace(model, fs_hz=measured.fs_hz)
