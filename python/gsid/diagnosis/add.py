"""Add an effect to a plant model and validate the result on data that were not fitted.

Each added effect is one rung of a ladder. A rung is fitted to some realisations and validated on others. With
less than three records it is fitted to the first half of the periods and validated on the second half.
`Rung.judged_on` states how independent the validation data are. Only records that the caller keeps out, and
that no earlier step has used, are called kept out. The history of the model contains the ladder, so that a
step can be removed. It also contains the digests of the records used in each step.
"""

from __future__ import annotations

import contextlib
import copy
import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gsid.base.deadline import Deadline
from gsid.base.errors import GsidError, InputError, close
from gsid.base.hold import likelier, other_reading
from gsid.base.tables import paragraphs
from gsid.comparison import Comparison, compare
from gsid.diagnosis.closed_loop import in_closed_loop
from gsid.diagnosis.effect_starts import effect_starts, fixed_parameters
from gsid.diagnosis.error_fall import fall_p_value
from gsid.diagnosis.from_records.play import fit_play_from
from gsid.diagnosis.ladder import JUDGED_ON, Rung, ladder, undo_state, used_records
from gsid.effects.types import EffectType, find
from gsid.greybox.better_start import fit_from_better_start
from gsid.greybox.fit import (
    CANNOT_FIT,
    PlantFit,
    as_assumed,
    fit_plant,
    require_motion,
    unsettled_text,
)
from gsid.greybox.linear_start import linear_start
from gsid.greybox.weights import same_level
from gsid.models.hold import facts_of
from gsid.plant.effect import Param
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel, check_plant
from gsid.records.record import Record
from gsid.spectrum.held_out import check_held_out
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra, read_as

if TYPE_CHECKING:
    import matplotlib.figure

    from gsid.diagnosis.ladder import Ladder

_log = logging.getLogger(__name__)

STEPS_TRIED = 15  # iterations of a fit from each start: a start that needs more is too far from the minimum
WORTH = 10.0  # drop of the cost (-2 log likelihood) above which an unfinished fit is continued
HELD_OUT_SHARE = 3  # one realisation in three
PERIODS_LEAST = 2  # least number of periods on either side, needed for a variance

OUTSIDE_SEEN = {"w": "rate", "theta": "angle"}  # variables of tables, in a prediction
OUTSIDE_NOTED = 1e-3  # share of the time beyond the ends of a table above which a warning is logged

Records = Record | Spectra | Sequence[Record | Spectra]


@dataclass(eq=False, repr=False)
class Addition:
    """Result of :func:`add`.

    Attributes
    ----------
    model : PlantModel
        The fitted model with the effect; its history contains the step.
    rung : Rung
    fit : PlantFit
    """

    model: PlantModel
    rung: Rung
    fit: PlantFit

    @property
    def ladder(self) -> Ladder:
        """The ladder with this step and all earlier ones."""
        return ladder(self.model)

    def plot(self) -> matplotlib.figure.Figure:
        """Plot the ladder up to this step."""
        return self.ladder.plot()

    @property
    def undetermined(self) -> list[str]:
        """Parameters that the data do not determine."""
        return self.fit.undetermined

    def to_dict(self) -> dict[str, Any]:
        """The numbers of `gsid add --json`."""
        own = {
            "sentence": self.rung.sentence,
            "converged": self.fit.converged,
            "undetermined": self.undetermined,
        }
        own |= facts_of(self.model)
        return self.rung.to_dict() | own | {"ladder": [rung.to_dict() for rung in self.ladder.rungs]}

    def __repr__(self) -> str:
        return f"{self.rung.sentence}\n{self.ladder!r}"

    def _repr_html_(self) -> str:
        return paragraphs(self.rung.sentence) + self.ladder._repr_html_()


