"""Score every effect of the catalogue against the residual of a fit, over a grid of its shape parameters."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from gsid.diagnosis.probes import (
    Probe,
    Trajectory,
    locked_rates,
    nominal_rates,
    probes,
    quantization_at,
    quantization_spacing,
    sample_hold_at,
)
from gsid.diagnosis.score_test import Score, orthonormal, score
from gsid.effects.types import catalogue, find
from gsid.greybox.fit import PlantFit, RecordFit
from gsid.plant.model import PlantModel
from gsid.plant.units import RADIANS

NOT_SEARCHED = frozenset(effect.id for effect in catalogue().values() if effect.not_searched)
TURNS_ONLY = frozenset(effect.id for effect in catalogue().values() if effect.turns_only)
ZOOMS, ZOOM_POINTS = 4, 8  # refinements of the grid of quantization steps, and points on each side
SAMPLER, RATES = "sensor_sample_hold", 5  # effect; number of rates scored in all records

Scored = list[tuple[Probe, Score]]


def with_probe(model: PlantModel, probe: Probe, size: np.ndarray) -> PlantModel:
    """Copy a model, add the effect of a probe, and reduce the model's delay by the delay of the effect.

    Parameters
    ----------
    model : PlantModel
    probe : Probe
    size : ndarray
        Coefficients of the probe's columns.
    """
    larger = model.with_effect(probe.effect, probe.start(size), probe.limits, probe.fixed)
    less_delay_s = probe.less_delay_s(size)
    if less_delay_s > 0:
        larger["transport_delay.delay_s"].value -= less_delay_s
    return larger


def trajectory(model: PlantModel, record: RecordFit) -> Trajectory:
    """Simulated trajectory of a fitted model with the excitation of one record.

    Parameters
    ----------
    model : PlantModel
    record : RecordFit
        Result of the model's fit for this record.
    """
    one = record.spectra
    view = model.linear_response(one)
    return Trajectory(
        fs_hz=one.fs_hz,
        command=model.drive_command(one, record.prediction),
        angle=record.prediction.angle,
        rate=record.prediction.rate,
        output=record.prediction.y,
        f_hz=one.f_hz,
        excited=one.excited,
        torque_response=view.torque,
        change_response=view.change,
        direct_response=view.direct,
        radians_per_unit=RADIANS[model.angle_unit],
        spare_delay_s=_spare_delay(model),
    )


def _spare_delay(model: PlantModel) -> float:
    name = "transport_delay.delay_s"
    return model[name].value if name in model.free_names else 0.0


def _absent(model: PlantModel) -> list[str]:
    present = {effect.id for effect in model.effects}
    left_out = present | NOT_SEARCHED | (TURNS_ONLY if model.angle_unit == "m" else frozenset())
    return [effect for effect in catalogue() if effect not in left_out]


def scan(fit: PlantFit, effects: Sequence[str] | None = None) -> Scored:
    """Score every probe of some effects; default: of all effects that the model does not contain."""
    absent = _absent(fit.model) if effects is None else effects
    trajectories = [trajectory(fit.model, record) for record in fit.records]
    several = list(probes(trajectories, absent))
    if "torque_bias" in absent:
        bias = _bias_probe(fit)
        if find("torque_bias")["level"].typical * np.linalg.norm(fit.whitened(bias.columns)) > 1:
            several.append(bias)  # otherwise the plant is linear, and a constant torque has no effect
    residual, nuisance = fit.residual, orthonormal(fit.jacobian)

    def judged(several: Iterable[Probe]) -> Scored:
        return [
            (probe, score(residual, nuisance, fit.whitened(probe.columns), one_sided=probe.one_sided))
            for probe in several
        ]

    scored = judged(several)
    for _ in range(ZOOMS):
        scored += judged(_nearer_step(trajectories, scored))
    return scored


def scan_rates(fit: PlantFit) -> tuple[Scored, int]:
    """Score the sample and hold of a sensor at nominal rates, and at the best rates of a dense grid.

    If the refreshes repeat with the period, their images lie on lines of their own. A rate that is wrong by
    one over the period then misses these lines. Every rate that repeats with the period is therefore scored
    in the record with the largest input, and the best rates in all records.

    Parameters
    ----------
    fit : PlantFit

    Returns
    -------
    list of (Probe, Score), int
        The scores, and the number of rates from which the best was chosen.
    """
    if any(effect.id == SAMPLER for effect in fit.model.effects):
        return [], 0
    record = max(fit.records, key=lambda one: float(np.linalg.norm(one.spectra.u)))
    path = trajectory(fit.model, record)
    residual, nuisance = record.residual, orthonormal(record.jacobian)
    seen = []
    for probe in sample_hold_at([path], locked_rates(path), exact=True):
        column = (probe.columns[0][0][record.line] * record.weight)[:, None]
        item = _as_it_is(score(residual, nuisance, np.vstack([column.real, column.imag]), one_sided=True))
        seen.append((item.drop, probe.start(item.size)["rate_hz"]))
    best = [rate for _, rate in sorted(seen, reverse=True)[:RATES]]
    paths = [trajectory(fit.model, one) for one in fit.records]
    nominal = nominal_rates(path.fs_hz)
    residual, nuisance = fit.residual, orthonormal(fit.jacobian)
    scored = [
        (probe, _as_it_is(score(residual, nuisance, fit.whitened(probe.columns), one_sided=True)))
        for probe in sample_hold_at(paths, list(dict.fromkeys([*best, *nominal])), exact=True)
    ]
    return scored, len(seen) + len(nominal)


def _as_it_is(item: Score) -> Score:
    """Score of a candidate with coefficient 1 in place of c, because the size of its effect is fixed."""
    c = float(item.size[0])
    return replace(item, drop=item.drop * (2 * c - 1) / c**2 if c > 0 else 0.0)


def _nearer_step(trajectories: list[Trajectory], scored: Scored) -> Iterator[Probe]:
    """Grid points around the best quantization step, which a fit cannot refine for lack of a derivative."""
    steps = [
        (item.drop, probe.start(item.size)["step"]) for probe, item in scored if probe.fixed == ("step",)
    ]
    if steps:
        known = np.array([step for _, step in steps])
        best = max(steps)[1]
        gaps = np.abs(known - best)
        spacing = np.min(gaps[gaps > 0], initial=quantization_spacing(trajectories, best))
        yield from quantization_at(
            trajectories, best + spacing * np.linspace(-1, 1, 2 * ZOOM_POINTS + 1)[1:-1]
        )


def _bias_probe(fit: PlantFit) -> Probe:
    """Probe of a constant torque by simulation, because it acts only through the nonlinear laws."""
    biased = copy.deepcopy(fit.model)
    for effect in biased.effects:
        for param in effect.params.values():
            param.free = False
    biased = biased.with_effect("torque_bias", {"level": 0.0})
    columns = [biased.predict(one.spectra, sensitivities=True).dY for one in fit.records]
    return Probe("torque_bias", columns, lambda c: {"level": float(c[0])})
