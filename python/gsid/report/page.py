"""The report page: collects experiments and writes them as one self-contained HTML file."""

from __future__ import annotations

import datetime
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from gsid.base.errors import InputError
from gsid.base.files import write_atomically
from gsid.base.tables import Table, templates
from gsid.report import answer as answers
from gsid.report import drawings
from gsid.report.answer import Answer
from gsid.report.folds import Fold, Given, folds_of
from gsid.report.pictures import Drawing, Painter, Picture
from gsid.report.tables import Truth, truth_table
from gsid.report.words import command_line, versions
from gsid.response.estimate import frf as estimate_frf

if TYPE_CHECKING:
    from gsid.comparison import Comparison
    from gsid.diagnosis.from_records.result import Diagnosis
    from gsid.diagnosis.ladder import Ladder
    from gsid.excitation.multisine import Multisine
    from gsid.excitation.periodic import Limits
    from gsid.fitting.estimators import Estimators
    from gsid.models.piecewise import PiecewiseModel
    from gsid.models.rational import RationalModel
    from gsid.plant.model import PlantModel
    from gsid.records.record import Record
    from gsid.response.distortion import Distortion
    from gsid.response.frf import Frf
    from gsid.spectrum.noise import Noise
    from gsid.spectrum.spectra import Spectra


@dataclass(frozen=True)
class _Section:
    """A fold with its pictures drawn."""

    fold: Fold
    pictures: Sequence[Picture]


@dataclass(frozen=True)
class _Experiment:
    name: str
    story: str
    answer: Answer
    pictures: Sequence[Picture]
    closing: str  # what was hidden, if it is known
    closing_table: Table | None
    sections: Sequence[_Section]
    folded: bool


