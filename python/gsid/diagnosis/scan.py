"""What a fit leaves, and every effect of the catalogue scored against it over a grid of its shapes."""

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
from gsid.greybox.fit import PlantFit, RecordFit, stacked, whitened
from gsid.plant.model import PlantModel
from gsid.plant.units import RADIANS
from gsid.spectrum.spectra import Spectra

NOT_SEARCHED = frozenset(effect.id for effect in catalogue().values() if effect.not_searched)
TURNS_ONLY = frozenset(effect.id for effect in catalogue().values() if effect.turns_only)
ZOOMS, ZOOM_POINTS = 4, 8  # refinements of a step's grid, points on each side: to one sample in 10 000
SAMPLER, RATES = "sensor_sample_hold", 5  # effect; rates that are looked at in all records

Scored = list[tuple[Probe, Score]]


def with_probe(model: PlantModel, probe: Probe, size: np.ndarray) -> PlantModel:
    """A copy of a model with a probe's effect, and as much less delay as the effect brings itself.

    Parameters
    ----------
    model : PlantModel
    probe : Probe
    size : ndarray
        Coefficients of its columns.
    """
    larger = model.with_effect(probe.effect, probe.start(size), probe.limits, probe.fixed)
    less_delay_s = probe.less_delay_s(size)
    if less_delay_s > 0:
        larger["transport_delay.delay_s"].value -= less_delay_s
    return larger


def trajectory(model: PlantModel, record: RecordFit, one: Spectra) -> Trajectory:
    """Path of a fitted model under one record's excitation.

    Parameters
    ----------
    model : PlantModel
    record : RecordFit
        Of the model's fit.
    one : Spectra
        The record.
    """
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


def scan(fit: PlantFit, measured: list[Spectra], effects: Sequence[str] | None = None) -> Scored:
    """Every probe of some effects; default: of all that the model does not have."""
    absent = _absent(fit.model) if effects is None else effects
    trajectories = [
        trajectory(fit.model, record, one) for record, one in zip(fit.records, measured, strict=True)
    ]
    tried = list(probes(trajectories, absent))
    if "torque_bias" in absent:
        bias = _bias_probe(fit.model, measured)
        if find("torque_bias")["level"].typical * np.linalg.norm(whitened(fit, bias.columns)) > 1:
            tried.append(bias)  # else a linear plant: a constant torque is not seen at all
    residual, nuisance = stacked(fit, "residual")[:, 0], orthonormal(stacked(fit, "jacobian"))

    def judged(several: Iterable[Probe]) -> Scored:
        return [
            (probe, score(residual, nuisance, whitened(fit, probe.columns), one_sided=probe.one_sided))
            for probe in several
        ]

    scored = judged(tried)
    for _ in range(ZOOMS):
        scored += judged(_nearer_step(trajectories, scored))
    return scored


def scan_rates(fit: PlantFit, measured: list[Spectra]) -> tuple[Scored, int]:
    """A sensor's refresh at nominal rates, and at those rates of all that the loudest record speaks for.

    Images of a refresh that repeats with the period fall on lines of their own, so a rate is missed by as
    little as one over the period: every whole rate is looked at, in one record, and the best in all.

    Parameters
    ----------
    fit : PlantFit
    measured : list of Spectra

    Returns
    -------
    list of (Probe, Score), int
        And how many rates were looked at: that many shapes the best is the best of.
    """
    if any(effect.id == SAMPLER for effect in fit.model.effects):
        return [], 0
    loudest = max(range(len(measured)), key=lambda i: float(np.linalg.norm(measured[i].u)))
    record = fit.records[loudest]
    path = trajectory(fit.model, record, measured[loudest])
    residual, nuisance = record.residual, orthonormal(record.jacobian)
    seen = []
    for probe in sample_hold_at([path], locked_rates(path), exact=True):
        column = (probe.columns[0][0][record.line] * record.weight)[:, None]
        item = _as_it_is(score(residual, nuisance, np.vstack([column.real, column.imag]), one_sided=True))
        seen.append((item.drop, probe.start(item.size)["rate_hz"]))
    best = [rate for _, rate in sorted(seen, reverse=True)[:RATES]]
    paths = [trajectory(fit.model, r, one) for r, one in zip(fit.records, measured, strict=True)]
    nominal = nominal_rates(path.fs_hz)
    residual, nuisance = stacked(fit, "residual")[:, 0], orthonormal(stacked(fit, "jacobian"))
    scored = [
        (probe, _as_it_is(score(residual, nuisance, whitened(fit, probe.columns), one_sided=True)))
        for probe in sample_hold_at(paths, list(dict.fromkeys([*best, *nominal])), exact=True)
    ]
    return scored, len(seen) + len(nominal)


def _as_it_is(item: Score) -> Score:
    """The drop of a candidate whose size is fixed: of c times its column only one is to be had."""
    c = float(item.size[0])
    return replace(item, drop=item.drop * (2 * c - 1) / c**2 if c > 0 else 0.0)


def _nearer_step(trajectories: list[Trajectory], scored: Scored) -> Iterator[Probe]:
    """Points between the best step of a rounding and its neighbours: it has no slope for a fit to follow."""
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


def _bias_probe(model: PlantModel, measured: list[Spectra]) -> Probe:
    """A constant torque shifts where the other laws work: it shows only through them, so it is simulated."""
    biased = copy.deepcopy(model)
    for effect in biased.effects:
        for param in effect.params.values():
            param.free = False
    biased = biased.with_effect("torque_bias", {"level": 0.0})
    columns = [biased.predict(one, sensitivities=True).dY for one in measured]
    return Probe("torque_bias", columns, lambda c: {"level": float(c[0])})
