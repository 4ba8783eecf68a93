"""Add an effect to a plant and watch the error fall: the ladder of models, judged on data not fitted.

A rung is fitted on some realisations and judged on others (or, with less than three records, fitted on the
first half of the periods and judged on the second). `Rung.judged_on` states how new these data are: only
records that the caller keeps out, and that no earlier step has used, are called kept out. The model keeps its
ladder in its history, so that a step can be taken back, and with each step the digests of the records used.
"""

from __future__ import annotations

import contextlib
import copy
import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gsid.base.errors import GsidError, InputError, close
from gsid.base.hold import other_reading
from gsid.comparison import Comparison, compare
from gsid.diagnosis.error_fall import fall_p_value
from gsid.diagnosis.ladder import JUDGED_ON, Rung, ladder, undo_state, used_records
from gsid.diagnosis.probes import Probe
from gsid.diagnosis.scan import SAMPLER, scan, scan_rates, with_probe
from gsid.effects.types import EffectType, find
from gsid.greybox.fit import PlantFit, as_assumed, fit_plant, require_motion
from gsid.greybox.linear_start import linear_start
from gsid.greybox.weights import same_level
from gsid.models.hold import facts_of
from gsid.plant.effect import Param
from gsid.plant.model import PlantModel, check_plant
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra, read_as, require_not_fitted

if TYPE_CHECKING:
    import matplotlib.figure

    from gsid.diagnosis.ladder import Ladder

_log = logging.getLogger(__name__)

STARTS = 3  # points of an effect's grid that are fitted
STEPS_TRIED = 15  # of each of these fits: a start that needs more is not near
WORTH = 10.0  # drop of the cost (-2 log likelihood) from which on an unfinished fit is worth more steps
SIZES = (0.03, 0.1, 0.3, 1.0, 3.0)  # times the typical size, for effects that have no grid
HELD_OUT_SHARE = 3  # one realisation in three
PERIODS_LEAST = 2  # for a variance, on either side

OUTSIDE_SEEN = {"w": "rate", "theta": "angle"}  # variables of tables, in a prediction
OUTSIDE_NOTED = 1e-3  # share of the time beyond a table's ends that is worth a note

Records = Record | Spectra | Sequence[Record | Spectra]


@dataclass(eq=False, repr=False)
class Addition:
    """What :func:`add` did.

    Attributes
    ----------
    model : PlantModel
        With the effect, fitted; its history has the step.
    rung : Rung
    fit : PlantFit
    """

    model: PlantModel
    rung: Rung
    fit: PlantFit

    @property
    def ladder(self) -> Ladder:
        """This step and those before it."""
        return ladder(self.model)

    def plot(self) -> matplotlib.figure.Figure:
        """The ladder up to this step."""
        return self.ladder.plot()

    @property
    def undetermined(self) -> list[str]:
        """Parameters that the data do not tell."""
        return self.fit.undetermined

    def to_dict(self) -> dict[str, Any]:
        """The numbers of `gsid add --json`."""
        own = {"converged": self.fit.converged, "undetermined": self.undetermined}
        own |= facts_of(self.model)
        return self.rung.to_dict() | own | {"ladder": [rung.to_dict() for rung in self.ladder.rungs]}

    def __repr__(self) -> str:
        return f"{self.rung.sentence}\n{self.ladder!r}"