def add(
    effect: str | EffectType,
    model: PlantModel,
    records: Records,
    *,
    params: Mapping[str, float] | None = None,
    held_out: Records | None = None,
    reference: str | None = None,
    band: tuple[float, float] | None = None,
    on_step: Callable[[str], None] = lambda text: None,
) -> Addition:
    """Add an effect, fit the model again, and validate it on data that were not fitted.

    Parameters
    ----------
    effect : str or EffectType
        Name of an effect of the catalogue, or a custom effect: `gsid.effects.expression`, `table` or `load`.
    model : PlantModel
        Its free parameters are fitted with and without the effect.
    records : Record or Spectra, or a sequence of them
        Realisations. If they do not state their hold, both models are fitted under the assumption that is
        likelier with the effect.
    params : dict of float, optional
        Starting values; parameters not given start at typical values. Default: those of the first stage of
        the diagnosis, along the measured motion. A custom effect starts at its typical values.
    held_out : Record or Spectra, or a sequence of them, optional
        Validation data. They are not fitted and should not have been used to choose the effect. Default: the
        last third of the realisations of each level. With less than three records, or one of each level, the
        default is the second half of the periods of each.
    reference : str, optional
        Of records measured in a closed loop: the column of its reference. The model gets the controller that
        the records show, if it has none, and is simulated with the reference as its input.
    band : (lo, hi), optional
        Hz; default as in `gsid.fit_plant`.
    on_step : callable
        Called with a short description of each step before it starts.

    Returns
    -------
    Addition

    Raises
    ------
    ValueError
        As `gsid.fit_plant`.
    InputError
        The effect or a parameter is unknown; a value is out of its bounds; every plant already has the
        effect; there are too few periods to keep any out; the fit fails from every start; as
        `gsid.fit_plant`.
    """
    check_plant(model)
    known = effect if isinstance(effect, EffectType) else find(effect)
    if known.null_kind == "never":
        hint = "write it into the model file, with its values"
        raise InputError("every plant starts with this effect, so it cannot be added", known.id, None, hint)
    for name, value in (params or {}).items():
        _check(known, name, value)
    if reference is not None:
        model, records = in_closed_loop(model, records, reference)
        if held_out is not None:
            _, held_out = in_closed_loop(model, held_out, reference)
    kept = None if held_out is None else spectra_of(held_out)
    split = _split(spectra_of(records), kept, used_records(model))
    on_step("fitting the given model")
    first = fit_plant if model.fit is not None else fit_from_better_start
    before = first(model, split.fitted, band=band)
    require_motion(before)
    data = _read(split, before.hold) if before.hold_assumed else split
    starts = _starts(before, known, params, band, model)
    after = _best_fit(before, known, starts, data.fitted, band, on_step)
    if before.hold_assumed:
        on_step("fitting with the other hold")
        before, after, data = _with_likelier_hold(before, after, split, band)
    _note_places_outside(after)
    on_step(f"judging on {data.words}")
    rung = _rung(-1, before, after, data, band)
    step = _step(known.id, rung, undo_state(model), data.fitted)
    after.model.history = [*copy.deepcopy(model.history), step]
    return Addition(after.model, rung, after)


def _read(split: _Split, hold: str) -> _Split:
    return split._replace(fitted=read_as(split.fitted, hold), kept=read_as(split.kept, hold))


def _with_likelier_hold(
    before: PlantFit, after: PlantFit, split: _Split, band: tuple[float, float] | None
) -> tuple[PlantFit, PlantFit, _Split]:
    """The fits without and with the effect under the assumption that is likelier with it, and the data.

    Without the effect its misfit decides, which is many times that of a wrong hold.
    """
    taken, other = before.hold, other_reading(before.hold)
    again = [_fit_or_none(one.model, read_as(split.fitted, other), band) for one in (before, after)]
    without, whole = again
    if without is None or whole is None or likelier({taken: after.cost, other: whole.cost}) == taken:
        return before, as_assumed(after, whole), _read(split, taken)
    return without, as_assumed(whole, after), _read(split, other)


def _fit_or_none(
    model: PlantModel, measured: list[Spectra], band: tuple[float, float] | None
) -> PlantFit | None:
    try:
        return fit_plant(model, measured, band=band)
    except CANNOT_FIT:
        return None


