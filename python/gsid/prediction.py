"""Output of a model over time, beside the measured output."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from gsid.base.hold import fit_readings, likelier
from gsid.base.plottable import Plottable
from gsid.base.tables import Table, paragraphs
from gsid.comparison import behind_hold, check_model, depends_on_hold
from gsid.greybox.weights import has_common_zero
from gsid.models.sample_rate import at_rate_of
from gsid.plant.model import PlantModel
from gsid.plant.units import check_units
from gsid.spectrum.lines import period_of
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import read_as

if TYPE_CHECKING:
    from gsid.models.piecewise import PiecewiseModel
    from gsid.models.rational import RationalModel
    from gsid.records.record import Record
    from gsid.spectrum.spectra import Spectra

_log = logging.getLogger(__name__)


@dataclass(eq=False, repr=False)
class PredictedOutput(Plottable):
    """Steady-state output of a model for the input of one record.

    Parameters
    ----------
    fs_hz : float
        Sample rate [Hz].
    y : (P, N) ndarray
        Measured output of each good period, unit `y_unit`.
    y_model : (N,) ndarray
        Output of the model for the mean input, unit `y_unit`.
    offset_from_record : bool
        Whether the mean of `y_model` is that of the measured output: a gyro has an offset, and the zero of
        an angle is arbitrary. Only a stack with a position loop has a mean of its own.
    hold : {"zoh", "none"} or None
        Course of the input between the samples; None where the model does not depend on it.
    hold_assumed : bool
        True if the record does not state its hold. `hold` is then the likelier one for all such records
        together; "none" if the errors hardly differ.
    y_unit, name : str
    unsettled : float
        How much `y_model` changes from period to period, unit `y_unit`; 0 in the steady state.
    """

    fs_hz: float
    y: np.ndarray
    y_model: np.ndarray
    offset_from_record: bool
    hold: str | None = None
    hold_assumed: bool = False
    y_unit: str = ""
    name: str = ""
    unsettled: float = 0.0

    @property
    def t_s(self) -> np.ndarray:
        """Times of the samples of a period, (N,) [s]."""
        return np.arange(len(self.y_model)) / self.fs_hz

    @property
    def residual(self) -> np.ndarray:
        """Measured minus predicted output of each period, (P, N)."""
        return self.y - self.y_model

    @property
    def rms_error(self) -> float:
        """Rms of the residual over all periods, unit `y_unit`."""
        return _rms(self.residual)

    @property
    def rms_output(self) -> float:
        """Rms of the measured output without its mean, unit `y_unit`."""
        return _rms(self.y - np.mean(self.y))

    @property
    def rms_noise(self) -> float:
        """Rms of what differs between the periods, unit `y_unit`: no periodic output can be nearer."""
        n_periods = len(self.y)
        return _rms(self.y - np.mean(self.y, axis=0)) * float(np.sqrt(n_periods / (n_periods - 1)))

    @property
    def fit_percent(self) -> float:
        """100 (1 - rms(y - y_model) / rms(y - mean of y)): 100 is a perfect fit (VAL-2)."""
        return fit_percent(self.rms_error, self.rms_output)

    @property
    def fit_percent_of_noise(self) -> float:
        """The same for a perfect model, of which only the noise is left."""
        return fit_percent(self.rms_noise, self.rms_output)

    def to_dict(self) -> dict[str, Any]:
        """One of the records in `gsid predict --json`."""
        keys = ("name", "y_unit", "fit_percent", "fit_percent_of_noise", "rms_error", "rms_noise")
        shape = {"n_periods": self.y.shape[0], "period_samples": self.y.shape[1]}
        more = ("rms_output", "unsettled", "offset_from_record", "hold", "hold_assumed")
        return {key: getattr(self, key) for key in keys + more} | shape

    def __repr__(self) -> str:
        rms = f"{self.y_unit} rms".strip()
        return (
            f"{self.name or 'record'}: FIT {self.fit_percent:.4g} % (noise alone "
            f"{self.fit_percent_of_noise:.4g} %), error {self.rms_error:.4g} {rms} of {self.rms_output:.4g}"
        )

    def _repr_html_(self) -> str:
        return paragraphs(repr(self))


def fit_percent(rms_error: float, rms_output: float) -> float:
    """FIT %: 100 (1 - rms error / rms output); nan for a constant output.  Eq: VAL-2

    Parameters
    ----------
    rms_error, rms_output : float
        Of the same unit; the output without its mean.
    """
    return 100 * (1 - rms_error / rms_output) if rms_output > 0 else float("nan")


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def predict(
    model: RationalModel | PiecewiseModel | PlantModel,
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
) -> list[PredictedOutput]:
    """Simulate a model with the inputs of records, for a comparison over time.

    Parameters
    ----------
    model : RationalModel, PiecewiseModel or PlantModel
        A transfer function is evaluated at the excited lines, a stack of effects is simulated.
    records : Record or Spectra, or a sequence of them
    period, settle : int, optional
        Samples per period, and samples discarded at the start; default: as stated in the record or detected.

    Returns
    -------
    list of PredictedOutput
        One for each record.

    Raises
    ------
    TypeError
        An argument is not a model or not a record.
    InputError
        A record has fewer than two good periods or no period, its units differ from those of the model, or a
        model in z has another sample rate.
    GsidError
        The plant cannot be simulated.
    """
    check_model(model)
    measured = spectra_of(records, period=period, settle=settle)
    for one in measured:
        check_units(model, one)
    if not depends_on_hold(model):
        return [_under(model, one) for one in measured]
    assumed = iter(_under_one_hold(model, [one for one in measured if one.hold is None]))
    return [
        next(assumed) if one.hold is None else replace(_under(model, one), hold=one.hold) for one in measured
    ]


def _under_one_hold(
    model: RationalModel | PiecewiseModel | PlantModel, silent: list[Spectra]
) -> list[PredictedOutput]:
    """Predictions for the records that do not state their hold, under the likelier one for all of them."""
    if not silent:
        return []
    cases = fit_readings(
        lambda hold: [_under(behind_hold(model, hold), one) for one in read_as(silent, hold)]
    )
    hold = likelier({reading: sum(map(_deviance, case)) for reading, case in cases.items()})
    return [replace(one, hold=hold, hold_assumed=True) for one in cases[hold]]


def _deviance(one: PredictedOutput) -> float:
    """-2 log likelihood of white noise of the power that differs between the periods, but for a constant."""
    limits = np.finfo(float)
    ratio = one.rms_error / max(one.rms_noise, limits.eps * one.rms_output, limits.tiny)
    return one.y.size * ratio * ratio


def _under(model: RationalModel | PiecewiseModel | PlantModel, measured: Spectra) -> PredictedOutput:
    """The prediction with the hold that is stated or assumed."""
    n = measured.period_samples
    y = np.array([period_of(lines, n) for lines in measured.Y])
    is_plant = isinstance(model, PlantModel)
    y_model, unsettled = _simulated(model, measured) if is_plant else (_at_lines(model, measured), 0.0)
    has_mean = is_plant and has_common_zero(model)
    return PredictedOutput(
        fs_hz=measured.fs_hz,
        y=y,
        y_model=y_model if has_mean else y_model + (np.mean(y) - np.mean(y_model)),
        offset_from_record=not has_mean,
        y_unit=measured.y_unit,
        name=measured.name,
        unsettled=unsettled,
    )


def _simulated(model: PlantModel, measured: Spectra) -> tuple[np.ndarray, float]:
    """Output of a stack, and how much it still changes from period to period."""
    answer = model.predict(measured)
    if not answer.settled:
        text = "no steady state was found for %s: the output changes by %.3g from period to period"
        _log.warning(text, measured.name, answer.residual)
    return answer.y, 0.0 if answer.settled else answer.residual


def _at_lines(model: RationalModel | PiecewiseModel, measured: Spectra) -> np.ndarray:
    """Output of a transfer function without its mean: elsewhere the input is noise."""
    use = measured.excited & (measured.line > 0)
    lines = np.zeros(len(measured.line), complex)
    lines[use] = at_rate_of(model, measured).response(measured.f_hz[use]) * measured.u[use]
    return period_of(lines, measured.period_samples)


def table_of(predicted: Sequence[PredictedOutput]) -> Table:
    """FIT % and rms error of each record, and of all together.

    Parameters
    ----------
    predicted : sequence of PredictedOutput
    """
    unit = f" [{predicted[0].y_unit}]" if predicted[0].y_unit else ""
    head = ["record", "FIT [%]", "noise alone [%]", f"rms error{unit}", f"noise{unit}", f"rms output{unit}"]
    rows = [
        [
            one.name,
            f"{one.fit_percent:.4g}",
            f"{one.fit_percent_of_noise:.4g}",
            f"{one.rms_error:.4g}",
            f"{one.rms_noise:.4g}",
            f"{one.rms_output:.4g}",
        ]
        for one in predicted
    ]
    return Table(head, rows, left=["record"])
