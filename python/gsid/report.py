"""Report of one or several experiments: one self-contained HTML page that opens offline.

report = Report("Inner azimuth axis")
report.add_experiment("Linear", record, spectra, frf, model, comparison)
report.write("report.html")
"""

from __future__ import annotations

import datetime
import io
import os
import platform
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import jinja2
import matplotlib
import numpy as np
from markupsafe import Markup, escape

from gsid import plots
from gsid._lib import ffi, lib, version
from gsid.compare import compare
from gsid.confidence import NORMAL_95, root_quantities
from gsid.files import write_atomically
from gsid.ladder import Ladder, ladder
from gsid.plant import Param, PlantModel
from gsid.torque import torque_residual

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.compare import Comparison
    from gsid.diagnose import Diagnosis, Group
    from gsid.distortion import Distortion
    from gsid.estimators import Estimators
    from gsid.excitation import Multisine
    from gsid.frf import Frf
    from gsid.model import RationalModel
    from gsid.record import Record
    from gsid.spectra import Spectra
    from gsid.verdict import DistortedBand


RANKED = 5  # groups of effects shown of each round


@dataclass(frozen=True)
class Truth:
    """A quantity whose true value is known, beside its estimate.

    Attributes
    ----------
    name, unit : str
    truth, estimate, std : float
        std is the estimate's standard deviation, in the same unit.
    """

    name: str
    unit: str
    truth: float
    estimate: float
    std: float

    @property
    def n_sigma(self) -> float:
        """Difference of estimate and truth in standard deviations."""
        return (self.estimate - self.truth) / self.std if self.std > 0.0 else np.nan


@dataclass(frozen=True)
class _Picture:
    title: str
    caption: str  # how to read it, one sentence
    svg: Markup


@dataclass(frozen=True)
class _Table:
    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


@dataclass(frozen=True)
class _Experiment:
    name: str
    story: str
    verdict: str
    grade: str  # "good", "bad" or "none": the colour of the verdict
    run: Sequence[tuple[str, str]]
    tables: Sequence[_Table]
    pictures: Sequence[_Picture]
    closing: Sequence[_Table]  # after the pictures
    answer: str = ""  # the last word