def _check(known: EffectType, name: str, value: float) -> None:
    if name not in known.names:
        hint = close(name, known.names) or f"it has {', '.join(known.names)}"
        raise InputError("unknown parameter", f"{known.id}.{name}", None, hint)
    lower, upper = known[name].lower, known[name].upper
    if not lower <= value <= upper:
        hint = f"the range is {lower:g} .. {upper:g} {known[name].unit}".rstrip()
        raise InputError("a value is out of its bounds", f"{known.id}.{name}", f"{value:g}", hint)


def with_history(
    given: PlantModel,
    found: PlantModel,
    records: Records,
    *,
    order: Sequence[str] = (),
    band: tuple[float, float] | None = None,
) -> PlantModel:
    """Add the ladder of its steps to a model found by a diagnosis.

    Each step is fitted to some of the data and validated on the rest. The diagnosis used all records to
    choose the effects, so that the validation data are not independent: `Rung.judged_on` is
    "search_records".

    Parameters
    ----------
    given : PlantModel
        The model with which the diagnosis started.
    found : PlantModel
        The same model with further effects, anywhere in the stack, fitted to all records. Its values are not
        changed.
    records : Record or Spectra, or a sequence of them
    order : sequence of str, optional
        Names of the effects found, in the order of the steps. Others, such as a constant torque fitted beside
        a law, follow in their order in the model.
    band : (lo, hi), optional
        Hz; default as in `gsid.fit_plant`.

    Returns
    -------
    PlantModel

    Raises
    ------
    ValueError
        As for :func:`add`.
    InputError
        As for :func:`add`.
    """
    searched = spectra_of(records)
    split = _split_of_search(searched)
    fitted = split.fitted
    known = {label for label, _ in given.labels()}
    steps = [i for i, (label, _) in enumerate(found.labels()) if label not in known]  # indices in the stack
    rank = {effect: i for i, effect in reversed(list(enumerate(order)))}
    steps.sort(key=lambda place: rank.get(found.effects[place].id, len(order)))
    # Start like `diagnose`: the values found are biased for a model without the effects added later.
    model, before = copy.deepcopy(found), fit_from_better_start(given, fitted, band=band)
    model.history, previous = copy.deepcopy(given.history), undo_state(given)
    for i, place in enumerate(steps):
        after = _fit_of_part(found, set(steps[i + 1 :]), fitted, band)
        at = place - sum(later < place for later in steps[i + 1 :])
        rung = _rung(at, before, after, split, band)
        model.history.append(_step(found.effects[place].id, rung, previous, searched))
        previous, before = undo_state(after.model), after
    return model


def _fit_of_part(
    found: PlantModel, without: set[int], fitted: list[Spectra], band: tuple[float, float] | None
) -> PlantFit:
    """Fit the model without the effects at some indices of the stack.

    The values found are biased for this model: a sample and hold, for instance, has taken half its period
    from the delay. A second fit therefore starts with a linear part fitted to the measured response, and the
    fit with the lower cost is returned.
    """
    part = copy.deepcopy(found)
    part.effects = [effect for place, effect in enumerate(part.effects) if place not in without]
    part.cov, part.cov_names, part.fit = None, None, None
    fits = [fit_plant(part, fitted, band=band)]
    moved = linear_start(part, fitted) if without else part
    if moved is not part:
        with contextlib.suppress(GsidError, InputError):  # a start that cannot be simulated is skipped
            fits.append(fit_plant(moved, fitted, band=band))
    return min(fits, key=lambda fit: fit.cost)


def _step(effect: str, rung: Rung, previous: dict[str, Any], used: list[Spectra]) -> dict[str, Any]:
    """An entry of the history; `used` are the records of the fit, or of the search for the effect."""
    digests = [one.digest for one in used if one.digest]
    return {"add": effect, "rung": rung.to_dict(), "previous": previous, "used_records": digests}


# ---- data to fit and data for validation -------------------------------------------------------------------


