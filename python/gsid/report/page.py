"""The report page: collects experiments and writes them as one self-contained HTML file."""

from __future__ import annotations

import datetime
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gsid import plots
from gsid.base.files import write_atomically
from gsid.base.tables import Table, templates
from gsid.comparison import compare
from gsid.diagnosis.ladder import Ladder
from gsid.plant.model import PlantModel
from gsid.report.pictures import CAPTIONS, Picture, inline_svg, pictures_of
from gsid.report.tables import (
    ESTIMATORS_NOTE,
    Truth,
    distortion_table,
    failing_tables,
    model_tables,
    ranking_tables,
    truth_table,
)
from gsid.report.words import command_line, run_facts, verdict_of, versions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
class _Experiment:
    name: str
    story: str
    verdict: str
    grade: str  # "good", "bad" or "none": the colour of the verdict
    run: Sequence[tuple[str, str]]
    tables: Sequence[Table]
    pictures: Sequence[Picture]
    closing: Sequence[Table]  # after the pictures
    answer: str = ""  # closes the section


class Report:
    """Collection of experiments for one page.

    Parameters
    ----------
    title : str
    command : str, optional
        Command line shown at the end of the page; default: that of this process.
    """

    def __init__(self, title: str, *, command: str | None = None) -> None:
        self.title = title
        self.command = command_line() if command is None else command
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
        truth: Sequence[Truth] | None = None,
        story: str = "",
    ) -> Report:
        """Add one experiment. Sections without data are omitted.

        Parameters
        ----------
        name : str
            Heading on the page.
        record, spectra : one or one per realisation, optional
            With several, the pictures show the first one, except the picture of the excitation, which shows
            the one with the largest input.
        frf : Frf, optional
        model : RationalModel, PiecewiseModel or PlantModel, optional
            A plant is compared with the measured response if spectra are given, and shown with its ladder.
        comparison : Comparison, optional
        multisine : Multisine, optional
            The excitation as designed; default: the excitation as applied, from the spectra.
        distortion : Distortion, optional
            Shown if it is distinguishable from noise.
        noise : Noise, optional
            Noise of the first record.
        limits : Limits, optional
            Limits of command and travel, drawn with the excitation.
        truth : sequence of Truth, optional
        story : str, optional
            One or two sentences on the experiment and its purpose.

        Returns
        -------
        Report
            Itself, so that calls can be chained.
        """
        records, all_spectra = as_list(record), as_list(spectra)
        verdict, grade = verdict_of(frf, model, comparison)
        first = records[0] if records else None
        drawn = pictures_of(first, all_spectra, frf, model, comparison, multisine, noise=noise, limits=limits)
        bands = distortion.bands if distortion is not None else []
        if bands and comparison is None:
            verdict = f"{verdict} {distortion.verdict}"
        if bands:
            drawn.append(("Noise and distortion", lambda: plots.distortion(distortion)))
        self._experiments.append(
            _Experiment(
                name=name,
                story=story,
                verdict=verdict,
                grade=grade,
                run=run_facts(records, all_spectra, frf, multisine),
                tables=[*model_tables(model, truth), *([distortion_table(bands)] if bands else [])],
                pictures=self._drawn(drawn),
                closing=failing_tables(comparison),
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
            The true missing effect, if it is known; shown at the end of the section.
        truth : sequence of Truth, optional
            True parameters of the effect, with their estimates.

        Returns
        -------
        Report
            Itself, so that calls can be chained.
        """
        measured, band, before, drawn = diagnosis.measured, diagnosis.band, None, []
        if diagnosis.linear is not None:
            before = compare(diagnosis.linear, measured, band=band, fitted=True)
            drawn.append(("Error before an effect is added", lambda: plots.comparison(before)))
        if diagnosis.linear is not None and not diagnosis.adequate:
            torque = diagnosis.torque_residual()
            drawn.append(("Missing torque", lambda: plots.torque_residual(torque)))
        if diagnosis.named:
            after = compare(diagnosis.model, measured, band=band, fitted=True)
            drawn.append(("With the effects found", lambda: plots.comparison(after)))
        if ladder is not None and ladder.rungs:
            drawn.append(("Ladder", lambda: plots.ladder(ladder)))
        listed = {
            "Assumed": diagnosis.assumed,
            "Not tried": [": ".join(one) for one in diagnosis.not_tried.items()],
        }
        self._experiments.append(
            _Experiment(
                name=name,
                story=story,
                verdict=" ".join([diagnosis.sentence, *diagnosis.findings]),
                grade="good" if diagnosis.adequate else "bad",
                run=[
                    ("Records", ", ".join(s.name or "a record" for s in measured)),
                    ("Periods", f"{sum(s.n_periods for s in measured)} good in total"),
                    *((what, "; ".join(texts)) for what, texts in listed.items() if texts),
                ],
                tables=[*ranking_tables(diagnosis), *model_tables(diagnosis.model, None)],
                pictures=self._drawn(drawn),
                closing=[*failing_tables(before), *([truth_table(truth)] if truth else [])],
                answer=answer,
            )
        )
        return self

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
        good = [row for row in found.rows if not row.note]
        expected = (
            ""
            if found.cost_expected is None
            else f" Noise alone leaves {found.cost_expected:.0f} of the cost."
        )
        self._experiments.append(
            _Experiment(
                name=name,
                story=story,
                verdict=f"{len(good)} of {len(found.rows)} estimators converged to a stable model.{expected}",
                grade="good" if len(good) == len(found.rows) else "none",
                run=[
                    ("Order", f"{found.order}, {found.n_lines} lines"),
                    ("Delay by the slope of the phase", f"{1e3 * found.initial_delay_s:.4g} ms"),
                ],
                tables=[replace(found.table(), title="Estimators", note=ESTIMATORS_NOTE)],
                pictures=self._drawn([("Estimators", lambda: plots.estimators(found, frf))]),
                closing=[],
            )
        )
        return self

    def _drawn(self, pictures: Sequence[tuple[str, Callable[[], Figure]]]) -> list[Picture]:
        """Pictures of the next experiment, with ids that are unique on the page."""
        number = len(self._experiments) + 1
        return [
            Picture(title, CAPTIONS[title], inline_svg(draw(), f"e{number}p{i}-", title))
            for i, (title, draw) in enumerate(pictures, 1)
        ]

    def html(self) -> str:
        """Return the page as self-contained HTML."""
        now = datetime.datetime.now().astimezone()
        page = templates().get_template("report.html")
        return page.render(
            title=self.title,
            experiments=self._experiments,
            made=[("Date", now.strftime("%Y-%m-%d %H:%M %Z")), ("Command", self.command), *versions()],
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


def as_list(one_or_more) -> list:
    if one_or_more is None:
        return []
    return list(one_or_more) if isinstance(one_or_more, Sequence) else [one_or_more]
