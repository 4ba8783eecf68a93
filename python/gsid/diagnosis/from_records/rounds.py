"""Several effects that a given model lacks: rounds of one effect each, and a review of what was found.

Each round runs the first stage and the fits by simulation beside the effects found so far. Of two missing
effects the larger one alone is not confirmed: the best law of a round is taken for the time being if it
explains much. At the end each effect is judged again beside all others. One that is no longer significant is
dropped, and all others have to be confirmed.
"""

from __future__ import annotations

from collections.abc import Sequence

from gsid.base.deadline import OutOfTime
from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.law_part import without
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.verdict import ADEQUATE, MISSING
from gsid.diagnosis.missing_torque.catalogue import family
from gsid.effects.types import find
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel


class Rounds:
    """The rounds of a diagnosis with a given model.

    Attributes
    ----------
    first : Run
        The given model alone.
    kept : list of Run
        One for each effect found, in their order; each was judged beside all others.
    """

    def __init__(self, first: Run) -> None:
        self.first, self.settings = first, first.settings
        self.kept: list[Run] = [first] if first.decision.verdict == MISSING else []

    @property
    def final(self) -> Simulated | None:
        """The fit with all effects found."""
        return self.kept[-1].final if self.kept else None

    def run(self) -> None:
        """Look for further effects beside the first."""
        taken = [self.first]
        while len(taken) < self.settings.effects_most and self._explains(taken[-1]):
            last = taken[-1].final
            following = judged(taken[-1], last.model, last)
            if following is None or not self._explains(following):
                break
            taken.append(following)
        self.kept = self._confirmed(taken)
        if not self.kept and self.first.decision.verdict != ADEQUATE:
            self.first.fit_play()
            self.kept = [self.first] if self.first.decision.verdict == MISSING else []
        if self.kept and not self.first.evidence().is_adequate(self.final):
            self.first.notes.append("More than noise is left, and no further effect is confirmed.")

    def drop(self, rounds: Sequence[Run], final: Simulated) -> None:
        """Leave out effects, with the fit without them.

        Parameters
        ----------
        rounds : sequence of Run
        final : Simulated
        """
        self.kept = [one for one in self.kept if one not in rounds]
        if self.kept:
            self.kept[-1].final = final
        else:
            self.first.conclude_without_law(final)

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

    def _confirmed(self, taken: list[Run]) -> list[Run]:
        """The rounds whose effects are confirmed, each beside all others."""
        for n in range(len(taken), 1, -1):
            reviewed = self._reviewed(taken[:n])
            if reviewed:
                return reviewed
        return taken[:1] if self.first.decision.verdict == MISSING else []

    def _reviewed(self, taken: list[Run]) -> list[Run]:
        """Each effect judged again beside all others; empty if one of them is not confirmed."""
        if taken[-1].decision.verdict != MISSING:
            return []
        final = taken[-1].final
        left, kept = [one.final.effects[0] for one in taken], []
        while left:
            effect, *left = left
            # Two laws of one family may stand for a third.
            alike = [other for other in left if same_family(other, effect)]
            again = judged(taken[0], without(final.model, [effect, *alike]))
            if again is None:
                return []
            if again.decision.verdict == MISSING and not (alike and self._is_worse(again.final, final)):
                left = [other for other in left if other not in alike]
            elif alike:
                again = judged(taken[0], without(final.model, [effect]))
            if again is None:
                return []
            if again.decision.verdict == ADEQUATE:  # the others explain what it did
                final = again.null
            elif again.decision.verdict == MISSING:
                kept.append(again)
                final = again.final
            else:
                return []
        return kept

    def _is_worse(self, one: Simulated, other: Simulated) -> bool:
        return self.first.evidence().is_worse(one, other)


def same_family(one: str, other: str) -> bool:
    """Whether two effects are easily taken for each other.

    Parameters
    ----------
    one, other : str
    """
    return family(find(one)) == family(find(other))


def judged(before: Run, model: PlantModel, null: Simulated | None = None) -> Run | None:
    """A round beside a fitted model, with its verdict; None if there was no time for one.

    Parameters
    ----------
    before : Run
    model, null
        As `Run.beside`.
    """
    try:
        run = before.beside(model, null)
        run.draw_up()
    except OutOfTime:
        before.not_tried["further effects"] = "the time was over"
        return None
    if run.null is None or run.draft.stage.conclusion.kind != "none":
        run.confirm()
    return run
