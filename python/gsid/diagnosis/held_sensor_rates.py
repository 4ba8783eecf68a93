"""Rates of a sensor that is sampled and held, as starting values of a fit.

Where the images of such a sensor are above the excitation, they show its rate. Otherwise every rate whose
refreshes repeat with the period is compared with the misfit of a model: images fall on lines of their own,
and a rate that is wrong by one over the period misses them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from gsid.diagnosis.missing_torque.linear_fit import basis
from gsid.effects.types import Grid
from gsid.greybox.fit import PlantFit, RecordFit
from gsid.response.sample_hold import HARMONICS, held_rate, mean_outputs
from gsid.spectrum.lines import lines_of

RATES = 3  # rates that are fitted
COMPARED = 5  # best rates of one record that are compared in all records, beside the nominal ones
FINEST = 1 / 3000  # least distance of rates, in sampling rates
HIGHEST = 0.7  # rate, in sampling rates
DELAY = "transport_delay.delay_s"


def likely_rates(fit: PlantFit, nominal: Grid) -> list[float]:
    """Rates of a sensor that is sampled and held, the likeliest first [Hz].

    Parameters
    ----------
    fit : PlantFit
        Of a model without such a sensor.
    nominal : Grid
        Common rates.
    """
    shown_hz = held_rate(mean_outputs([record.spectra for record in fit.records]))
    if shown_hz is not None:  # or a harmonic of a rate within the band
        return _best(fit, [shown_hz / divisor for divisor in range(1, HARMONICS + 1)])
    loudest = max(fit.records, key=lambda one: float(np.linalg.norm(one.spectra.u)))
    repeating, q = _repeating(loudest, nominal.first), basis(loudest.jacobian)
    drops = [
        _drop(loudest.residual, q, loudest.whitened(change))
        for change in _changes(loudest, repeating, _spare_delay_s(fit))
    ]
    best = repeating[np.argsort(drops)[::-1][:COMPARED]].tolist()
    return _best(fit, list(dict.fromkeys([*best, *nominal.at(loudest.spectra.fs_hz).tolist()])))


def _best(fit: PlantFit, rates: Sequence[float]) -> list[float]:
    """The rates that lower the cost of all records most."""
    residual, q = fit.residual, basis(fit.jacobian)
    changes = zip(*(_changes(one, rates, _spare_delay_s(fit)) for one in fit.records), strict=True)
    drops = [_drop(residual, q, fit.whitened([c[None, :] for c in each])[:, 0]) for each in changes]
    return [rates[i] for i in np.argsort(drops)[::-1][:RATES]]


def _repeating(one: RecordFit, slowest: float) -> np.ndarray:
    """Rates whose refreshes repeat with the period; others have no images in the mean period."""
    fs_hz = one.spectra.fs_hz
    once = fs_hz / one.spectra.period_samples
    every = once * np.ceil(fs_hz * FINEST / once)
    return np.arange(np.ceil(slowest * fs_hz / every), HIGHEST * fs_hz / every) * every


def _spare_delay_s(fit: PlantFit) -> float:
    """Delay of the model that half a hold time can replace."""
    return fit.model[DELAY].value if DELAY in fit.model.free_names else 0.0


def _changes(one: RecordFit, rates: Iterable[float], spare_delay_s: float) -> Iterator[np.ndarray]:
    """Lines of what a sensor of each rate changes of the model's output, half a hold time earlier."""
    y, fs_hz = one.prediction.y, one.spectra.fs_hz
    n = len(y)
    spline = CubicSpline(np.arange(n + 1), np.append(y, y[0]), bc_type="periodic")
    for rate in rates:
        less_delay_s = min(0.5 / rate, spare_delay_s)
        refreshed = np.floor(np.arange(n) * rate / fs_hz + 1e-9) / rate
        yield lines_of(spline((refreshed + less_delay_s) * fs_hz % n) - y)


def _drop(residual: np.ndarray, q: np.ndarray, change: np.ndarray) -> float:
    """Drop of the cost by a change of the output, beside the free parameters."""
    freed = change - q @ (q.T @ change)
    return float(2 * residual @ freed - freed @ freed)
