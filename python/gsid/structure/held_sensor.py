"""Linear structure behind a sensor that is sampled and held more slowly than it is read.

The response is divided by that of the hold (BLA-4). Where the refresh rate is below twice the highest line,
images of some lines fall on others. They act on a random-phase excitation as noise does, and are subtracted
with the output that a first model predicts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsid.records.record import Record
from gsid.response.sample_hold import held_output, held_rate, held_response, mean_outputs
from gsid.response.total_variance import TotalVariance, is_one_period, total_variance
from gsid.spectrum.realisation import Realisation, listed, realisations, spectra_of
from gsid.spectrum.spectra import Spectra
from gsid.structure.elements import Lines
from gsid.structure.projection import Fitted

EFFECT, RATE = "sensor_sample_hold", "rate_hz"


@dataclass(frozen=True)
class Measurement:
    """Records of an axis, and how they are read.

    Attributes
    ----------
    records : list of Record or Spectra
    period, settle : int or None
        Samples.
    band : (lo, hi) or None
        Hz.
    reference : str or None
        Column of the reference of a closed loop.
    """

    records: list[Record | Spectra]
    period: int | None
    settle: int | None
    band: tuple[float, float] | None
    reference: str | None

    def total_variance(self) -> TotalVariance:
        """Best linear approximation with its variance."""
        return self._estimated(self.records)

    def _estimated(self, records: Sequence[Record | Spectra]) -> TotalVariance:
        return total_variance(
            records, period=self.period, settle=self.settle, band=self.band, reference=self.reference
        )

    def sensor_rate_hz(self) -> float | None:
        """Refresh rate of a sensor that is sampled and held."""
        return held_rate(
            mean_outputs(self.records, period=self.period, settle=self.settle, reference=self.reference)
        )

    @property
    def has_periods(self) -> bool:
        """Whether the phases of input and output are known: in open loop, with two periods or more."""
        single = (is_one_period(one, self.period, self.settle) for one in self.records)
        return self.reference is None and not any(single)

    def realisations(self) -> list[Realisation]:
        """The records divided into periods."""
        return realisations(self.records, period=self.period, settle=self.settle)

    def without_images(self, model: Fitted, rate_hz: float, hold: str) -> TotalVariance | None:
        """Best linear approximation without the images of lines on other lines.

        Parameters
        ----------
        model : Fitted
            Of the axis before the sensor.
        rate_hz : float
            Of the sensor.
        hold : {"zoh", "none"}
            Of the input.

        Returns
        -------
        TotalVariance or None
            None where the phases of the output are not known: in a closed loop, or with single periods.
        """
        if not self.has_periods:
            return None
        measured = spectra_of(self.records, period=self.period, settle=self.settle)
        return self._estimated([_less_images(one, model, rate_hz, hold) for one in measured])


def measurement(
    records: Record | Spectra | Sequence[Record | Spectra],
    period: int | None,
    settle: int | None,
    band: tuple[float, float] | None,
    reference: str | None,
) -> Measurement:
    """Records with how they are read.

    Parameters
    ----------
    records, period, settle, band, reference
        As those of `Measurement`.
    """
    return Measurement(listed(records), period, settle, band, reference)


def _less_images(one: Spectra, model: Fitted, rate_hz: float, hold: str) -> Spectra:
    line = np.flatnonzero(one.excited)
    y = np.zeros(len(one.line), complex)
    y[line] = model.response(Lines(one.f_hz[line], one.fs_hz, hold == "zoh")) * one.u[line]
    whole = held_output(y, rate_hz, one.fs_hz, one.period_samples)
    direct = y * held_response(one.f_hz, rate_hz, one.fs_hz, one.period_samples)
    return replace(one, Y=one.Y - (whole - direct))


def before_sensor(measured: TotalVariance, rate_hz: float | None) -> TotalVariance:
    """The response without that of a sensor which is sampled and held.

    Parameters
    ----------
    measured : TotalVariance
    rate_hz : float or None
        Its refresh rate; None: it is not held.
    """
    if rate_hz is None:
        return measured
    hold = held_response(measured.f_hz, rate_hz, measured.fs_hz, measured.period_samples)
    return replace(measured.over(hold), sensor_rate_hz=rate_hz)