def add(
    effect: str | EffectType,
    model: PlantModel,
    records: Records,
    *,
    params: Mapping[str, float] | None = None,
    held_out: Records | None = None,
    band: tuple[float, float] | None = None,
    on_step: Callable[[str], None] = lambda text: None,
) -> Addition:
    """Add an effect, fit again, and judge on data that the fit has not seen.

    Parameters
    ----------
    effect : str or EffectType
        Id of the catalogue, or an effect of your own: `gsid.effects.expression`, `table` or `load`.
    model : PlantModel
        Its free parameters are fitted with and without the effect.
    records : Record or Spectra, or a sequence of them
        Realisations. Where they do not state their hold, all steps take the assumption that is
        the likelier for the model as it was given.
    params : dict of float, optional
        Where the fit starts; those not given are typical ones. Default: the best of several sizes and
        shapes, found along the model's own path; for an effect of your own, its typical values.
    held_out : Record or Spectra, or a sequence of them, optional
        Judged on, never fitted: realisations that have not helped to choose the effect either. Default: the
        last third of the realisations of each level; with less than three records, or one of each level, the
        second half of the periods of each.
    band : (lo, hi), optional
        Hz; default as in `gsid.fit_plant`.
    on_step : callable
        Told in words what comes next.

    Returns
    -------
    Addition

    Raises
    ------
    ValueError
        As `gsid.fit_plant`.
    InputError
        No such effect or parameter, a value out of its bounds, or an effect that no plant is without; too
        few periods to keep any out; the effect can be fitted from no start; as `gsid.fit_plant`.
    """
    check_plant(model)
    known = effect if isinstance(effect, EffectType) else find(effect)
    if known.null_kind == "never":
        hint = "write it into the model file, with its values"
        raise InputError("this effect is what a plant starts with, not one to add", known.id, None, hint)
    for name, value in (params or {}).items():
        _check(known, name, value)
    kept = None if held_out is None else spectra_of(held_out)
    split = _split(spectra_of(records), kept, used_records(model))
    fitted = silent = split.fitted
    on_step("fitting the model as it is")
    start = model if model.fit is not None else linear_start(model, fitted)
    before = fit_plant(start, fitted, band=band)
    require_motion(before)
    if before.hold_assumed:
        split = split._replace(fitted=read_as(fitted, before.hold), kept=read_as(split.kept, before.hold))
        fitted = split.fitted
    after = _best_fit(before, known, _starts(before, known, fitted, params), fitted, band, on_step)
    _note_places_outside(after)
    on_step(f"judging on {split.words}")
    rung = _rung(-1, before, after, split, band)
    step = _step(known.id, rung, undo_state(model), fitted)
    if before.hold_assumed:
        other = read_as(silent, other_reading(before.hold))
        as_assumed(after, _fit_or_none(after.model, other, band))
    after.model.history = [*copy.deepcopy(model.history), step]
    return Addition(after.model, rung, after)


def _fit_or_none(
    model: PlantModel, measured: list[Spectra], band: tuple[float, float] | None
) -> PlantFit | None:
    try:
        return fit_plant(model, measured, band=band)
    except (GsidError, InputError):
        return None


def _check(known: EffectType, name: str, value: float) -> None:
    if name not in known.names:
        hint = close(name, known.names) or f"it has {', '.join(known.names)}"
        raise InputError("unknown parameter", f"{known.id}.{name}", None, hint)
    lower, upper = known[name].lower, known[name].upper
    if not lower <= value <= upper:
        hint = f"it lies in {lower:g} .. {upper:g} {known[name].unit}".rstrip()
        raise InputError("a value is out of its bounds", f"{known.id}.{name}", f"{value:g}", hint)


def with_history(
    given: PlantModel,
    found: PlantModel,
    records: Records,
    *,
    order: Sequence[str] = (),
    band: tuple[float, float] | None = None,
) -> PlantModel:
    """Give a model that a diagnosis found the ladder of its steps, each judged on data that were not fitted.

    The diagnosis has chosen the effects by all records, so that those which judge are not new:
    `Rung.judged_on` is "search_records".

    Parameters
    ----------
    given : PlantModel
        Where the diagnosis started.
    found : PlantModel
        The same with more effects at its end, fitted to all records. Its values stay as they are.
    records : Record or Spectra, or a sequence of them
    order : sequence of str, optional
        Ids of the effects found in the order of the steps; default: as they stand in the model.
    band : (lo, hi), optional
        Hz; default as in `gsid.fit_plant`.

    Returns
    -------
    PlantModel

    Raises
    ------
    ValueError
        An effect found is not in `order`; as :func:`add`.
    InputError
        As :func:`add`.
    """
    searched = spectra_of(records)
    split = _split_of_search(searched)
    fitted = split.fitted
    steps = list(range(len(given.effects), len(found.effects)))  # places in the stack: there they stay
    if order:
        missing = [found.effects[place].id for place in steps if found.effects[place].id not in order]
        if missing:
            raise ValueError(f"order has {', '.join(order)}, but not {missing[0]}, which was found")
        steps.sort(key=lambda place: order.index(found.effects[place].id))
    # What diagnose began with: the values found are bent by the effects that are not in it yet.
    told, before = copy.deepcopy(found), fit_plant(linear_start(given, fitted), fitted, band=band)
    told.history, previous = copy.deepcopy(given.history), undo_state(given)
    for i, place in enumerate(steps):
        after = _fit_of_part(found, set(steps[i + 1 :]), fitted, band)
        at = place - sum(later < place for later in steps[i + 1 :])
        rung = _rung(at, before, after, split, band)
        told.history.append(_step(found.effects[place].id, rung, previous, searched))
        previous, before = undo_state(after.model), after
    return told


