"""What stands folded below the pictures of an experiment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gsid import plots
from gsid.base.tables import Table
from gsid.comparison import compare
from gsid.diagnosis.ladder import Ladder
from gsid.diagnosis.ladder import ladder as ladder_of
from gsid.plant.model import PlantModel
from gsid.report import drawings
from gsid.report.pictures import Drawing
from gsid.report.tables import (
    ESTIMATORS_NOTE,
    Truth,
    distortion_table,
    failing_tables,
    model_tables,
    ranking_tables,
)
from gsid.report.words import run_facts

if TYPE_CHECKING:
    from gsid.comparison import Comparison
    from gsid.diagnosis.from_records.result import Diagnosis
    from gsid.excitation.multisine import Multisine
    from gsid.excitation.periodic import Limits
    from gsid.fitting.estimators import Estimators
    from gsid.models.piecewise import PiecewiseModel
    from gsid.models.rational import RationalModel
    from gsid.records.record import Record
    from gsid.response.distortion import Distortion
    from gsid.response.frf import Frf
    from gsid.spectrum.noise import Noise
    from gsid.spectrum.spectra import Spectra


@dataclass(frozen=True)
class Given:
    """The results of one experiment, as given to `Report.add_experiment`."""

    records: Sequence[Record]
    measured: Sequence[Spectra]
    frf: Frf | None
    model: RationalModel | PiecewiseModel | PlantModel | None
    comparison: Comparison | None
    multisine: Multisine | None
    distortion: Distortion | None
    noise: Noise | None
    limits: Limits | None
    diagnosis: Diagnosis | None
    ladder: Ladder | None
    estimators: Estimators | None
    truth: Sequence[Truth]

    @property
    def shown(self) -> RationalModel | PiecewiseModel | PlantModel | None:
        """The model of the pictures: the one that the diagnosis found, or the one given."""
        found = None if self.diagnosis is None else self.diagnosis.model
        return self.model if found is None else found

    @property
    def inputs(self) -> Sequence[Spectra]:
        """The records with the hold that the diagnosis assumed."""
        return self.measured if self.diagnosis is None else self.diagnosis.measured

    @property
    def steps(self) -> Ladder | None:
        """The ladder; None if it has no step."""
        steps = self.ladder
        if steps is None and isinstance(self.shown, PlantModel):
            steps = ladder_of(self.shown)
        return steps if steps is not None and steps.rungs else None


@dataclass(frozen=True)
class Fold:
    """A folded part of the page.

    Attributes
    ----------
    title : str
    text : sequence of str
        Paragraphs.
    drawings : sequence of Drawing
    tables : sequence of Table
    """

    title: str
    text: Sequence[str] = ()
    drawings: Sequence[Drawing] = ()
    tables: Sequence[Table] = ()


def folds_of(given: Given) -> list[Fold]:
    """The folded parts that have a content.

    Parameters
    ----------
    given : Given
    """
    of_diagnosis = [] if given.diagnosis is None else [_failing(given.diagnosis), _which(given.diagnosis)]
    folds = [
        *of_diagnosis,
        _comparison(given),
        _model(given),
        _response(given),
        _estimators(given),
        _measurement(given),
    ]
    return [fold for fold in folds if fold.text or fold.drawings or fold.tables]


def _failing(found: Diagnosis) -> Fold:
    """Error of the linear part, and with the effects found."""
    if found.linear is None:
        return Fold("")
    before = compare(found.linear, found.measured, band=found.band, fitted=True)
    drawn = [Drawing("Error before an effect is added", lambda: plots.comparison(before))]
    if found.named:
        after = compare(found.model, found.measured, band=found.band, fitted=True)
        drawn.append(Drawing("With the effects found", lambda: plots.comparison(after)))
    return Fold("Where the linear model fails", [before.verdict], drawn, failing_tables(before))


def _which(found: Diagnosis) -> Fold:
    """Ranking, missing torque, and what the result relies on."""
    drawn = []
    if found.linear is not None and not found.adequate:
        drawn.append(Drawing("Missing torque", found.plot))
    lists = {
        "Assumed": list(found.assumed),
        "Not tried": [": ".join(one) for one in found.not_tried.items()],
    }
    rows = [(what, "; ".join(texts)) for what, texts in lists.items() if texts]
    tables = [*ranking_tables(found), *([Table((), rows, title="Basis of the diagnosis")] if rows else [])]
    return Fold("Which effect is missing", found.findings, drawn, tables)


def _comparison(given: Given) -> Fold:
    """The comparison of the given model."""
    if given.comparison is None:
        return Fold("")
    drawn = [Drawing("Comparison at the output", lambda: plots.comparison(given.comparison))]
    tables = failing_tables(given.comparison)
    if given.diagnosis is None:
        return Fold("Where the model fails", (), drawn, tables)
    return Fold(
        "The given model, before its parameters are fitted", [given.comparison.verdict], drawn, tables
    )


def _model(given: Given) -> Fold:
    return Fold(
        "Model and parameters", (), drawings.roots(given.shown), model_tables(given.shown, given.truth)
    )


def _response(given: Given) -> Fold:
    _, drawn = drawings.response(given.frf, given.shown, given.inputs)
    distortion, tables = given.distortion, []
    if distortion is not None and distortion.bands:
        drawn.append(Drawing("Noise and distortion", lambda: plots.distortion(distortion)))
        tables.append(distortion_table(distortion.bands))
    return Fold("Response in detail", (), drawn, tables)


def _estimators(given: Given) -> Fold:
    found = given.estimators
    if found is None:
        return Fold("")
    drawn = [] if given.model is None else drawings.estimators(found, given.frf)
    rows = [
        ("Order", f"{found.order}, {found.n_lines} lines"),
        ("Delay by the slope of the phase", f"{1e3 * found.initial_delay_s:.4g} ms"),
    ]
    tables = [replace(found.table(), title="Estimators", note=ESTIMATORS_NOTE), Table((), rows, title="Fit")]
    return Fold("Estimators", (), drawn, tables)


def _measurement(given: Given) -> Fold:
    source = given.frf or (given.measured[0] if given.measured else None)
    drawn = drawings.measurement(
        given.records[0] if given.records else None,
        given.measured,
        "" if source is None else source.u_unit,
        given.shown,
        given.multisine,
        given.noise,
        given.limits,
    )
    facts = run_facts(given.records or given.measured, given.measured, given.frf, given.multisine)
    return Fold("Measurement", (), drawn, [Table((), facts, title="Record")] if facts else [])