class Report:
    """Collection of experiments for one page.

    The answer of each experiment and its main pictures stand open; everything else is folded, and opened when
    the page is printed.

    Parameters
    ----------
    title : str
    command : str, optional
        Command line shown at the end of the page; default: that of this process.
    interactive : bool
        Whether the pictures can be zoomed and read with the pointer. plotly.js of the installed plotly is
        then part of the page, which grows by 5 MB; it still needs no network.

    Raises
    ------
    InputError
        Interactive pictures were requested and plotly is not installed.
    """

    def __init__(self, title: str, *, command: str | None = None, interactive: bool = False) -> None:
        self.title = title
        self.command = command_line() if command is None else command
        self._plotly_js = _plotly_js() if interactive else ""
        self._experiments: list[_Experiment] = []

    def __repr__(self) -> str:
        return f"Report({self.title!r}, {len(self._experiments)} experiments)"

    def add_experiment(
        self,
        name: str,
        record: Record | Sequence[Record] | None = None,
        spectra: Spectra | Sequence[Spectra] | None = None,
        frf: Frf | None = None,
        model: RationalModel | PiecewiseModel | PlantModel | None = None,
        comparison: Comparison | None = None,
        *,
        multisine: Multisine | None = None,
        distortion: Distortion | None = None,
        noise: Noise | None = None,
        limits: Limits | None = None,
        diagnosis: Diagnosis | None = None,
        ladder: Ladder | None = None,
        estimators: Estimators | None = None,
        truth: Sequence[Truth] | None = None,
        story: str = "",
        closing: str = "",
        folded: bool = False,
    ) -> Report:
        """Add one experiment. Sections without data are omitted.

        Parameters
        ----------
        name : str
            Heading on the page.
        record, spectra : one or one per realisation, optional
            With several, the picture of the signal shows the one that the model predicts worst, that of the
            excitation the one with the largest input, the others the first one.
        frf : Frf, optional
        model : RationalModel, PiecewiseModel or PlantModel, optional
            With a diagnosis: the model that was given to it, with its values before any fit.
        comparison : Comparison, optional
            Of this model.
        multisine : Multisine, optional
            The excitation as designed; default: the excitation as applied, from the spectra.
        distortion : Distortion, optional
            Shown if it is distinguishable from noise.
        noise : Noise, optional
            Noise of the first record.
        limits : Limits, optional
            Limits of command and travel, drawn with the excitation.
        diagnosis : Diagnosis, optional
            It gives the answer and the model shown.
        ladder : Ladder, optional
            Error after each step; default: that of the model shown.
        estimators : Estimators, optional
            Models that several estimators fitted to this response (thesis, section 7.10).
        truth : sequence of Truth, optional
        story : str, optional
            One or two sentences on the experiment and its purpose.
        closing : str, optional
            The true missing effect, if it is known; shown with `truth` after the pictures.
        folded : bool
            Whether only its heading and its verdict are open.

        Returns
        -------
        Report
            Itself, so that calls can be chained.
        """
        given = Given(
            records=as_list(record),
            measured=as_list(spectra),
            frf=frf,
            model=model,
            comparison=comparison,
            multisine=multisine,
            distortion=distortion,
            noise=noise,
            limits=limits,
            diagnosis=diagnosis,
            ladder=ladder,
            estimators=estimators,
            truth=() if closing else tuple(truth or ()),
        )
        painter = Painter(len(self._experiments) + 1, interactive=bool(self._plotly_js))
        pictures = painter.paint(_main_drawings(given))
        sections = [_Section(fold, painter.paint(fold.drawings)) for fold in folds_of(given)]
        self._experiments.append(
            _Experiment(
                name=name,
                story=story,
                answer=_answer(given),
                pictures=pictures,
                closing=closing,
                closing_table=truth_table(truth) if closing and truth else None,
                sections=sections,
                folded=folded,
            )
        )
        return self

    def add_diagnosis(
        self,
        name: str,
        diagnosis: Diagnosis,
        *,
        ladder: Ladder | None = None,
        story: str = "",
        answer: str = "",
        truth: Sequence[Truth] = (),
    ) -> Report:
        """Add the result of a diagnosis: where the model fails, which effect is missing, how certain this is.

        Parameters
        ----------
        name : str
            Heading on the page.
        diagnosis : Diagnosis
        ladder : Ladder, optional
            Error after each step, on data that were not fitted.
        story : str, optional
        answer : str, optional
            The true missing effect, if it is known; shown after the pictures.
        truth : sequence of Truth, optional
            True parameters of the effect, with their estimates.

        Returns
        -------
        Report
            Itself, so that calls can be chained.
        """
        try:
            response = estimate_frf(diagnosis.measured, band=diagnosis.band)
        except InputError:  # records that have no response in common are diagnosed together
            response = None
        return self.add_experiment(
            name,
            spectra=diagnosis.measured,
            frf=response,
            diagnosis=diagnosis,
            ladder=ladder,
            truth=truth,
            story=story,
            closing=answer,
        )

    def add_estimators(self, name: str, frf: Frf, found: Estimators, *, story: str = "") -> Report:
        """Add the models that several estimators fitted to one response (thesis, section 7.10).

        Parameters
        ----------
        name : str
            Heading on the page.
        frf : Frf
            The response fitted.
        found : Estimators
        story : str, optional

        Returns
        -------
        Report
            Itself, so that calls can be chained.
        """
        return self.add_experiment(name, frf=frf, estimators=found, story=story)

    def html(self) -> str:
        """Return the page as self-contained HTML."""
        now = datetime.datetime.now().astimezone()
        page = templates().get_template("report.html")
        return page.render(
            title=self.title,
            experiments=self._experiments,
            made=Table(
                (), [("Date", now.strftime("%Y-%m-%d %H:%M %Z")), ("Command", self.command), *versions()]
            ),
            plotly_js=Markup(self._plotly_js),
        )

    def write(self, path: str | os.PathLike) -> Path:
        """Write the page. An existing file is replaced only when the new one is complete.

        Parameters
        ----------
        path : path-like

        Returns
        -------
        Path

        Raises
        ------
        OSError
            The folder cannot be written.
        """
        text = self.html()
        write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))
        return Path(path)


def _answer(given: Given) -> Answer:
    if given.diagnosis is not None:
        return answers.of_diagnosis(given.diagnosis, given.steps)
    if given.comparison is not None:
        return answers.of_comparison(given.comparison, given.model)
    if given.estimators is not None and given.model is None:
        return answers.of_estimators(given.estimators)
    return answers.of_measurement(given.frf, given.model, given.distortion)


def _main_drawings(given: Given) -> list[Drawing]:
    """The pictures that are not folded: signal, response, ladder."""
    found = given.diagnosis
    if found is not None and found.linear is not None:
        signal = drawings.signal_of_diagnosis(found)
    elif given.model is not None:
        signal = drawings.signal_of_model(given.model, given.measured)
    else:
        signal = []
    response, _ = drawings.response(given.frf, given.shown, given.inputs)
    if given.estimators is not None and given.model is None:
        response = drawings.estimators(given.estimators, given.frf)
    steps = given.steps
    return [*signal, *response, *(drawings.ladder(steps) if steps else [])]


def _plotly_js() -> str:
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise InputError(
            "interactive pictures need plotly", "", None, "pip install plotly, or leave out --interactive"
        ) from error
    return get_plotlyjs()


def as_list(one_or_more) -> list:
    if one_or_more is None:
        return []
    return list(one_or_more) if isinstance(one_or_more, Sequence) else [one_or_more]