class _Split(NamedTuple):
    """Data to fit; validation data, their description, and their kind in `JUDGED_ON`."""

    fitted: list[Spectra]
    kept: list[Spectra]
    words: str
    judged_on: str


def _split(
    measured: list[Spectra], held_out: list[Spectra] | None = None, used: Collection[str] = ()
) -> _Split:
    """Split into data to fit and validation data; `used` are digests of the records of earlier steps."""
    if held_out is not None:
        check_held_out(measured, held_out)
        return _split_of_records(measured, held_out, "kept_out", used)
    chosen = _last_third(measured) if len(measured) >= HELD_OUT_SHARE else []
    if chosen:
        kept = [measured[i] for i in chosen]
        _log.info("not fitted, used for validation: %s", ", ".join(s.name or "a record" for s in kept))
        fitted = [s for i, s in enumerate(measured) if i not in chosen]
        return _split_of_records(fitted, kept, "not_fitted", used)
    _log.info("fitted to the first half of the periods, validated on the second half")
    halves = [_halves(s) for s in measured]
    words = f"the later periods of the same realisation{'s' * (len(measured) > 1)}"
    return _Split([first for first, _ in halves], [second for _, second in halves], words, "later_periods")


def _split_of_search(measured: list[Spectra]) -> _Split:
    """Split records that were all used by a search."""
    split = _split(measured)
    if split.judged_on == "later_periods":
        words = "later periods (used in the search)"
    elif len(split.kept) == 1:
        words = f"{split.kept[0].name or 'a record'} (used in the search)"
    else:
        words = f"{len(split.kept)} records used in the search"
    return split._replace(words=words, judged_on="search_records")


def _split_of_records(
    fitted: list[Spectra], kept: list[Spectra], judged_on: str, used: Collection[str]
) -> _Split:
    before = [one.name or "a record" for one in kept if one.digest in used]
    if before:
        judged_on = "used_before"
        _log.info("an earlier step of the model used these records: %s", ", ".join(before))
    kind = JUDGED_ON[judged_on]
    if len(kept) > 1:
        words = f"{len(kept)} records {kind}"
    elif before:
        words = f"{before[0]} ({kind})"
    else:
        words = kept[0].name or f"the record {kind}"
    return _Split(fitted, kept, words, judged_on)


def _last_third(measured: list[Spectra]) -> set[int]:
    """Indices of the last third, at least one, of the records of each level with more than one record."""
    levels: list[list[int]] = []
    for i, one in enumerate(measured):
        for level in levels:
            if same_level(one, measured[level[0]]):
                level.append(i)
                break
        else:
            levels.append([i])
    return {
        i for level in levels if len(level) > 1 for i in level[-max(1, round(len(level) / HELD_OUT_SHARE)) :]
    }


def _halves(one: Spectra) -> tuple[Spectra, Spectra]:
    half = one.n_periods // 2
    if half < PERIODS_LEAST:
        hint = "give validation records with --held-out, or measure more periods or realisations"
        raise InputError(
            "too few periods to keep half of them out", one.name, f"{one.n_periods} of at least 4", hint
        )
    first, second = (replace(one, U=one.U[r], Y=one.Y[r]) for r in (slice(None, half), slice(half, None)))
    return first, second


# ---- the fit -----------------------------------------------------------------------------------------------


def _title(model: PlantModel, at: int) -> str:
    """Label of the effect at an index of the stack, with its law if the label does not contain it."""
    label, effect = model.labels()[at]
    law = effect.type.definition.get("torque")
    return f"{label} {law}" if isinstance(law, str) else label


def _starts(
    fit: PlantFit,
    effect: EffectType,
    params: Mapping[str, float] | None,
    band: tuple[float, float] | None,
    given: PlantModel,
) -> list[PlantModel]:
    """The model with the effect at each starting point: given, found from the data, or typical values."""
    if effect.definition:
        return [fit.model.with_effect(effect, dict(params or {}))]
    if params is not None:
        return [fit.model.with_effect(effect, dict(params), fixed=fixed_parameters(effect))]
    return effect_starts(fit, effect, band, given=given)