def _fit_of_part(
    found: PlantModel, without: set[int], fitted: list[Spectra], band: tuple[float, float] | None
) -> PlantFit:
    """The model fitted without the effects at some places.

    These have bent the values found: a refresh has taken half its period from the delay. Where the linear
    part fits the measured response, the fit may end in a lower minimum, and the lower one counts.
    """
    part = copy.deepcopy(found)
    part.effects = [effect for place, effect in enumerate(part.effects) if place not in without]
    part.cov, part.fit = None, None
    fits = [fit_plant(part, fitted, band=band)]
    moved = linear_start(part, fitted) if without else part
    if moved is not part:
        with contextlib.suppress(GsidError, InputError):  # a start that cannot be simulated is none
            fits.append(fit_plant(moved, fitted, band=band))
    return min(fits, key=lambda fit: fit.cost)


def _step(effect: str, rung: Rung, previous: dict[str, Any], used: list[Spectra]) -> dict[str, Any]:
    """An entry of the history; `used` are the records that were fitted, or searched for the effect."""
    digests = [one.digest for one in used if one.digest]
    return {"add": effect, "rung": rung.to_dict(), "previous": previous, "used_records": digests}


# ---- data to fit and data to judge on ----------------------------------------------------------------------


class _Split(NamedTuple):
    """Data to fit, data to judge on, the latter in words, and which of `JUDGED_ON` they are."""

    fitted: list[Spectra]
    kept: list[Spectra]
    words: str
    judged_on: str


def _split(
    measured: list[Spectra], held_out: list[Spectra] | None = None, used: Collection[str] = ()
) -> _Split:
    """What is fitted, and what judges; `used` are digests of the records of earlier steps."""
    if held_out is not None:
        require_not_fitted(measured, held_out)
        return _split_of_records(measured, held_out, "kept_out", used)
    chosen = _last_third(measured) if len(measured) >= HELD_OUT_SHARE else []
    if chosen:
        kept = [measured[i] for i in chosen]
        _log.info("left out of the fit, to judge on: %s", ", ".join(s.name or "a record" for s in kept))
        fitted = [s for i, s in enumerate(measured) if i not in chosen]
        return _split_of_records(fitted, kept, "not_fitted", used)
    _log.info("fitted to the first half of the periods, judged on the second")
    halves = [_halves(s) for s in measured]
    words = f"the later periods of the same realisation{'s' * (len(measured) > 1)}"
    return _Split([first for first, _ in halves], [second for _, second in halves], words, "later_periods")


def _split_of_search(measured: list[Spectra]) -> _Split:
    """The same of records that a search has used, all of them."""
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
        _log.info("used in an earlier step of the model, so not kept out: %s", ", ".join(before))
    kind = JUDGED_ON[judged_on]
    if len(kept) > 1:
        words = f"{len(kept)} records {kind}"
    elif before:
        words = f"{before[0]} ({kind})"
    else:
        words = kept[0].name or f"the record {kind}"
    return _Split(fitted, kept, words, judged_on)


def _last_third(measured: list[Spectra]) -> set[int]:
    """Indices of the last third, at least one, of the records of each level that has more than one."""
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
        hint = "name records to judge on with --held-out, or measure more periods or realisations"
        raise InputError(
            "too few periods to keep half of them out", one.name, f"{one.n_periods} of at least 4", hint
        )
    first, second = (replace(one, U=one.U[r], Y=one.Y[r]) for r in (slice(None, half), slice(half, None)))
    return first, second