class Report:
    """Experiments gathered for one page.

    Parameters
    ----------
    title : str
    command : str, optional
        Command line to state at the end; default: that of this process.
    """

    def __init__(self, title: str, *, command: str | None = None) -> None:
        self.title = title
        self.command = _command_line() if command is None else command
        self._experiments: list[_Experiment] = []

    def __repr__(self) -> str:
        return f"Report({self.title!r}, {len(self._experiments)} experiments)"

    def add_experiment(
        self,
        name: str,
        record: Record | Sequence[Record] | None = None,
        spectra: Spectra | Sequence[Spectra] | None = None,
        frf: Frf | None = None,
        model: RationalModel | PlantModel | None = None,
        comparison: Comparison | None = None,
        *,
        multisine: Multisine | None = None,
        distortion: Distortion | None = None,
        truth: Sequence[Truth] | None = None,
        story: str = "",
    ) -> Report:
        """Add one experiment; what is not there is left out of the page.

        Parameters
        ----------
        name : str
            Heading on the page.
        record, spectra : one or one per realisation, optional
            Of several, the pictures show the first.
        frf : Frf, optional
        model : RationalModel or PlantModel, optional
            A plant is shown beside the measured response where there are spectra, and with its ladder.
        comparison : Comparison, optional
        multisine : Multisine, optional
            The excitation as designed; without it the applied one is shown, from the spectra.
        distortion : Distortion, optional
            Shown where it could be told from noise.
        truth : sequence of Truth, optional
        story : str, optional
            A sentence or two on what was done and why.

        Returns
        -------
        Report
            Itself, so that calls can be chained.
        """
        records, all_spectra = _as_list(record), _as_list(spectra)
        verdict, grade = _verdict(frf, model, comparison)
        drawn = _pictures(records[0] if records else None, all_spectra, frf, model, comparison, multisine)
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
                run=_run_facts(records, all_spectra, frf, multisine),
                tables=[*_tables(model, truth), *([_distortion_table(bands)] if bands else [])],
                pictures=self._drawn(drawn),
                closing=_failing_tables(comparison),
            )
        )
        return self

    def add_diagnosis(
        self,
        name: str,
        spectra: Spectra | Sequence[Spectra],
        diagnosis: Diagnosis,
        *,
        ladder: Ladder | None = None,
        band: tuple[float, float] | None = None,
        story: str = "",
        answer: str = "",
        truth: Sequence[Truth] = (),
    ) -> Report:
        """Add what a diagnosis found: where the model fails, which effect is missing, how sure that is.

        Parameters
        ----------
        name : str
            Heading on the page.
        spectra : Spectra or sequence of Spectra
            What was diagnosed.
        diagnosis : Diagnosis
        ladder : Ladder, optional
            How much the error fell on data kept out.
        band : (lo, hi), optional
            Hz; that of the diagnosis.
        story : str, optional
        answer : str, optional
            What was missing in truth, where that is known; it ends the section.
        truth : sequence of Truth, optional
            Its parameters beside what was found.

        Returns
        -------
        Report
            Itself, so that calls can be chained.
        """
        measured = _as_list(spectra)
        fitted = diagnosis.steps[0].fit.model
        before = compare(fitted, measured, band=band, alpha=diagnosis.alpha)
        drawn = [("Where it fails", lambda: plots.comparison(before))]
        if not diagnosis.adequate:
            torque = torque_residual(fitted, measured, band=band)
            drawn.append(("Torque that is missing", lambda: plots.torque_residual(torque)))
        if diagnosis.found:
            after = compare(diagnosis.model, measured, band=band, alpha=diagnosis.alpha)
            drawn.append(("With what was found", lambda: plots.comparison(after)))
        if ladder is not None and ladder.rungs:
            drawn.append(("Ladder", lambda: plots.ladder(ladder)))
        self._experiments.append(
            _Experiment(
                name=name,
                story=story,
                verdict=diagnosis.sentence,
                grade="good" if diagnosis.adequate else "bad",
                run=[
                    ("Records", ", ".join(s.name or "a record" for s in measured)),
                    ("Periods", f"{sum(s.n_periods for s in measured)} good in all"),
                ],
                tables=[*_ranking_tables(diagnosis), _plant_table(diagnosis.model)],
                pictures=self._drawn(drawn),
                closing=[*_failing_tables(before), *([_truth_table(truth)] if truth else [])],
                answer=answer,
            )
        )
        return self

    def add_estimators(self, name: str, frf: Frf, found: Estimators, *, story: str = "") -> Report:
        """Add what each estimator made of the same response (source, section 7.10).

        Parameters
        ----------
        name : str
            Heading on the page.
        frf : Frf
            What they were fitted to.
        found : Estimators
        story : str, optional

        Returns
        -------
        Report
            Itself, so that calls can be chained.
        """
        head, rows = found.table()
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
                tables=[_Table("Estimators", head, rows, _ESTIMATORS_NOTE)],
                pictures=self._drawn([("Estimators", lambda: plots.estimators(found, frf))]),
                closing=[],
            )
        )
        return self

    def _drawn(self, pictures: Sequence[tuple[str, Callable[[], Figure]]]) -> list[_Picture]:
        """Pictures of the next experiment, with ids that are the page's alone."""
        number = len(self._experiments) + 1
        return [
            _Picture(title, _CAPTIONS[title], _inline_svg(draw(), f"e{number}p{i}-", title))
            for i, (title, draw) in enumerate(pictures, 1)
        ]

    def html(self) -> str:
        """Return the page, with everything it needs inside."""
        loader = jinja2.PackageLoader("gsid", "templates")
        environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
        now = datetime.datetime.now().astimezone()
        return environment.get_template("report.html").render(
            title=self.title,
            experiments=self._experiments,
            made=[("Date", now.strftime("%Y-%m-%d %H:%M %Z")), ("Command", self.command), *_versions()],
        )

    def write(self, path: str | os.PathLike) -> Path:
        """Write the page; an old one stays whole until the new one is complete.

        Parameters
        ----------
        path : path-like

        Returns
        -------
        Path

        Raises
        ------
        OSError
            When the folder cannot be written.
        """
        text = self.html()
        write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))
        return Path(path)


# --- words ------------------------------------------------------------------------------------------------


