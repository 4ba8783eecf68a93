"""Readings of the poles of rational fits as physical elements.

A fit of n poles and n - 1 zeros needs no starting values, but its poles have no meaning. Each pole pair in
the band is a mode or the sprung body; each real pole is the viscous friction, a lag or, two of them, an
overdamped sprung body; the rest is delay. All combinations are evaluated, since the gains are linear.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gsid.base.deadline import Deadline
from gsid.base.errors import GsidError
from gsid.base.threads import in_parallel
from gsid.fitting.rational import fit
from gsid.models.rational import RationalModel
from gsid.response.frf import Frf
from gsid.response.total_variance import TotalVariance
from gsid.structure.elements import Values
from gsid.structure.settings import StructureSettings

PATIENCE = 2
"""Orders without a lower MDL that end the rational fits."""


@dataclass(frozen=True)
class Poles:
    """Poles of a rational fit by kind, and its delay.

    Attributes
    ----------
    pairs : list of (w, z)
        Pole pairs in the band: modes, or a body [rad/s].
    slow_pairs : list of (w, z)
        Pole pairs below it or with more damping: a body only.
    rates : list of float
        Real poles, -p [rad/s], ascending.
    delay_s : float
        With the delay that poles far above the band cause.
    """

    pairs: list[tuple[float, float]]
    slow_pairs: list[tuple[float, float]]
    rates: list[float]
    delay_s: float


def first_error(measured: TotalVariance, settings: StructureSettings) -> float:
    """Error over the response that a linear model is allowed at first.

    Parameters
    ----------
    measured : TotalVariance
    settings : StructureSettings
    """
    return settings.smooth_error if measured.smooth_phases else settings.first_error


def first_fits(
    measured: TotalVariance, settings: StructureSettings, deadline: Deadline
) -> tuple[list[RationalModel], list[RationalModel]]:
    """Rational fits at the first allowed error, and at a larger one.

    They do not depend on the hold of the input.

    Parameters
    ----------
    measured : TotalVariance
    settings : StructureSettings
    deadline : Deadline

    Raises
    ------
    OutOfTime
        The deadline was reached before the first fit.
    """
    error = first_error(measured, settings)
    looser = max(error, settings.second_error)
    both = list(dict.fromkeys((error, looser)))
    fits = in_parallel(lambda each: rational_starts(measured.frf(each), settings, deadline), both)
    return fits[0], fits[-1]


def rational_starts(response: Frf, settings: StructureSettings, deadline: Deadline) -> list[RationalModel]:
    """Rational fits of rising order, 2/1 to `poles_max`; fits that fail are left out.

    Parameters
    ----------
    response : Frf
        With the variance that weights the lines.
    settings : StructureSettings
    deadline : Deadline
        Time at which no further fit starts; OutOfTime is raised if there is none.

    Returns
    -------
    list of RationalModel
        Of the response as it is, for the speed of the fits: with a held input their delays include half a
        sample.
    """
    found: list[RationalModel] = []
    mdl: list[float] = []
    for n in range(2, settings.poles_max + 1):
        if 2 * len(response.f_hz) < 3 * (2 * n + 1) or (mdl and len(mdl) - int(np.argmin(mdl)) > PATIENCE):
            break
        if deadline.is_over and found:
            break
        deadline.check()
        try:
            model = fit(response, (n, n - 1), hold="none", quiet=True)
        except (GsidError, ValueError):
            continue
        found.append(model)
        mdl.append(model.cost + model.n_parameters / 2 * np.log(2 * len(response.f_hz)))
    return found


def poles_of(
    model: RationalModel, w_lo: float, w_hi: float, early_s: float, settings: StructureSettings
) -> Poles:
    """Sort the poles of a rational model.

    Parameters
    ----------
    model : RationalModel
    w_lo, w_hi : float
        Band [rad/s].
    early_s : float
        Part of the model's delay that belongs to the hold [s].
    settings : StructureSettings
    """
    pairs, slow, rates, delay_s = [], [], [], model.delay_s - early_s
    for p in model.poles:
        w, z = abs(p), -p.real / abs(p) if abs(p) else 1.0
        if w == 0 or z <= 0 or p.imag < 0:
            continue
        if (p.imag > 0 and w > settings.near_hi * w_hi) or w > settings.fast * w_hi:
            delay_s += 2 * z / w if p.imag > 0 else 1 / w
        elif p.imag == 0:
            rates.append(float(w))
        elif z < settings.zeta_max and w > settings.near_lo * w_lo:
            pairs.append((float(w), float(z)))
        else:
            slow.append((float(w), float(z)))
    return Poles(sorted(pairs), sorted(slow), sorted(rates), float(delay_s))


def readings(
    poles: Poles, outputs: tuple[str, ...], w_lo: float, w_hi: float, settings: StructureSettings
) -> Iterator[Values]:
    """Every assignment of the poles to elements.

    Parameters
    ----------
    poles : Poles
    outputs : tuple of str
        What y may be.
    w_lo, w_hi : float
        Band [rad/s].
    settings : StructureSettings
    """
    for body, modes, rest in _bodies(poles):
        if len(modes) > settings.modes_max:
            continue
        short, long = settings.lag_short / w_hi, settings.lag_long / w_lo
        usable = [1 / a for a in rest if short < 1 / a < long]
        small = sum(1 / a for a in rest if 1 / a <= short)
        for n_lags in range(min(settings.lags_max, len(usable)) + 1):
            for lags in itertools.combinations(usable, n_lags):
                delay = poles.delay_s + small + sum(t for t in usable if t not in lags and t * w_hi < 1)
                for output, residual in itertools.product(outputs, (False, True)):
                    yield Values.of(output, body, modes, list(lags), delay, residual)


def _bodies(poles: Poles) -> Iterator[tuple[tuple[float, ...], list[tuple[float, float]], list[float]]]:
    """Body, modes and remaining real poles."""
    pairs, rates = poles.pairs, poles.rates
    yield (), pairs, rates
    for i, rate in enumerate(rates):
        yield (rate,), pairs, rates[:i] + rates[i + 1 :]
    for w, z in poles.slow_pairs:
        yield (2 * z * w, w**2), pairs, rates
    if pairs:  # the lowest pair as the body
        w, z = pairs[0]
        yield (2 * z * w, w**2), pairs[1:], rates
    for (i, a), (j, b) in itertools.combinations(enumerate(rates), 2):
        yield (a + b, a * b), pairs, [r for k, r in enumerate(rates) if k not in (i, j)]