# ---- the fit -----------------------------------------------------------------------------------------------


def _title(model: PlantModel, at: int) -> str:
    """An effect's label by its place; with the law, where the label does not say it."""
    label, effect = model.labels()[at]
    law = effect.type.definition.get("torque")
    return f"{label} {law}" if isinstance(law, str) else label


def _starts(
    fit: PlantFit, effect: EffectType, measured: list[Spectra], params: Mapping[str, float] | None
) -> list[PlantModel]:
    """The model with the effect at the points to fit from: the likeliest of its grid, or typical ones."""
    if effect.definition:
        return [fit.model.with_effect(effect, dict(params or {}))]
    tries = _likeliest(fit, effect.id, measured)
    fixed = tries[0][0].fixed if tries else ()
    if params is not None:
        return [fit.model.with_effect(effect, dict(params), fixed=fixed)]
    if tries:
        return [with_probe(fit.model, probe, size) for probe, size in tries]
    strengths = {p.name: p.typical for p in effect.parameters if p.null_value is not None}
    sizes = [
        fit.model.with_effect(effect, {name: size * value for name, value in strengths.items()})
        for size in SIZES
    ]
    return [min(sizes, key=lambda model: _cost(model, fit, measured))]


def _note_places_outside(fit: PlantFit) -> None:
    """A table's line beyond its ends is no measurement: say when the motion spends time there."""
    table = fit.model.effects[-1].type.definition
    if table.get("variable") not in OUTSIDE_SEEN:
        return
    path = np.concatenate([getattr(r.prediction, OUTSIDE_SEEN[table["variable"]]) for r in fit.records])
    at = np.array(table["at"])
    margins = np.diff(at)[[0, -1]] * [-1, 1]  # the bins of a curve reach beyond their middles
    low, high = at[[0, -1]] + margins
    share = float(np.mean((path < low) | (path > high)))
    if share > OUTSIDE_NOTED:
        _log.warning("%.1f %% of the time the motion is outside the table: there it is a line", 100 * share)


def _cost(model: PlantModel, fit: PlantFit, measured: list[Spectra]) -> float:
    """Of a model that is not fitted, with the weights of a fit; infinite when it cannot be simulated."""
    try:
        return sum(
            float(np.sum(np.abs(r.weight * (one.y - model.predict(one).Y)[r.line]) ** 2))
            for r, one in zip(fit.records, measured, strict=True)
        )
    except GsidError:
        return np.inf


def _likeliest(fit: PlantFit, effect: str, measured: list[Spectra]) -> list[tuple[Probe, np.ndarray]]:
    """Points of the effect's grid with the largest predicted drops of the cost, and their coefficients."""
    scored = scan_rates(fit, measured)[0] if effect == SAMPLER else scan(fit, measured, [effect])
    scored.sort(key=lambda pair: -pair[1].drop)
    return [(probe, item.size) for probe, item in scored[:STARTS]]


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
            tried = fit_plant(start, measured, band=band, max_iter=STEPS_TRIED)
        except (GsidError, InputError) as error:
            failure = error
            continue
        if best is None or tried.cost < best.cost:
            best = tried
    if best is None:
        hint = getattr(failure, "hint", "") or "give values to start from with --param"
        raise InputError(f"{effect.id} can be fitted from no start", measured[0].name, str(failure), hint)
    promising = before.cost - best.cost > WORTH
    return fit_plant(best.model, measured, band=band) if promising and not best.converged else best


def _rung(
    at: int,
    before: PlantFit,
    after: PlantFit,
    split: _Split,
    band: tuple[float, float] | None,
) -> Rung:
    """The step that brought the effect at this place of the stack."""

    def level(fit: PlantFit) -> dict[str, float]:
        seen = compare(fit.model, split.fitted, band=band)
        return {"cost_per_dof": fit.cost_per_dof} | _sizes(seen)

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


def _sizes(seen: Comparison) -> dict[str, float]:
    return {"rms_error": seen.rms_error, "noise_floor_rms": seen.noise_floor_rms}


def _plain(param: Param) -> dict[str, float | None]:
    known = param.std is not None and np.isfinite(param.std)
    return {"value": param.value, "std": param.std if known else None}