def _as_list(one_or_more) -> list:
    if one_or_more is None:
        return []
    return list(one_or_more) if isinstance(one_or_more, Sequence) else [one_or_more]


def _verdict(
    frf: Frf | None, model: RationalModel | PlantModel | None, comparison: Comparison | None
) -> tuple[str, str]:
    if comparison is not None:
        return comparison.verdict, "good" if comparison.adequate else "bad"
    if isinstance(model, PlantModel):
        return f"A plant of {len(model.effects)} effects; not compared with a record.", "none"
    if model is not None:
        delay = plots.delay_text(model.delay_s, model.fs_hz, model.std_delay_s)
        fitted = (
            f"Fitted: a {plots.order_text(model)} model with a delay of {delay}; not compared with a record."
        )
        return fitted, "none"
    if frf is not None:
        return f"Measured: the frequency response at {len(frf.f_hz)} lines; no model was fitted.", "none"
    return "No frequency response.", "none"


def _run_facts(records, spectra, frf: Frf | None, multisine: Multisine | None) -> list[tuple[str, str]]:
    source = frf or (spectra[0] if spectra else None)
    facts = []
    names = [r.name for r in records if r.name] or ([source.name] if source and source.name else [])
    if names:
        facts.append(("Records" if len(names) > 1 else "Record", ", ".join(names)))
    if source is None:
        return facts
    n, fs = source.period_samples, source.fs_hz
    facts += [
        ("Sample rate", f"{fs:g} Hz"),
        ("Period", f"{n} samples ({n / fs:.6g} s), line spacing {fs / n:.4g} Hz"),
        ("Periods", f"{source.n_periods} good, {source.n_spoiled} left out for lost samples"),
        (
            "Settling",
            f"{source.settle_samples} samples ({source.settle_samples / n:.2f} periods) thrown away",
        ),
    ]
    if getattr(source, "n_realisations", 1) > 1:
        facts.append(("Realisations", str(source.n_realisations)))
    if multisine is not None:
        facts.append(("Excitation", _excitation_text(multisine)))
    elif frf is not None:
        f = frf.f_hz
        facts.append(("Excitation", f"{len(f)} lines, {f.min():.4g} to {f.max():.4g} Hz"))
    held = "held over each sample (zero-order hold)" if source.hold == "zoh" else "measured as it stands"
    facts.append(("Input and output", f"u [{source.u_unit or '-'}], {held}; y [{source.y_unit or '-'}]"))
    return facts


def _excitation_text(m: Multisine) -> str:
    shape = f"{m.shape_db_per_decade:g} dB per decade" if m.shape_db_per_decade else "flat"
    phases = "Schroeder phases" if m.seed is None else f"random phases of seed {m.seed}"
    return (
        f"multisine, {len(m.line)} lines ({m.grid}), {plots.band_text(m.f_hz.min(), m.f_hz.max())}, {shape}, "
        f"{phases}; peak {m.peak:.4g}, rms {m.rms:.4g}, crest factor {m.crest_factor:.3f} on samples, "
        f"{m.crest_factor_fine:.3f} between them"
    )


# --- tables -----------------------------------------------------------------------------------------------


def _number(value: float, digits: int = 6) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value:.{digits}g}".replace("-", "−")


def _tables(model: RationalModel | PlantModel | None, truth: Sequence[Truth] | None) -> list[_Table]:
    tables = []
    if truth:
        tables.append(_truth_table(truth))
    if isinstance(model, PlantModel):
        tables.append(_plant_table(model))
    elif model is not None:
        tables += [_fit_table(model), _root_table(model), _parameter_table(model)]
    return tables


def _distortion_table(bands: Sequence[DistortedBand]) -> _Table:
    rows = []
    for band in bands:
        low, high = (f"{db:.0f}".replace("-", "−") for db in (band.low_db, band.high_db))
        size = "" if band.kind == "noise" else low if low == high else f"{low} to {high}"
        kind = "noise leads" if band.kind == "noise" else f"{band.kind} distortion"
        rows.append((plots.band_text(band.f_lo_hz, band.f_hi_hz), kind, size))
    note = "Averaging over more periods lowers the noise only."
    return _Table("Noise and distortion", ("Band", "What limits", "Above noise [dB]"), rows, note)


