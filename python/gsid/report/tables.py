"""Tables of a report: the model, its roots and parameters, the ranking of effects, and failing bands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gsid import plots
from gsid.base.tables import Table
from gsid.greybox.fit import COST_MEANS
from gsid.models.confidence import NORMAL_95, root_quantities
from gsid.models.piecewise import PiecewiseModel
from gsid.plant.effect import Param
from gsid.plant.model import PlantModel

if TYPE_CHECKING:
    from gsid.comparison import Comparison
    from gsid.diagnosis.from_records.result import Diagnosis
    from gsid.models.rational import RationalModel
    from gsid.response.distortion import DistortedBand

ESTIMATORS_NOTE = (
    "Errors are root mean squares over the lines, from the measured response; the cost is that of maximum "
    "likelihood (eq. 7.28), whatever the method minimised."
)


@dataclass(frozen=True)
class Truth:
    """A quantity with known true value, and its estimate.

    Attributes
    ----------
    name, unit : str
    truth, estimate, std : float
        std is the standard deviation of the estimate, in the same unit.
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


def _number(value: float, digits: int = 6) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value:.{digits}g}".replace("-", "−")


def model_tables(
    model: RationalModel | PiecewiseModel | PlantModel | None, truth: Sequence[Truth] | None
) -> list[Table]:
    """Tables of a model; the first one compares it with the true values, if they are known."""
    tables = []
    if truth:
        tables.append(truth_table(truth))
    if isinstance(model, PlantModel):
        tables.append(plant_table(model))
    elif isinstance(model, PiecewiseModel):
        note = "A jump is the discontinuity of the response at the boundary to the piece below."
        tables.append(replace(model.table(), title="Models of adjoining bands", note=note))
    elif model is not None:
        tables += [_fit_table(model), _root_table(model), _parameter_table(model)]
    return tables


def distortion_table(bands: Sequence[DistortedBand]) -> Table:
    """Whether noise or distortion limits the accuracy in each band."""
    rows = []
    for band in bands:
        low, high = (f"{db:.0f}".replace("-", "−") for db in (band.low_db, band.high_db))
        size = "" if band.kind == "noise" else low if low == high else f"{low} to {high}"
        kind = "noise" if band.kind == "noise" else f"{band.kind} distortion"
        rows.append((plots.band_text(band.f_lo_hz, band.f_hi_hz), kind, size))
    note = "Averaging over more periods lowers the noise only."
    head = ("Band", "Dominant", "Above noise [dB]")
    return Table(head, rows, title="Noise and distortion", note=note)


def truth_table(truth: Sequence[Truth]) -> Table:
    """Quantities with known true values, and their estimates."""
    rows = [
        (t.name, t.unit, _number(t.truth), _number(t.estimate), _number(t.std, 2), _signed(t.n_sigma))
        for t in truth
    ]
    head = ("Quantity", "Unit", "Truth", "Estimate", "σ", "Difference [σ]")
    note = "Within ±2 σ in 95 of 100 cases if the model is correct."
    return Table(head, rows, title="True and estimated values", note=note)


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−") if np.isfinite(value) else ""


def _fit_table(m: RationalModel) -> Table:
    delay = plots.delay_text(m.delay_s, m.fs_hz, m.std_delay_s)
    rows = [
        ("Order (poles/zeros)", f"{plots.order_text(m)} in {m.domain}"),
        ("Delay", f"{delay}, {'free' if m.free_delay else 'given'}"),
        ("Poles", "all stable" if m.stable else "not all stable"),
        ("Parameters", f"{m.n_parameters} free"),
    ]
    if m.hold == "zoh":
        rows.append(("Input", "held over each sample; the model does not include the hold"))
    if m.method is not None:
        rows.append(("Method", f"{m.method}, {'converged' if m.converged else 'not converged'}"))
    if m.band_hz is not None:
        rows.append(("Lines", f"{m.n_lines} in {plots.band_text(*m.band_hz)}"))
    if m.cost is not None:
        expected = f", {_number(m.cost_expected, 5)} expected of noise alone" if m.cost_expected else ""
        rows.append(("Cost", f"{_number(m.cost, 5)}{expected}"))
    errors = "noise only" if m.cov_noise is None else "the errors that the fit left"
    note = f"Intervals are 95 % and include {errors}. They are valid if the model is adequate."
    return Table((), rows, title="Fitted model", note=note)


