"""A rational model beside a record or a response that was sampled or held otherwise."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from typing import TYPE_CHECKING

from gsid.base.errors import InputError
from gsid.models.rational import RationalModel

if TYPE_CHECKING:
    from gsid.models.piecewise import PiecewiseModel
    from gsid.response.frf import Frf
    from gsid.spectrum.spectra import Spectra

_log = logging.getLogger(__name__)

SAME_RATE = 1e-6  # of the rate


def at_rate_of(
    model: RationalModel | PiecewiseModel, measured: Spectra | Frf
) -> RationalModel | PiecewiseModel:
    """Give the model as it answers at the sample rate of a measurement.

    A model in s of what follows a hold answers to a hold at any rate; one in z has its own. Where one of the
    two knows of a hold and the other does not, they are half a sample apart, and a warning says so.

    Parameters
    ----------
    model : RationalModel or PiecewiseModel
    measured : Spectra or Frf

    Returns
    -------
    RationalModel or PiecewiseModel

    Raises
    ------
    InputError
        The model is in z and of another rate.
    """
    pieces = (model,) if isinstance(model, RationalModel) else model.pieces
    _tell_hold(pieces[0], measured)
    moved = tuple(_at_rate(piece, measured) for piece in pieces)
    return moved[0] if isinstance(model, RationalModel) else replace(model, pieces=moved)


def _tell_hold(model: RationalModel, measured: Spectra | Frf) -> None:
    if model.domain == "z" or model.hold == measured.hold:  # a model in z has any hold inside
        return
    if model.hold_assumed and measured.hold is None:  # of the same kind of records
        return
    name = measured.name or "the record"
    if model.hold == "zoh":
        text = (
            "the model is of a command that is held over each sample, and %s does not state that its was: "
            "half a sample apart; where it was held, add the line `# hold: zoh` to the file"
        )
    else:
        text = (
            "%s has a command that is held over each sample, and the model knows of no hold: half a sample "
            "apart, unless its delay contains that; fit it to such records"
        )
    _log.warning(text, name)


def _at_rate(model: RationalModel, measured: Spectra | Frf) -> RationalModel:
    needs_rate = model.domain == "z" or model.hold == "zoh"
    if not needs_rate or not math.isfinite(measured.fs_hz):  # a response from elsewhere may not say its rate
        return model
    if abs(measured.fs_hz / model.fs_hz - 1) < SAME_RATE:
        return model
    if model.domain == "z":
        rates = f"{measured.fs_hz:g} and {model.fs_hz:g} Hz"
        hint = "fit with --domain s, whose model answers at any rate, or measure at the model's"
        raise InputError("the sample rate is not that of the model in z", measured.name, rates, hint)
    return replace(model, fs_hz=measured.fs_hz)