def _truth_table(truth: Sequence[Truth]) -> _Table:
    rows = [
        (t.name, t.unit, _number(t.truth), _number(t.estimate), _number(t.std, 2), _signed(t.n_sigma))
        for t in truth
    ]
    head = ("Quantity", "Unit", "Truth", "Estimate", "σ", "Difference [σ]")
    return _Table(
        "Truth beside estimate", head, rows, "Within ±2 σ in 95 of 100 cases, when the model is right."
    )


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−") if np.isfinite(value) else ""


def _fit_table(m: RationalModel) -> _Table:
    delay = plots.delay_text(m.delay_s, m.fs_hz, m.std_delay_s)
    rows = [
        ("Order (poles/zeros)", f"{plots.order_text(m)} in {m.domain}"),
        ("Delay", f"{delay}, {'free' if m.free_delay else 'given'}"),
        ("Poles", "all stable" if m.stable else "not all stable"),
        ("Parameters", f"{m.n_parameters} free"),
    ]
    if m.hold == "zoh":
        rows.append(("Input", "held over each sample; this is what follows"))
    if m.method is not None:
        rows.append(("Method", f"{m.method}, {'converged' if m.converged else 'not converged'}"))
    if m.band_hz is not None:
        rows.append(("Lines", f"{m.n_lines} in {plots.band_text(*m.band_hz)}"))
    if m.cost is not None:
        expected = f", {_number(m.cost_expected, 5)} expected of noise alone" if m.cost_expected else ""
        rows.append(("Cost", f"{_number(m.cost, 5)}{expected}"))
    return _Table(
        "Fitted model",
        (),
        rows,
        "Intervals are 95 % and count the noise only: they hold where the model is adequate.",
    )


def _root_table(m: RationalModel) -> _Table:
    rows = []
    for kind, roots, covs in (("pole", m.poles, m.pole_cov), ("zero", m.zeros, m.zero_cov)):
        for root, cov in sorted(zip(roots, covs, strict=True), key=lambda pair: abs(pair[0])):
            if root.imag >= -1e-9 * abs(root):
                rows.append(_root_row(kind, root, cov, m))
    where = "s / 2π [Hz]" if m.domain == "s" else "z"
    head = ("", where, "Frequency [Hz]", "Damping ratio", "Time constant [ms]")
    note = "Of a conjugate pair one is listed. Intervals are 95 %." if rows else "No poles and no zeros."
    return _Table("Poles and zeros", head, rows, note)


def _root_row(kind: str, root: complex, cov, m: RationalModel) -> tuple[str, ...]:
    f, zeta, std_f, std_zeta = root_quantities(root, cov, domain=m.domain, fs_hz=m.fs_hz)
    shown = plots.root_text(root / (2.0 * np.pi) if m.domain == "s" else root)
    frequency = plots.with_interval(f, std_f)
    if abs(root.imag) > 1e-9 * abs(root):
        return kind, shown, frequency, plots.with_interval(zeta, std_zeta), ""
    if not f > NORMAL_95 * np.nan_to_num(std_f):  # may be an integrator: no time constant
        return kind, shown, frequency, "", ""
    tau = 1e3 / (2.0 * np.pi * f)
    return kind, shown, frequency, "", plots.with_interval(tau, tau * std_f / f)


def _parameter_table(m: RationalModel) -> _Table:
    rows = []
    for name, values, stds in (("numerator", m.num, m.std_num), ("denominator", m.den, m.std_den)):
        powers = range(len(values) - 1, -1, -1) if m.domain == "s" else range(0, -len(values), -1)
        for power, value, std in zip(powers, values, stds, strict=True):
            rows.append((f"{name}, {m.domain}{_superscript(power)}", _number(value, 8), *_spread(value, std)))
    rows.append(("delay [s]", _number(m.delay_s, 8), *_spread(m.delay_s, m.std_delay_s)))
    note = "No σ: not estimated." + (" Frequencies in rad/s." if m.domain == "s" else "")
    return _Table("Parameters", ("Parameter", "Estimate", "σ", "σ [%]"), rows, note)


def _spread(value: float, std: float) -> tuple[str, str]:
    if std is None or not std > 0.0:
        return "", ""
    return _number(std, 3), _number(100.0 * std / abs(value), 2) if value else ""