def _root_table(m: RationalModel) -> Table:
    rows = []
    for kind, roots, covs in (("pole", m.poles, m.pole_cov), ("zero", m.zeros, m.zero_cov)):
        for root, cov in sorted(zip(roots, covs, strict=True), key=lambda pair: abs(pair[0])):
            if root.imag >= -1e-9 * abs(root):
                rows.append(_root_row(kind, root, cov, m))
    where = "s / 2π [Hz]" if m.domain == "s" else "z"
    head = ("", where, "Frequency [Hz]", "Damping ratio", "Time constant [ms]")
    note = "One root of each conjugate pair. Intervals are 95 %." if rows else "No poles and no zeros."
    return Table(head, rows, title="Poles and zeros", note=note)


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


def _parameter_table(m: RationalModel) -> Table:
    rows = []
    for name, values, stds in (("numerator", m.num, m.std_num), ("denominator", m.den, m.std_den)):
        powers = range(len(values) - 1, -1, -1) if m.domain == "s" else range(0, -len(values), -1)
        for power, value, std in zip(powers, values, stds, strict=True):
            rows.append((f"{name}, {m.domain}{_superscript(power)}", _number(value, 8), *_spread(value, std)))
    rows.append(("delay [s]", _number(m.delay_s, 8), *_spread(m.delay_s, m.std_delay_s)))
    note = "No σ: not estimated." + (" Frequencies in rad/s." if m.domain == "s" else "")
    return Table(("Parameter", "Estimate", "σ", "σ [%]"), rows, title="Parameters", note=note)


def _spread(value: float, std: float) -> tuple[str, str]:
    if std is None or not std > 0.0:
        return "", ""
    return _number(std, 3), _number(100.0 * std / abs(value), 2) if value else ""


def _superscript(power: int) -> str:
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def plant_table(model: PlantModel) -> Table:
    """The effects of a plant with their parameters."""
    rows = []
    for label, effect in model.labels():
        for i, (name, param) in enumerate(effect.params.items()):
            value = _number(param.value, 7)
            row = (label if i == 0 else "", name, value, _sigma(param), model.unit_of(effect, name))
            rows.append((*row, *model.torques_of(effect, name)))
    fit = model.fit or {}
    note = "No σ: not fitted." if model.fit is None else ""
    if "cost_per_dof" in fit:
        means = COST_MEANS[fit.get("method", "ml")]
        note = f"Cost per degree of freedom {fit['cost_per_dof']:.4g}: {means}."
    head = ("Effect", "Parameter", "Value", "σ", "Unit", *model.torque_head)
    return Table(head, rows, title="Plant", note=note)


def _sigma(param: Param) -> str:
    if not param.free:
        return "fixed"
    if param.std is None:
        return ""
    return _number(param.std, 2) if np.isfinite(param.std) else "not determined"


def ranking_tables(diagnosis: Diagnosis) -> list[Table]:
    """The ranking of the laws."""
    if not diagnosis.ranking:
        return []
    note = f"Without a law: {diagnosis.cost_per_dof:.4g}. {diagnosis.next_experiment}".rstrip()
    return [replace(diagnosis.table(), title="Which effect", note=note)]


def failing_tables(c: Comparison | None) -> list[Table]:
    """Bands in which a model fails."""
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
        "Largest share of the excess first." if rows else "The error does not exceed the noise in any band."
    )
    head = ("Band", "Lines", "Share", "Error over response", "p")
    return [Table(head, rows, title="Bands with an excess", note=note)]