def _note_places_outside(fit: PlantFit) -> None:
    """Warn if the motion leaves the range of a table, beyond which its law is extrapolated."""
    table = fit.model.effects[-1].type.definition
    if table.get("variable") not in OUTSIDE_SEEN:
        return
    path = np.concatenate([getattr(r.prediction, OUTSIDE_SEEN[table["variable"]]) for r in fit.records])
    at = np.array(table["at"])
    margins = np.diff(at)[[0, -1]] * [-1, 1]  # the bins of a curve extend beyond their centres
    low, high = at[[0, -1]] + margins
    share = float(np.mean((path < low) | (path > high)))
    if share > OUTSIDE_NOTED:
        _log.warning(
            "%.1f %% of the time the motion is outside the table, which is extrapolated there", 100 * share
        )


def _best_fit(
    before: PlantFit,
    effect: EffectType,
    starts: list[PlantModel],
    measured: list[Spectra],
    band: tuple[float, float] | None,
    on_step: Callable[[str], None],
) -> PlantFit:
    best: PlantFit | None = None
    failure: Exception | None = None
    for i, start in enumerate(starts, 1):
        on_step(f"fitting {effect.id}, start {i} of {len(starts)}")
        try:
            fitted = _fitted(before, effect, start, measured, band)
        except CANNOT_FIT as error:
            failure = error
            continue
        if best is None or fitted.cost < best.cost:
            best = fitted
    if best is None:
        hint = getattr(failure, "hint", "") or "give starting values with --param"
        raise InputError(
            f"the fit of {effect.id} fails from every start", measured[0].name, str(failure), hint
        )
    if before.cost - best.cost > WORTH and not best.converged:
        return fit_plant(best.model, measured, band=band)
    if effect.id == BACKLASH and best.unsettled:  # its fits are quiet
        _log.warning(unsettled_text(best))
    return best


def _fitted(
    before: PlantFit,
    effect: EffectType,
    start: PlantModel,
    measured: list[Spectra],
    band: tuple[float, float] | None,
) -> PlantFit:
    """The first fit from a start; that of play goes on beyond the steps of its cost."""
    if effect.id == BACKLASH:
        return fit_play_from(start, before.cost, measured, band, before.cost, Deadline(), STEPS_TRIED)
    return fit_plant(start, measured, band=band, max_iter=STEPS_TRIED)


def _rung(
    at: int,
    before: PlantFit,
    after: PlantFit,
    split: _Split,
    band: tuple[float, float] | None,
) -> Rung:
    """The step that added the effect at this index of the stack."""

    def level(fit: PlantFit) -> dict[str, float]:
        comparison = compare(fit.model, split.fitted, band=band)
        return {"cost_per_dof": fit.cost_per_dof} | _sizes(comparison)

    without, with_it = (compare(fit.model, split.kept, band=band) for fit in (before, after))
    return Rung(
        effect=_title(after.model, at),
        params={name: _plain(p) for name, p in after.model.effects[at].params.items()},
        before=level(before),
        after=level(after),
        held_out={"before": without.rms_error, "after": with_it.rms_error},
        noise_floor_rms=with_it.noise_floor_rms,
        kept_out=split.words,
        y_unit=split.kept[0].y_unit,
        data={
            "fitted": [one.name for one in split.fitted],
            "kept_out": [one.name for one in split.kept],
            "band_hz": list(after.band_hz),
        },
        judged_on=split.judged_on,
        fall_p_value=fall_p_value(before.model, after.model, split.kept, band=band),
    )


def _sizes(comparison: Comparison) -> dict[str, float]:
    return {"rms_error": comparison.rms_error, "noise_floor_rms": comparison.noise_floor_rms}


def _plain(param: Param) -> dict[str, float | None]:
    known = param.std is not None and np.isfinite(param.std)
    return {"value": param.value, "std": param.std if known else None}