def _superscript(power: int) -> str:
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _plant_table(model: PlantModel) -> _Table:
    rows = []
    for label, effect in model.labels():
        for i, (name, param) in enumerate(effect.params.items()):
            value = _number(param.value, 7)
            rows.append((label if i == 0 else "", name, value, _sigma(param), model.unit_of(effect, name)))
    fit = model.fit or {}
    note = "No σ: not fitted." if model.fit is None else ""
    if "cost_per_dof" in fit:
        note = f"Cost per degree of freedom {fit['cost_per_dof']:.4g}: 1 when only noise is left."
    return _Table("Plant", ("Effect", "Parameter", "Value", "σ", "Unit"), rows, note)


def _sigma(param: Param) -> str:
    if not param.free:
        return "fixed"
    if param.std is None:
        return ""
    return _number(param.std, 2) if np.isfinite(param.std) else "not determined"


def _ranking_tables(diagnosis: Diagnosis) -> list[_Table]:
    """One table for each round of the search that tried effects."""
    tables = []
    for number, step in enumerate(diagnosis.steps, 1):
        rows = [
            (
                " or ".join(group.effects),
                f"{100 * group.probability:.1f} %",
                f"{group.candidates[0].fit.cost_per_dof:.4g}",
                _strength(group),
            )
            for group in step.ranking[:RANKED]
        ]
        if rows:
            title = "Which effect" if number == 1 else f"Which effect, round {number}"
            head = ("Effect", "Probability", "Cost per d.o.f. with it", "Fitted")
            tables.append(_Table(title, head, rows, f"Without it: {step.fit.cost_per_dof:.4g}."))
    if tables and diagnosis.next_experiment:
        note = f"{tables[-1].note} {diagnosis.next_experiment}"
        tables[-1] = _Table(tables[-1].title, tables[-1].head, tables[-1].rows, note)
    return tables


def _strength(group: Group) -> str:
    best = group.candidates[0]
    effect = best.fit.model.effects[-1]
    return "; ".join(
        f"{name} {plots.with_interval(p.value, p.std)} {best.fit.model.unit_of(effect, name)}"
        for name, p in best.params.items()
    )


def _failing_tables(c: Comparison | None) -> list[_Table]:
    if c is None:
        return []
    rows = [
        (
            plots.band_text(band["f_lo_hz"], band["f_hi_hz"]),
            band["lines"],
            f"{100.0 * band['share']:.1f} %",
            f"{band['db']:.1f} dB".replace("-", "−"),
            "< 0.0001" if band["p_value"] < 1e-4 else _number(band["p_value"], 2),
        )
        for band in sorted(c.where, key=lambda band: -band["share"])
    ]
    note = (
        "Largest share of the excess first." if rows else "In no band is the error more than noise explains."
    )
    head = ("Band", "Lines", "Share", "Error over response", "p")
    return [_Table("Where the model fails", head, rows, note)]


# --- pictures ---------------------------------------------------------------------------------------------

_ESTIMATORS_NOTE = (
    "Errors are root mean squares over the lines, from the measured response; the cost is that of maximum "
    "likelihood (eq. 7.28), whatever the method minimised."
)

_CAPTIONS = {
    "Estimators": "Where only noise is left, errors stay below the bound; linear least squares is weak at "
    "low frequencies, and maximum likelihood spends its errors where the noise is.",
    "Excitation": "One period in time and its lines: a crest factor near 1.4 puts the most power into a "
    "limited command.",
    "Periods": "Settled periods repeat; what differs from their mean is noise, and the transient has to be "
    "at its level before the first period that is used.",
    "Frequency response": "The response and, in the same dB, the standard deviation of its noise: the "
    "distance between the two is the signal-to-noise ratio of every line.",
    "Measured and fitted": "Where the model is right it runs through the measured points; bars and band are "
    "95 % intervals, point by point.",
    "Complex residual": "The distance between measurement and model in the complex plane: where only noise "
    "is left, 5 % of the points lie above the bound, spread evenly.",
    "Poles and zeros": "Dotted rays are equal damping, circles equal frequency; each close-up shows the "
    "region in which the root lies with 95 % confidence.",
    "Where it fails": "The error of the model as it was, its free parameters fitted, beside the noise, for "
    "lines that were excited and for those that were not.",
    "Torque that is missing": "The error taken back through the model, averaged over places of equal rate, "
    "angle, command or time; positive drives forwards. A curve far off 0, for its band of ±2 σ, is a hint at "
    "the law that is missing.",
    "With what was found": "The same with the effects found: where they are right only noise is left.",
    "Ladder": "Every step is fitted on some of the data and judged on the rest: an effect that is there "
    "brings the error on data not fitted down to the noise, one that is not leaves it where it was.",
    "Comparison at the output": "The model's error beside the noise: an excess at lines that were not "
    "excited can only be nonlinear, one at excited lines is nonlinear or a linear effect left out.",
    "Noise and distortion": "Above, the response with its uncertainty by noise alone, which averaging "
    "lowers, and by noise and distortion together; below, the output at the lines that are excited and at "
    "those that are not.",
}


