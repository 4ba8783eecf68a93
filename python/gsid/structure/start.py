"""The linear structure of an axis from its records, without starting values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import GsidError, InputError
from gsid.base.hold import ALIKE, DECLARE, MEANING, READINGS, likelier, other_reading
from gsid.base.plottable import Plottable
from gsid.base.tables import Table
from gsid.base.threads import with_one_thread_for_algebra
from gsid.effects.types import find
from gsid.fitting.rational import fit
from gsid.models.rational import RationalModel
from gsid.plant.effect import Effect, Param
from gsid.plant.model import OUTPUTS as OF_PLANTS
from gsid.plant.model import PlantModel
from gsid.plant.units import angle_unit_of, kind_of_unit, torque_text
from gsid.records.clipping import clipped_text
from gsid.records.record import Record
from gsid.response.sample_hold import held_response
from gsid.response.total_variance import TotalVariance
from gsid.spectrum.spectra import Spectra, require_motion_of_output
from gsid.structure.covariance import Estimate, estimate
from gsid.structure.elements import OUTPUTS
from gsid.structure.friction import with_friction
from gsid.structure.held_sensor import EFFECT, RATE, Measurement, before_sensor, measurement
from gsid.structure.readings import first_fits
from gsid.structure.refusals import least_half_width
from gsid.structure.select import Selection, rescored, select
from gsid.structure.settings import StructureSettings
from gsid.structure.stack import Stack, as_rational, as_stack

OTHERS = 4
"""Likely structures that are listed as ambiguous, at most."""


@dataclass(eq=False, repr=False)
class Start(Plottable):
    """Linear structure of an axis.

    Attributes
    ----------
    effects : dict
        Stack of effects as {effect: {parameter: value}}; empty where no stack represents the data. Units are
        those of the catalogue with degrees replaced by the unit of y; a second effect of an id is "id#2".
    std, std_noise_only : dict
        Standard deviations as {effect: {parameter: value}}: from the errors that the fit left, and from the
        noise alone. Parameters that were not estimated are left out. They refer to the parameters of the best
        linear approximation, which friction changes; docs/explanation/linear_structure.md has the coverage.
    ambiguous : list of dict
        What the data do not decide: "what", "chosen", "other", and the difference of the scores [nats]. A
        difference of 0 means the same function.
    output : {"rate", "angle", "acceleration"}
        What y is.
    hold : {"zoh", "none"}
    cost_per_line : float
        Sum of squared errors over the total variance, per line: 1 where only noise and distortion are left.
    relative_error : float
        Error over the response that the selection allowed the linear model.
    order : str
        Poles/zeros of the transfer function.
    assumed : list of str
        What the result relies on and the data do not show.
    represented : bool
        Whether a stack of effects represents the data.
    rational : RationalModel
        The same transfer function; where no stack represents the data, the best rational fit.
    measured : TotalVariance
        Best linear approximation with its variance, with the sensor's hold.
    sensor_rate_hz : float or None
        Refresh rate of a sensor that is sampled and held [Hz]; None where no images of one were detected.
        `effects` has it as an effect; `rational` does not contain it where a stack represents the data.
    covariance : (n, n) ndarray
        Of the estimated parameters, in the order of `names`.
    names : list of str
        "effect.parameter" of the estimated parameters.
    inertia_kg_m2 : float or None
        Inertia of the axis, with which the parameters are also printed as torques.
    """

    effects: dict[str, dict[str, float]]
    std: dict[str, dict[str, float]]
    std_noise_only: dict[str, dict[str, float]]
    ambiguous: list[dict[str, Any]]
    output: str
    hold: str
    cost_per_line: float
    relative_error: float
    order: str
    assumed: list[str]
    represented: bool
    rational: RationalModel
    measured: TotalVariance
    sensor_rate_hz: float | None = None
    covariance: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    names: list[str] = field(default_factory=list)
    inertia_kg_m2: float | None = None

    def model(self) -> PlantModel:
        """Return the stack as a plant model with its covariance.

        Raises
        ------
        InputError
            No stack represents the data, or y is an acceleration, which no plant model has as output.
        """
        if not self.represented:
            what = "no stack of effects represents the data"
            raise InputError(what, self.measured.name, None, "use the rational model: Start.rational")
        if self.output not in OF_PLANTS:
            hint = "use the rational model: Start.rational"
            raise InputError("a plant model has no such output", self.measured.name, self.output, hint)
        effects = [
            Effect(label.partition("#")[0], {n: self._param(label, n, v) for n, v in params.items()})
            for label, params in self.effects.items()
        ]
        model = PlantModel(
            fs_hz=self.measured.fs_hz,
            effects=effects,
            output=self.output,
            angle_unit=angle_unit_of(self.measured.y_unit),
            u_unit=self.measured.u_unit,
            y_unit=self.measured.y_unit,
            inertia_kg_m2=self.inertia_kg_m2,
        )
        order = [self.names.index(name) for name in model.free_names]
        model.cov = self.covariance[np.ix_(order, order)]
        return model

    def _param(self, effect: str, name: str, value: float) -> Param:
        std = self.std.get(effect, {}).get(name)
        return Param(value, free=std is not None, std=std)

    def save(self, path: str | Path) -> None:
        """Write a model file: the stack where there is one, else the rational model."""
        (self.model() if self.has_model else self.rational).save(path)

    def response(self, f_hz: np.ndarray) -> np.ndarray:
        """Response of the model with the sensor's hold, (F,) complex.

        Parameters
        ----------
        f_hz : (F,) ndarray
            Hz.
        """
        response = self.rational.response(f_hz)
        if self.sensor_rate_hz is None or not self.represented:
            return response
        measured = self.measured
        return response * held_response(f_hz, self.sensor_rate_hz, measured.fs_hz, measured.period_samples)

    @property
    def has_model(self) -> bool:
        """Whether :meth:`model` gives a stack of effects."""
        return self.represented and self.output in OF_PLANTS

    def to_dict(self) -> dict[str, Any]:
        """What `gsid start --json` prints."""
        names = (
            "effects", "std", "std_noise_only", "ambiguous", "output", "hold", "cost_per_line",
            "relative_error", "order", "assumed", "represented", "sensor_rate_hz",
        )  # fmt: skip
        known = {name: getattr(self, name) for name in names}
        rational = {"num": self.rational.num, "den": self.rational.den, "delay_s": self.rational.delay_s}
        lines = {"n_lines": len(self.measured), "variance_from": self.measured.largest_source}
        words = {"summary": self.summary(), "notes": self.notes()}
        return known | {"rational": rational} | lines | words

    def table(self) -> Table:
        """Values with their standard deviations, and those by the noise only."""
        unit_of_angle = self.measured.y_unit.partition("/")[0] or "deg"
        rows, more = [], []
        if self.inertia_kg_m2 is not None:
            more = [f"with {self.inertia_kg_m2:.5g} kg m^2"]
        for label, params in self.effects.items():
            for name, value in params.items():
                std, noise = (of.get(label, {}).get(name) for of in (self.std, self.std_noise_only))
                effect = label.partition("#")[0]
                unit = find(effect)[name].unit.replace("deg", unit_of_angle)
                torque = torque_text(
                    effect, name, value, self.inertia_kg_m2, unit_of_angle, self.measured.u_unit
                )
                spread = ["fixed", ""] if std is None else [f"{std:.2g}", f"{noise:.2g}"]
                rows.append([label, name, f"{value:.6g}", *spread, unit, *([torque] if more else [])])
        head = ["effect", "parameter", "value", "std", "noise only", "unit", *more]
        return Table(head, rows, left=["effect", "parameter", "unit", *more], title=self.summary())

    def summary(self) -> str:
        """One line: what the axis is, and how well the model represents it."""
        if not self.represented:
            return f"No stack of effects represents the data; rational model of order {self.order}."
        return (
            f"y is the {self.output}; order {self.order}, {len(self.measured)} lines, "
            f"cost per line {self.cost_per_line:.3g}"
        )

    def notes(self) -> list[str]:
        """Ambiguities and assumptions as sentences."""
        texts = []
        for one in self.ambiguous:
            by = "same function" if one["score"] == 0 else f"score {one['score']:+.1f}"
            texts.append(f"ambiguous: {one['what']}: {one['chosen']}, or {one['other']} ({by})")
        return texts + [f"assumed: {text}" for text in self.assumed]

    def __repr__(self) -> str:
        values = [self.table().text()] if self.effects else []
        return "\n".join([f"Start: {self.summary()}", *values, *self.notes()])

    def _repr_html_(self) -> str:
        return self.table().html() + Table((), [[text] for text in self.notes()]).html()


@with_one_thread_for_algebra
def start(
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    output: str | None = None,
    period: int | None = None,
    settle: int | None = None,
    band: tuple[float, float] | None = None,
    reference: str | None = None,
    settings: StructureSettings | None = None,
    deadline: Deadline | None = None,
) -> Start:
    """Find the linear structure of an axis: rigid body, damping, spring, modes, lags and delay.

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
        One per realisation and level. Two or more realisations with random phases measure the distortion.
    output : {"rate", "angle", "acceleration"}, optional
        What y is; default: by its unit. Without a unit, and where no such stack represents the data, it is
        inferred from the data.
    period, settle : int, optional
        Samples; default: what each record states, else what its data show. Not used for Spectra.
    band : (lo, hi), optional
        Only lines within [Hz].
    reference : str, optional
        Of records measured in a closed loop: the column of its reference.
    settings : StructureSettings, optional
        Constants of the search.
    deadline : Deadline, optional
        Time at which the search ends with the best structure so far.

    Returns
    -------
    Start
        BLA-4, STR-1 to STR-5.

    Raises
    ------
    InputError
        As `gsid.frf`, or fewer lines than a structure has parameters.
    ValueError
        No record, or an unknown output.
    OutOfTime
        The deadline was reached before any structure was fitted.
    """
    if output is not None and output not in OUTPUTS:
        raise ValueError(f"output must be one of {', '.join(OUTPUTS)}, got {output!r}")
    settings = settings or StructureSettings()
    source = measurement(records, period, settle, band, reference)
    for one in source.records:
        _require_motion(one)
    measured = source.total_variance()
    if len(measured) < settings.lines_min:
        hint = "excite more lines, or widen the band"
        raise InputError("too few lines for a structure", measured.name, len(measured), hint)
    rate_hz = source.sensor_rate_hz()
    axis = before_sensor(measured, rate_hz)
    outputs = _outputs(output, measured.y_unit)
    best, found = _likeliest(axis, source, outputs, settings, deadline)
    if output is None and outputs != OUTPUTS and not best.selection.represents:
        try:
            best, found = _likeliest(axis, source, OUTPUTS, settings, deadline)
            outputs = OUTPUTS
        except OutOfTime:
            best.selection.complete = False
    if rate_hz is not None and rate_hz < 2 * measured.f_hz[-1] and best.selection.represents:
        model = best.selection.chosen.fitted
        cleared = source.without_images(model, rate_hz, best.hold)
        if cleared is not None:
            try:
                best, found = _likeliest(before_sensor(cleared, rate_hz), source, outputs, settings, deadline)
                measured, axis = cleared, before_sensor(cleared, rate_hz)
            except OutOfTime:
                best.selection.complete = False
    described = _described(best, found, measured, axis, rate_hz, output)
    described.assumed += _of_ends(source.records)
    return described


def _require_motion(one: Record | Spectra) -> None:
    """Refuse a record whose output is constant: its variance has no solution."""
    if isinstance(one, Spectra):
        require_motion_of_output([one])
    elif np.ptp(one.y[one.valid]) == 0:
        hint = "select the output with --y, and check that the axis moved"
        raise InputError("y is constant: nothing was measured", one.name, None, hint)


def _outputs(output: str | None, y_unit: str) -> tuple[str, ...]:
    """What y may be. Its unit is a statement: friction turns a rate into a likelier angle."""
    stated = output or kind_of_unit(y_unit)
    return OUTPUTS if stated is None else (stated,)


def _likeliest(
    axis: TotalVariance,
    source: Measurement,
    outputs: tuple[str, ...],
    settings: StructureSettings,
    deadline: Deadline | None,
) -> tuple[_Found, dict[str, _Found]]:
    """The structure under the likelier hold of the input, and under each."""
    found = _under_each_hold(axis, source, outputs, settings, deadline)
    return found[_likelier_hold(found, axis)], found


@dataclass(frozen=True, eq=False)
class _Found:
    """Selection under one hold, with its estimate."""

    hold: str
    selection: Selection
    estimate: Estimate
    stack: Stack


def _under_each_hold(
    measured: TotalVariance,
    source: Measurement,
    outputs: tuple[str, ...],
    settings: StructureSettings,
    deadline: Deadline | None,
) -> dict[str, _Found]:
    """The structure under the stated hold, or under both, as far as the time allows."""
    holds = READINGS if measured.hold is None else (measured.hold,)
    fits = first_fits(measured, settings, deadline or Deadline())
    how = {"expected_output": kind_of_unit(measured.y_unit), "deadline": deadline, "fits": fits}
    found = {}
    for hold in holds:
        try:
            selection = select(measured, hold, outputs, settings, **how)
        except OutOfTime:
            if not found:
                raise
            break
        selection = with_friction(selection, measured, source, deadline)
        exact = estimate(selection.chosen.fitted, selection.data, measured.var_noise, selection.correlation)
        found[hold] = _Found(hold, selection, exact, as_stack(exact, float(measured.f_hz[-1])))
    return found


def _likelier_hold(found: dict[str, _Found], measured: TotalVariance) -> str:
    if len(found) == 1:
        return next(iter(found))
    represented = [hold for hold in found if found[hold].selection.represents]
    if len(represented) == 1:
        return represented[0]
    return likelier(_deviances(found, measured))


def _deviances(found: dict[str, _Found], measured: TotalVariance) -> dict[str, float]:
    """Twice the scores of both holds, at the same weights."""
    names = ("relative_error", "correlation", "scale")
    common = {name: max(getattr(one.selection, name) for one in found.values()) for name in names}
    return {hold: 2 * rescored(one.selection, measured, **common) for hold, one in found.items()}


def _described(
    best: _Found,
    found: dict[str, _Found],
    measured: TotalVariance,
    axis: TotalVariance,
    rate_hz: float | None,
    output: str | None,
) -> Start:
    """The result in words and numbers."""
    selection, fitted = best.selection, best.estimate.fitted
    represented = selection.represents
    if represented:
        rational = _rational(best, axis)
        rest = np.abs(axis.g - fitted.response(selection.data.lines)) ** 2 / axis.var_total
    else:
        rational = _best_rational(best, measured)
        rest = np.abs(measured.g - rational.response(measured.f_hz)) ** 2 / measured.var_total
    stack = best.stack
    std, noise = (_by_effect(stack.names, cov) for cov in (stack.covariance, stack.noise_only))
    return Start(
        effects=_with_sensor(stack.effects, rate_hz) if represented else {},
        std=std if represented else {},
        std_noise_only=noise if represented else {},
        ambiguous=_ambiguous(best, found, axis, output) if represented else [],
        output=fitted.structure.output,
        hold=best.hold,
        cost_per_line=float(np.mean(rest)),
        relative_error=float(selection.relative_error),
        order=f"{rational.n_poles}/{rational.n_zeros}",
        assumed=_assumed(best, measured, rate_hz, output, represented),
        represented=represented,
        rational=rational,
        measured=measured,
        sensor_rate_hz=rate_hz,
        covariance=stack.covariance,
        names=stack.names,
    )


def _with_sensor(effects: dict[str, dict[str, float]], rate_hz: float | None) -> dict[str, dict[str, float]]:
    return effects if rate_hz is None else effects | {EFFECT: {RATE: rate_hz}}


def _by_effect(names: list[str], covariance: np.ndarray) -> dict[str, dict[str, float]]:
    out: dict[str, dict[str, float]] = {}
    for name, variance in zip(names, np.diag(covariance), strict=True):
        effect, _, parameter = name.rpartition(".")
        out.setdefault(effect, {})[parameter] = math.sqrt(max(float(variance), 0.0))
    return out


def _rational(best: _Found, measured: TotalVariance) -> RationalModel:
    num, den = as_rational(best.estimate)
    can_hold = best.hold == "zoh" and len(num) <= len(den)
    delay_s = best.estimate.fitted.values.delay_s
    return RationalModel(
        num,
        den,
        delay_s + (0.5 / measured.fs_hz if best.hold == "zoh" and not can_hold else 0.0),
        fs_hz=measured.fs_hz,
        hold="zoh" if can_hold else "none",
        n_lines=len(measured),
        band_hz=(float(measured.f_hz[0]), float(measured.f_hz[-1])),
        u_unit=measured.u_unit,
        y_unit=measured.y_unit,
    )


def _best_rational(best: _Found, measured: TotalVariance) -> RationalModel:
    """The rational fit of least MDL under the hold."""
    models = best.selection.rational
    if not models:
        raise InputError("no rational model fits the response", measured.name, None, "check the records")
    n2 = 2 * len(measured)
    least = min(models, key=lambda m: m.cost + m.n_parameters / 2 * np.log(n2))
    response = measured.frf(best.selection.relative_error)
    try:
        return fit(response, (least.n_poles, least.n_zeros), hold=best.hold, quiet=True)
    except (GsidError, ValueError):
        return least


def _ambiguous(
    best: _Found, found: dict[str, _Found], measured: TotalVariance, output: str | None
) -> list[dict[str, Any]]:
    """What the data do not decide."""
    structure, values = best.estimate.fitted.structure, best.estimate.fitted.values
    entries: list[dict[str, Any]] = []

    def add(what: str, chosen: str, other: str, score: float) -> None:
        entries.append({"what": what, "chosen": chosen, "other": other, "score": score})

    if structure.n_lags == 1:
        add("lag", "sensor_lag", "motor_lag", 0.0)
    is_inferred = output is None and kind_of_unit(measured.y_unit) != structure.output
    if is_inferred and (structure.output, structure.body) == ("angle", "viscous"):
        add("output", "angle, viscous body", f"rate, free body with a lag of {1 / values.rate:.3g} s", 0.0)
    is_body_and_lag = (structure.n_lags, structure.n_modes, structure.residual) == (1, 0, False)
    if is_inferred and (structure.output, structure.body) == ("rate", "viscous") and is_body_and_lag:
        add("output", "rate, viscous body, 1 lag", "angle, overdamped spring", 0.0)
    chosen = best.selection.chosen
    for one in best.selection.likely[:OTHERS]:
        if one is not chosen:
            add("structure", structure.text(), one.structure.text(), float(one.score - chosen.score))
    if len(found) > 1 and all(one.selection.represents for one in found.values()):
        deviance = _deviances(found, measured)
        other = other_reading(best.hold)
        difference = (deviance[other] - deviance[best.hold]) / 2
        if difference <= ALIKE / 2 + best.selection.settings.odds:
            add("hold", best.hold, other, float(difference))
    return entries


def _of_output(kind: str, unit: str) -> str:
    """How it is known what y is."""
    stated = kind_of_unit(unit)
    if stated == kind:
        return f"y is the {kind}, by its unit {unit}; --output states another"
    against = "" if stated is None else f" against its unit {unit} ({stated})"
    return f"y is the {kind}, inferred from the data{against}; --output states it"


def _of_ends(records: Sequence[Record | Spectra]) -> list[str]:
    """The assumption that the output is the motion, where it may be clipped."""
    stays = clipped_text(one for one in records if isinstance(one, Record))
    return [f"y is the motion of the axis, although {stays}"] if stays else []


def _assumed(
    best: _Found,
    measured: TotalVariance,
    rate_hz: float | None,
    output: str | None,
    represented: bool,
) -> list[str]:
    """What the result relies on."""
    texts = [
        f"period {measured.period_samples} samples, {measured.settle_samples} samples discarded at the start"
    ]
    texts.append(f"lines {measured.f_hz[0]:.4g} to {measured.f_hz[-1]:.4g} Hz")
    if measured.hold is None:
        texts.append(f"the input was {MEANING[best.hold]}; to decide, {DECLARE}")
    if rate_hz is not None:
        texts.append(
            f"the sensor is sampled and held {rate_hz:g} times a second, by the images of the excitation"
        )
    if not best.selection.complete:
        texts.append("the structure is the best one so far: the time was over before the search ended")
    if represented and output is None:
        texts.append(_of_output(best.estimate.fitted.structure.output, measured.y_unit))
    elif represented and kind_of_unit(measured.y_unit) not in (None, output):
        unit = f"{measured.y_unit} ({kind_of_unit(measured.y_unit)})"
        texts.append(f"y is the {output}, as stated, against its unit {unit}; --unit NAME=UNIT corrects it")
    if represented and not measured.y_unit:
        texts.append("y is in degrees, as no unit is stated; --unit NAME=UNIT states it")
    if measured.smooth_phases:
        texts.append(
            "one realisation with smooth phases does not show its distortion: a response error of "
            f"{100 * best.selection.relative_error:.0f} % was allowed; measure a second realisation with "
            "random phases"
        )
    if represented and best.selection.friction is not None:
        texts.append(
            f"dry friction of {best.selection.friction:.3g} {measured.u_unit}".rstrip()
            + " along the measured motion decided between structures; the values are those of the best "
            "linear approximation"
        )
    if represented and best.estimate.fitted.structure.residual:
        texts.append("modes above the band are one mode at a fixed frequency above it")
    if represented and _has_narrow_body(best.selection):
        texts.append(
            "the resonance of the spring is narrower than the distance of the lines: its damping rests on "
            "the lines beside it"
        )
    delay_s = best.estimate.fitted.values.delay_s
    if represented and delay_s <= 0:
        texts.append(f"no delay (estimated {1e3 * delay_s:.3g} ms)")
    return texts


def _has_narrow_body(selection: Selection) -> bool:
    values = selection.chosen.fitted.values
    narrow = least_half_width(selection.data.lines, selection.settings)
    return values.structure.body == "sprung" and values.rate / 2 <= narrow
