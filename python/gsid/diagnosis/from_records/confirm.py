"""Fits by simulation of the laws on the short list, within a budget of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gsid.base.cached import cached_property
from gsid.base.deadline import Deadline, OutOfTime
from gsid.diagnosis.from_records.law_part import label_of
from gsid.diagnosis.from_records.play import (
    DOUBTFUL,
    fit_play,
    fit_play_from,
    left_by_refits,
    with_hidden_mode,
)
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.from_records.simulation_error import noise_p_value
from gsid.diagnosis.leave_out import leave_out
from gsid.greybox.fit import CANNOT_FIT, PlantFit, RecordFit, fit_plant
from gsid.plant.effect import Effect
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel
from gsid.plant.periodic import PeriodicPlant
from gsid.spectrum.spectra import Spectra

LINEAR_PART = "the linear part"  # name of a fit without a law


def name_of(effects: Sequence[str]) -> str:
    """A law, or the linear part, as a user reads it.

    Parameters
    ----------
    effects : sequence of str
    """
    return " and ".join(effects) or LINEAR_PART


@dataclass(frozen=True, eq=False)
class Simulated:
    """A law, or none, with the linear part, fitted by simulation.

    Attributes
    ----------
    effects : tuple of str
        Empty: the linear part alone.
    fit : PlantFit
    converged : bool
        Whether a further step would lower the cost by less than a thousandth, or by less than noise.
    kept : float
        Kept-out cost per whitened number; 1 is noise.
    scatter, scatter_error : float
        Of the law's coefficient over what was left out, relative to it, and what noise makes of it.
    stalled : bool
        Whether the last iterations lowered the cost by less than noise: parameters that the data do not
        distinguish, such as the level and the angle of an unbalance at small angles.
    weighed : float or None
        Cost with the weights of a model error; None with those of noise.
    left_out : tuple of (2 k,) ndarray or None
        Whitened error of each record, simulated with the fit to the others; None: what is kept out was
        linearised at the fit to all.
    """

    effects: tuple[str, ...]
    fit: PlantFit
    converged: bool
    kept: float
    scatter: float
    scatter_error: float
    stalled: bool = False
    weighed: float | None = None
    left_out: tuple[np.ndarray, ...] | None = None

    @property
    def name(self) -> str:
        """The law as a user reads it."""
        return name_of(self.effects)

    @property
    def cost(self) -> float:
        """-2 log likelihood; with the weights of a model error, if it was judged with them."""
        return self.fit.cost if self.weighed is None else self.weighed

    @property
    def model(self) -> PlantModel:
        """The fitted model."""
        return self.fit.model

    @cached_property
    def noise_p_value(self) -> float:
        """p-value of what the fit leaves, without the error of its simulation."""
        return noise_p_value(self.fit)

    @property
    def has_reliable_share(self) -> bool:
        """Whether what is kept out is that of a minimum, or was found by refits."""
        return self.converged or self.stalled or self.left_out is not None

    @property
    def label(self) -> str:
        """Label of the law in the model."""
        return label_of(self.model, self.effects[0])


@dataclass
class Simulations:
    """Fits by simulation, one after the other, until the time is over.

    Parameters
    ----------
    measured : list of Spectra
    band : (lo, hi) or None
    deadline : Deadline
    settings : DecisionSettings
    on_step : callable
    known : tuple of Effect
        Laws of a given model and a controller, which every fit contains.
    left_out : tuple of str
        Effects that no fit contains.
    not_tried : dict of str
        Laws that were not fitted, with the reason.
    """

    measured: list[Spectra]
    band: tuple[float, float] | None
    deadline: Deadline
    settings: DecisionSettings
    on_step: Callable[[str], None]
    known: tuple[Effect, ...] = ()
    left_out: tuple[str, ...] = ()
    not_tried: dict[str, str] = field(default_factory=dict)

    def fit(
        self, model: PlantModel, effects: Sequence[str], to_beat: float | None = None
    ) -> Simulated | None:
        """Fit a model; None if there was no time, or if it cannot be simulated.

        Parameters
        ----------
        model : PlantModel
            With its starting values.
        effects : sequence of str
            The law.
        to_beat : float, optional
            Cost of the winner: a fit that cannot reach it is given up.
        """
        name = name_of(effects)
        if not self._may_begin(name):
            return None
        model = self.completed(model)
        if not set(effects) <= {effect.id for effect in model.effects}:
            is_left_out = set(effects) & set(self.left_out)
            self.not_tried[name] = "left out in a closed loop" if is_left_out else "zero in the first stage"
            return None
        self.on_step(f"fitting {name} by simulation")
        try:
            with self.deadline.portion(self.settings.moves_of_fit) as deadline:
                if not self._settles(model, deadline):
                    self.not_tried[name] = "its simulation reaches no steady state"
                    return None
                fit, stalled = self._in_slices(model, to_beat, deadline)
            return replace(judged(fit, tuple(effects), self.settings), stalled=stalled)
        except OutOfTime:
            self.not_tried[name] = self._why_stopped()
            return None
        except CANNOT_FIT as error:
            self.not_tried[name] = f"it cannot be simulated: {error}"
            return None

    def finished(self, one: Simulated) -> Simulated:
        """Continue a fit that was cut short, with work of its own; the same fit if that gives no better one.

        Parameters
        ----------
        one : Simulated
        """
        self.on_step(f"finishing the fit of {one.name}")
        deadline = self.deadline.bounded(self.settings.moves_of_fit)
        try:
            fit, stalled = self._in_slices(one.model, None, deadline)
            found = replace(judged(fit, one.effects, self.settings), stalled=stalled)
        except (*CANNOT_FIT, OutOfTime):
            return one
        return one if fit.cost > one.fit.cost else found

    def _may_begin(self, name: str) -> bool:
        """Whether there is time and work left for a fit; if not, that is noted."""
        if self.deadline.is_over:
            self.not_tried[name] = "the time was over before its fit by simulation"
            return False
        if self.deadline.moves_left == 0:
            self.not_tried[name] = "the work of all simulations was used up before its fit"
            return False
        return True

    def _why_stopped(self) -> str:
        if self.deadline.is_over:
            return "the time was over before its first simulation had ended"
        return "its simulation takes too long"

    def completed(self, model: PlantModel) -> PlantModel:
        """The model with what every fit contains, and without what none does.

        Parameters
        ----------
        model : PlantModel
        """
        present = {effect.id for effect in model.effects}
        known = [effect for effect in self.known if effect.id not in present]
        stays = [effect for effect in model.effects if effect.id not in self.left_out]
        return replace(model, effects=[*stays, *known])

    def fit_play(
        self,
        null: PlantFit,
        given: PlantModel,
        beaten: float,
        pruned: Callable[[PlantModel], PlantModel] = lambda model: model,
        deadline: Deadline | None = None,
    ) -> Simulated | None:
        """Fit play between motor and load; None if it lowers no cost, or if there was no time.

        Parameters
        ----------
        null : PlantFit
            Without it.
        given : PlantModel
            The model before any fit.
        beaten : float
            Cost to fall below: the least of the other laws, or half of it without a given model.
        pruned : callable
            As `short_list`.
        deadline : Deadline, optional
            Bounds the work of several such fits; by default this one may use `moves_of_play`.
        """
        if self.deadline.is_over:
            self.not_tried[BACKLASH] = "the time was over before its fit by simulation"
            return None
        self.on_step(f"fitting {BACKLASH} by simulation")
        deadline = deadline or self.deadline.bounded(self.settings.moves_of_play)
        is_clear = min(beaten, null.cost) > self.settings.clear_misfit * null.n_dof
        how = {"pruned": pruned, "is_clear": is_clear}
        return self._play(lambda: fit_play(null, given, self.measured, self.band, beaten, deadline, **how))

    def fit_hidden_mode(self, found: Simulated, without: float, deadline: Deadline) -> Simulated | None:
        """Repeat a fit of play with the mode that explains most of what it leaves; None without such a mode.

        Parameters
        ----------
        found : Simulated
            With play.
        without : float
            Cost of the fit without play.
        deadline : Deadline
        """
        model = None if self.deadline.is_over else with_hidden_mode(found.fit, self.settings.search)
        if model is None:
            return None
        self.on_step(f"fitting {BACKLASH} and a mode by simulation")
        beaten = found.fit.cost
        return self._play(lambda: fit_play_from(model, without, self.measured, self.band, beaten, deadline))

    def _play(self, fitted: Callable[[], PlantFit | None]) -> Simulated | None:
        """A fit of play, judged; None if there is none."""
        try:
            fit = fitted()
            return self._judged_play(fit) if fit else None
        except OutOfTime:
            self.not_tried[BACKLASH] = self._why_stopped()
            return None
        except CANNOT_FIT as error:
            self.not_tried[BACKLASH] = f"it cannot be simulated: {error}"
            return None

    def _judged_play(self, fit: PlantFit) -> Simulated:
        """What it explains where it was not fitted; `judged` linearises, and the cost of play has steps."""
        found = judged(fit, (BACKLASH,), self.settings)
        has_slopes = found.converged and found.kept < DOUBTFUL * fit.cost_per_dof
        if len(fit.records) < 2 or has_slopes:
            return found
        try:
            left = left_by_refits(fit, self.band, self.deadline.bounded(self.settings.moves_of_fit))
        except (*CANNOT_FIT, OutOfTime):
            return found
        return replace(found, kept=mean_square(left), left_out=tuple(left))

    def _settles(self, model: PlantModel, deadline: Deadline) -> bool:
        """Whether the simulation of the first record is periodic: a fit of one that is not takes minutes."""
        answer = PeriodicPlant.of(model, self.measured[0], deadline).run_within(deadline)
        return answer.settled or answer.residual < self.settings.unsettled * float(np.std(answer.y))

    def _in_slices(
        self, model: PlantModel, to_beat: float | None, deadline: Deadline
    ) -> tuple[PlantFit, bool]:
        steps, before, fit = 1, np.inf, None
        slices = self.settings.slices if to_beat is None else self.settings.slices_of_rivals
        for _ in range(slices):
            try:
                how = {"band": self.band, "max_iter": steps, "deadline": deadline, "quiet": True}
                fit = fit_plant(model, self.measured, **how)
            except OutOfTime:
                if fit is None:
                    raise
                break
            is_used_up = deadline.is_over or deadline.moves_left == 0
            if has_converged(fit, self.settings) or fit.unsettled or is_used_up:
                break
            if before - fit.cost < max(self.settings.stalled, self.settings.stalled_share * fit.cost):
                return fit, True
            behind = 0.0 if to_beat is None else before - to_beat
            if behind > 0 and before - fit.cost < self.settings.hopeless * behind:
                break
            steps, model, before = self.settings.slice_steps, fit.model, fit.cost
        return fit, False


def has_converged(fit: PlantFit, settings: DecisionSettings) -> bool:
    """Whether a further step is predicted to lower the cost by less than a thousandth, or than noise.

    Parameters
    ----------
    fit : PlantFit
    settings : DecisionSettings
    """
    if fit.converged:
        return True
    jacobian, residual = fit.jacobian, fit.residual
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(size > 0, size, 1.0)
    change = scaled @ np.linalg.lstsq(scaled, residual, rcond=1e-7)[0]
    return float(change @ change) < max(settings.step_share * fit.cost, settings.step_left)


def judged(
    fit: PlantFit,
    effects: tuple[str, ...],
    settings: DecisionSettings,
    factors: Sequence[np.ndarray] | None = None,
) -> Simulated:
    """A fit with what it explains where it was not fitted.

    One realisation after the other is left out and predicted, linearised at the fit to all. Of a single
    record thirds of its periods are left out, or, of few periods and with a model error, which is the same
    in all of them, thirds of its lines.

    Parameters
    ----------
    fit : PlantFit
    effects : tuple of str
    settings : DecisionSettings
    factors : sequence of (2 k,) ndarray, optional
        Of each record's weights, where a model error is in them.
    """
    names, own = fit.model.free_names, {label_of(fit.model, effect) for effect in effects}
    chosen = [i for i, name in enumerate(names) if name.rpartition(".")[0] in own]
    values = np.array([fit.model[names[i]].value for i in chosen])
    size = np.linalg.norm(fit.jacobian, axis=0)
    size = np.where(size > 0, size, 1.0)
    parts = [(j / size, r) for j, r in _parts(fit, settings, factors)]
    left = leave_out(parts, rcond=1e-10)
    alone = np.array([values + (moved / size)[chosen] for moved in left.moves])
    errors = np.array([np.sqrt(np.maximum(one / size**2, 0.0))[chosen] for one in left.variances])
    scatter, noise = _scatter(alone, errors, values)
    weighed = None if factors is None else _linearised_cost(parts)
    return Simulated(effects, fit, has_converged(fit, settings), left.kept, scatter, noise, weighed=weighed)


def mean_square(errors: Sequence[np.ndarray]) -> float:
    """Mean square of the errors of all records.

    Parameters
    ----------
    errors : sequence of (m,) ndarray
    """
    return float(np.mean(np.concatenate(errors) ** 2))


def _linearised_cost(parts: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """Cost at the minimum for these rows: the fit was made with other weights."""
    rows, error = (np.concatenate(each) for each in zip(*parts, strict=True))
    return float(np.sum((error - rows @ np.linalg.lstsq(rows, error, rcond=1e-10)[0]) ** 2))


def _scatter(alone: np.ndarray, errors: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Scatter of the strongest parameter that is not zero over the parts, relative to it, and by noise."""
    alone, errors, values = alone[:, values != 0], errors[:, values != 0], values[values != 0]
    if not len(values):
        return 0.0, 0.0
    spread = np.std(alone, axis=0) / np.abs(values)
    noise = np.sqrt(np.mean(errors**2, axis=0)) / np.abs(values)
    best = int(np.argmin(noise))
    return float(spread[best]), float(noise[best])


def _parts(
    fit: PlantFit, settings: DecisionSettings, factors: Sequence[np.ndarray] | None
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Jacobian and residual of each realisation; of a single record those of its thirds."""
    scales = [1.0] * len(fit.records) if factors is None else [factor[:, None] for factor in factors]
    rows = [
        (one.jacobian * scale, one.residual * np.ravel(scale))
        for one, scale in zip(fit.records, scales, strict=True)
    ]
    if len(rows) > 1:
        return rows
    (one,), ((jacobian, residual),) = fit.records, rows
    if factors is not None or one.spectra.n_periods < settings.periods_least:
        third_of = np.tile(np.arange(len(one.line)) % 3, 2)
        return [(jacobian[third_of == i], residual[third_of == i]) for i in range(3)]
    thirds = np.array_split(one.spectra.Y, min(3, one.spectra.n_periods))
    return [_part(one, third) for third in thirds]


def _part(one: RecordFit, periods: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    weight = np.sqrt(len(periods) / one.spectra.n_periods)  # of noise that is larger
    change = one.whitened(periods.mean(axis=0) - one.spectra.y)
    return weight * one.jacobian, weight * (one.residual + change)