def _pictures(
    record, all_spectra, frf, model, comparison, multisine
) -> list[tuple[str, Callable[[], Figure]]]:
    """Title and drawing of each picture there is data for, in the order of reading."""
    spectra = all_spectra[0] if all_spectra else None
    u_unit = next((s.u_unit for s in (frf, spectra) if s is not None), "")
    is_rational = model is not None and not isinstance(model, PlantModel)
    has_fit = frf is not None and is_rational
    of_plant = _plant_pictures(model, all_spectra, frf) if isinstance(model, PlantModel) else []
    has_roots = is_rational and len(model.poles) + len(model.zeros) > 0
    pictures = [
        ("Excitation", multisine or spectra, lambda: plots.excitation(multisine or spectra, u_unit)),
        ("Periods", record and spectra, lambda: plots.periods(record, spectra)),
        ("Frequency response", frf, lambda: plots.frf(frf)),
        ("Measured and fitted", has_fit, lambda: plots.bode(model, frf)),
        ("Complex residual", has_fit, lambda: plots.residual(model, frf)),
        *((title, True, draw) for title, draw in of_plant),
        ("Poles and zeros", has_roots, lambda: plots.pole_zero(model)),
        ("Comparison at the output", comparison, lambda: plots.comparison(comparison)),
    ]
    return [(title, draw) for title, needed, draw in pictures if needed]


def _plant_pictures(
    model: PlantModel, measured: Sequence[Spectra], frf: Frf | None
) -> list[tuple[str, Callable[[], Figure]]]:
    pictures = []
    if frf is not None and measured:
        g = np.mean([model.predict(s).Y[frf.line] / s.u[frf.line] for s in measured], axis=0)
        pictures.append(("Measured and fitted", lambda: plots.bode_of_plant(frf, g)))
        pictures.append(("Complex residual", lambda: plots.residual_of_plant(frf, g)))
    steps = ladder(model)
    if steps.rungs:
        pictures.append(("Ladder", lambda: plots.ladder(steps)))
    return pictures


_LONG_NUMBER = re.compile(r"(\d\.\d\d)\d+")  # a hundredth of a point is below any printer's resolution


def _inline_svg(figure: Figure, prefix: str, title: str) -> Markup:
    """SVG element to stand in a page: no prologue, no fixed size, and ids that no other picture has."""
    text = io.StringIO()
    with matplotlib.rc_context(plots.STYLE):
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{prefix}", svg)
    svg = re.sub(r'\b(?:d|x|y)="[^"]*"', lambda found: _LONG_NUMBER.sub(r"\1", found[0]), svg)
    svg = re.sub(r'(<svg\b[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg\b[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    return Markup(
        svg.replace("<svg", f'<svg role="img" aria-label="{escape(title)}. {escape(_CAPTIONS[title])}"', 1)
    )


# --- provenance -------------------------------------------------------------------------------------------


def _command_line() -> str:
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


def _versions() -> list[tuple[str, str]]:
    def library(name: bytes) -> str:
        return ffi.string(lib.gsid_build_library_version(name)).decode() or "left out of this build"

    return [
        ("gsid", version()),
        ("Python", platform.python_version()),
        ("numpy", np.__version__),
        ("FFTW", library(b"fftw")),
        ("NLopt", library(b"nlopt")),
        ("SuiteSparse", library(b"suitesparse")),
        ("Platform", platform.platform()),
    ]
