"""Several effects that a given model lacks: rounds of one effect each, and a review of what was found.

Each round runs the first stage and the fits by simulation beside the effects found so far. Of two missing
effects the larger one alone is not confirmed: the best law of a round is taken for the time being if it
explains much. At the end each effect is judged again beside all others. One that is no longer significant is
dropped. One that is not confirmed is the nearest beside those that are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gsid.base.deadline import OutOfTime
from gsid.base.errors import InputError
from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.draw_up import draw_up
from gsid.diagnosis.from_records.fit_laws import confirm, fit_play
from gsid.diagnosis.from_records.law_part import without
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.seek_play import seek_play_from_data
from gsid.diagnosis.from_records.verdict import ADEQUATE, MISSING, NEAREST, UNKNOWN
from gsid.diagnosis.missing_torque.catalogue import family
from gsid.effects.types import find
from gsid.greybox.fit import CANNOT_FIT
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel


@dataclass(frozen=True, eq=False)
class Review:
    """Effects that were judged again, each beside all others.

    Attributes
    ----------
    kept : list of Run
        Of the effects that are confirmed.
    near : list of Run
        Of the others: each is the nearest beside the rest.
    final : Simulated
        The fit with all of them.
    """

    kept: list[Run]
    near: list[Run]
    final: Simulated


class Rounds:
    """The rounds of a diagnosis with a given model.

    Attributes
    ----------
    first : Run
        The given model alone.
    kept : list of Run
        One for each effect found, in their order; each was judged beside all others.
    near : list of Run
        One for each effect that is missing beside them, but is only the nearest.
    joint : Simulated or None
        The fit with the nearest effects as well; None if there are none.
    has_series : bool
        Whether effects are only the nearest because several together stand for a linear effect.
    """

    def __init__(self, first: Run) -> None:
        self.first, self.settings = first, first.settings
        self.kept: list[Run] = [first] if first.decision.verdict == MISSING else []
        self.near: list[Run] = []
        self.joint: Simulated | None = None
        self.has_series = False

    @property
    def final(self) -> Simulated | None:
        """The fit with all effects found."""
        return self.kept[-1].final if self.kept else None

    @property
    def effects(self) -> list[Run]:
        """One round for each effect that is named or nearest; that of the given model alone without one."""
        return [*self.kept, *self.near] or [self.first]

    def run(self) -> None:
        """Look for further effects beside the first."""
        taken = [self.first]
        while len(taken) < self.settings.effects_most and self._explains(taken[-1]):
            last = taken[-1].final
            following = judged(taken[-1], last.model, last)
            if following is None or not self._explains(following):
                break
            taken.append(following)
        self._confirm(taken)
        if not self.kept and self.first.decision.verdict != ADEQUATE:
            fit_play(self.first)
            seek_play_from_data(self.first)
            decision = self.first.decision
            if decision.verdict == MISSING and BACKLASH in decision.effects:
                self.kept, self.near, self.joint = [self.first], [], None
        left = self.joint or self.final
        if self.kept and left and not self.first.evidence().is_adequate(left):
            self.first.notes.append("More than noise is left, and no further effect is confirmed.")

    def drop(self, rounds: Sequence[Run], final: Simulated) -> None:
        """Leave out effects, with the fit without them.

        Parameters
        ----------
        rounds : sequence of Run
        final : Simulated
        """
        self.kept = [one for one in self.kept if one not in rounds]
        self.near, self.joint = [], None  # they were judged beside these effects
        if self.kept:
            last = self.kept[-1]
            last.final = replace(final, effects=last.final.effects)
        else:
            self.first.conclude_without_law(final)

    def demote(self, rounds: Sequence[Run], reason: str, final: Simulated) -> None:
        """Make effects the nearest that cannot be confirmed.

        Parameters
        ----------
        rounds : sequence of Run
            Of effects that are named.
        reason : str
            One sentence.
        final : Simulated
            With all effects that are named.
        """
        joint = self.joint or final
        for one in rounds:
            one.decision = replace(one.decision, verdict=NEAREST, reasons=(reason,))
        self.kept = [one for one in self.kept if one not in rounds]
        self.near = [*self.near, *rounds]
        self.joint = joint
        if self.kept:
            self.fit_named(joint)

    def _explains(self, run: Run) -> bool:
        """Whether the best law of a round is worth a further round beside it.

        Beside play a simulation takes ten times as long, and the first stage has no model of it.
        """
        if (
            run.final is None
            or BACKLASH in run.final.effects
            or run.decision.verdict == ADEQUATE
            or run.deadline.is_over
        ):
            return False
        if run.decision.verdict == MISSING:
            return True
        return run.evidence().share(run.final) >= self.settings.share_of_next and run.is_significant

    def _confirm(self, taken: list[Run]) -> None:
        """Keep the effects that are confirmed, each beside all others, and the nearest beside them.

        If none is, the first one keeps the name that it has alone, unless other effects took its place.
        """
        self.kept, most = taken[:1] if self.first.decision.verdict == MISSING else [], None
        for n in range(len(taken), 1, -1):
            review = self._reviewed(taken[:n])
            if review is not None and review.kept:
                self._keep(review)
                return
            most = most or review
        if most is not None and most.near:
            names = [one.final.effects[0] for one in most.near]
            self.kept = [one for one in self.kept if one.final.effects[0] in names]
            known = [one.final.effects[0] for one in self.kept]
            self.near = [one for one in most.near if one.final.effects[0] not in known]
            self.joint = most.final if self.near else None

    def _keep(self, review: Review) -> None:
        self.kept, self.near = review.kept, review.near
        self.fit_named(review.final)

    def fit_named(self, final: Simulated) -> None:
        """The fit of the effects that are named, without those that are only the nearest; in place.

        If there is no work left for it: the one beside the nearest, if it is of these effects, else that with
        all of them.

        Parameters
        ----------
        final : Simulated
            With all of them.
        """
        last = self.kept[-1]
        if self.near:
            self.joint = final
            work = self.first.deadline.bounded(self.settings.moves_of_fit)  # the rounds used theirs
            fits = replace(self.first.simulations(), deadline=work)
            names = [one.final.effects[0] for one in self.near]
            named = without(final.model, names)
            beside = (one.null for one in self.near if one.null and _same_effects(one.null.model, named))
            final = fits.fit(named, last.final.effects) or next(beside, final)
        last.final = replace(final, effects=last.final.effects)

    def _reviewed(self, taken: list[Run]) -> Review | None:
        """Each effect judged again beside all others; None if one of them is unknown.

        One that is not significant is dropped.
        """
        if taken[-1].decision.verdict not in (MISSING, NEAREST):
            return None
        final = taken[-1].final
        left, review = [one.final.effects[0] for one in taken], []
        while left:
            effect, *left = left
            # Two laws of one family may stand for a third.
            alike = [other for other in left if same_family(other, effect)]
            again = _judged_again(taken[0], without(final.model, [effect, *alike]))
            if again is None:
                return None
            if again.decision.verdict == MISSING and not (alike and self._is_worse(again.final, final)):
                left = [other for other in left if other not in alike]
            elif alike:
                again = _judged_again(taken[0], without(final.model, [effect]))
            if again is None:
                return None
            if again.decision.verdict == ADEQUATE:  # the others explain what it did
                if again.null is None:  # no work was left for a fit
                    return None
                final = again.null
            elif again.decision.verdict == MISSING or (_is_near(again) and again.is_significant):
                review.append(again)
                final = again.final
            else:
                return None
        return self._divided(review, final)

    def _divided(self, review: list[Run], final: Simulated) -> Review:
        """The effects that are named, and those that are only the nearest beside the others.

        A nearest effect may be another one in truth. A name must not depend on it: the effect has to be
        confirmed also without the nearest one, and with the best rival in its place.
        """
        near = [one for one in review if one.decision.verdict == NEAREST]
        named = [one for one in review if one not in near]
        kept = [one for one in named if all(self._is_named_without(one, of) for of in near)]
        return Review(kept, [one for one in review if one not in kept], final)

    def _is_named_without(self, one: Run, near: Run) -> bool:
        """Whether an effect is named without a nearest one, and with its best rival, but not itself, instead.

        Something is missing where nothing takes its place, which may change the shape of the effect: there a
        name of the same family is enough. A rival of that family would take the place of the effect.
        """
        name = one.final.effects[0]
        if not any(same_family(each, name) for each in self._named_beside(name, near.null.model, near)):
            return False
        rivals = [
            each for each in near.evidence().rivals(near.final) if not same_family(each.effects[0], name)
        ]
        best = sorted(rivals, key=lambda each: each.cost)[:1]
        return all(name in self._named_beside(name, each.model, near) for each in best)

    def _named_beside(self, name: str, model: PlantModel, near: Run) -> tuple[str, ...]:
        """What is named in the place of an effect of a model, where a nearest effect is not tried."""
        again = judged(self.first, without(model, [name]), left_out=near.decision.effects)
        return again.decision.effects if again and again.decision.verdict == MISSING else ()

    def _is_worse(self, one: Simulated, other: Simulated) -> bool:
        return self.first.evidence().is_worse(one, other)


def _judged_again(before: Run, model: PlantModel) -> Run | None:
    """A round beside a model; if it is unknown, beside the fit of this model as well.

    The part of the other laws is subtracted along the motion of the model, which may be far from the measured
    one while an effect is missing.
    """
    again = judged(before, model)
    if again is None or again.null is None or again.decision.verdict != UNKNOWN:
        return again
    return judged(before, again.null.model, again.null)


def _same_effects(one: PlantModel, other: PlantModel) -> bool:
    return sorted(effect.id for effect in one.effects) == sorted(effect.id for effect in other.effects)


def _is_near(run: Run) -> bool:
    return run.decision.verdict == NEAREST and run.final is not None


def same_family(one: str, other: str) -> bool:
    """Whether two effects are easily taken for each other.

    Parameters
    ----------
    one, other : str
    """
    return family(find(one)) == family(find(other))


def judged(
    before: Run, model: PlantModel, null: Simulated | None = None, left_out: Sequence[str] = ()
) -> Run | None:
    """A round beside a fitted model, with its verdict; None if there was no time for one.

    Parameters
    ----------
    before : Run
    model, null
        As `Run.beside`.
    left_out : sequence of str
        Effects that are not tried.
    """
    try:
        run = before.beside(model, null)
        run.without = {*run.without, *left_out}
        draw_up(run)
    except OutOfTime:
        before.not_tried["further effects"] = "the time was over"
        return None
    except CANNOT_FIT as error:  # the laws found so far cannot be simulated at their values
        before.not_tried["further effects"] = error.what if isinstance(error, InputError) else str(error)
        return None
    if run.null is None or run.draft.stage.conclusion.kind != "none":
        confirm(run)
    return run
