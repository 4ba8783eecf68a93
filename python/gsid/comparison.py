"""Test whether a model is adequate, and locate the bands where it is not.

At each line the output error of period p is E[p] = Y[p] - G U[p]. A plant is not linear; its error is Y[p]
minus its periodic response to the mean input, and its scatter is that of Y alone. `gsid.models.misfit` tests
the mean over the P periods against its sample variance s^2 / P, which has nu = P - 1 degrees of freedom
(CMP-1). If the output drifts, it scatters more from period to period than its mean. If the input repeats, s^2
is therefore estimated between the lines (`gsid.spectrum.lines.variance_between_lines`).

A model that was fitted to other records contains their noise, so that the test includes its covariance. If
the model was fitted to the same records (`fitted`), each parameter reduces the degrees of freedom by
nu / (nu + 1) instead.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.bands import in_band
from gsid.base.hold import fit_readings, likelier
from gsid.base.plottable import Plottable
from gsid.base.tables import Table, paragraphs
from gsid.greybox.problem import least_size
from gsid.greybox.settings import SETTINGS
from gsid.greybox.weights import lines_used
from gsid.models.misfit import Errors
from gsid.models.rational import half_of
from gsid.models.sample_rate import at_rate_of
from gsid.plant.mean_input import with_mean_input
from gsid.plant.model import PlantModel, transport_delay_s
from gsid.plant.units import check_units
from gsid.spectrum.pooling import for_weights
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra, is_open, read_as

if TYPE_CHECKING:
    from gsid.models.piecewise import PiecewiseModel
    from gsid.models.rational import RationalModel
    from gsid.records.record import Record

_log = logging.getLogger(__name__)

KINDS = ("excited", "odd", "even")  # in the order of gsid_line_kind


@dataclass(eq=False, repr=False)
class Comparison(Plottable):
    """Result of :func:`compare`.

    Parameters
    ----------
    adequate : bool
        True if the test of the whole band does not reject the model at level `alpha`.
    p_value : float
        Probability of a misfit this large or larger if the model is correct; 0 below 1e-323.
    log10_p_value : float
        Decimal logarithm of that probability, which remains finite.
    alpha : float
        False-alarm rate of the test.
    cost_per_dof : float
        Misfit over its mean for a correct model; 1 on average if the model is correct.
    rms_error, noise_floor_rms, model_uncertainty_rms : float
        Rms error of the mean output in the band, the part that noise alone causes, and the part that the
        covariance of the model causes on average; in units of the output.
    model_uncertainty : {"included", "none", "fitted"}
        How the test treats the uncertainty of the model. "included": by its covariance. "none": the model has
        no covariance and is treated as exact. "fitted": the model was fitted to these records.
    where : list of dict
        Bands in which the model fails, sorted by share of the excess: f_lo_hz, f_hi_hz, lines ("excited",
        "odd", "even"), share (of the excess cost), p_value and log10_p_value (of the band, corrected for the
        number of bands), db (error over response of the whole band).
    line, f_hz, kind : (k,) ndarrays
        Line number, frequency [Hz], and kind of the line: "excited", or the detection lines "odd" and "even".
    error, y : (k,) complex ndarrays
        Mean output minus model output, and mean output, of the record with the largest output.
    sigma, sigma_model : (k,) ndarray
        Standard deviation of that error for a correct model, and the part that the uncertainty of the model
        causes.
    n_dof : int
        Degrees of freedom of the noise variance, sigma^2 - sigma_model^2: number of good periods of that
        record minus one.
    cost : (k,) ndarray
        T averaged over the records, for the error that remains after the best change of the model within its
        uncertainty.
    n_periods, n_records : int
        Total number of good periods, and number of records.
    deviance : float
        -2 log likelihood apart from a constant: twice the sum of T over all lines.
    hold : {"zoh", "none"} or None
        Assumed course of the input between the samples; None if the records state different holds.
    hold_assumed : bool
        True if the records do not state their hold. `hold` is then the one with which the model is adequate,
        or the likelier if the test gives the same result for both.
    other_delay_s : float or None
        Delay of the model [s] with the other hold. It comes from the fit if the hold was assumed there too;
        otherwise it differs by half a sample. None if the hold is stated or the model has no delay.
    delay_hold_uncertainty_s : float or None
        Difference of the delay between the two holds [s].
    """

    adequate: bool
    p_value: float
    log10_p_value: float
    alpha: float
    cost_per_dof: float
    rms_error: float
    noise_floor_rms: float
    model_uncertainty_rms: float
    model_uncertainty: str
    where: list[dict[str, Any]]
    line: np.ndarray
    f_hz: np.ndarray
    kind: np.ndarray
    error: np.ndarray
    y: np.ndarray
    sigma: np.ndarray
    sigma_model: np.ndarray
    n_dof: int
    cost: np.ndarray
    n_periods: int
    n_records: int
    y_unit: str = ""
    names: list[str] = field(default_factory=list)
    deviance: float = 0.0
    hold: str | None = None
    hold_assumed: bool = False
    other_delay_s: float | None = None
    delay_hold_uncertainty_s: float | None = None

    @property
    def verdict(self) -> str:
        """The result in one or two sentences."""
        if self.model_uncertainty != "none":
            return self._verdict
        return f"{self._verdict} The model has no covariance: it is judged as if it were known exactly."

    @property
    def _verdict(self) -> str:
        floor = f"{self.noise_floor_rms:.3g} {self.y_unit}".rstrip()
        size = f"rms error {self.rms_error:.3g} where noise alone leaves {floor}"
        if self.model_uncertainty == "included":
            size += f" and the model's uncertainty {self.model_uncertainty_rms:.3g}"
        if self.adequate:
            rate = f"p = {self.p_value:.2g} at a false-alarm rate of {self.alpha:g}"
            return f"Adequate: only noise remains ({size}; {rate})."
        if not self.where:
            p = f"p = {self.p_value:.2g}" if self.p_value > 0 else f"p = 1e{self.log10_p_value:.0f}"
            return f"Not adequate: {size}; the excess is spread over the whole band ({p})."
        worst = self.where[0]
        lines = "excited lines" if worst["lines"] == "excited" else f"{worst['lines']} detection lines"
        band = f"{worst['f_lo_hz']:.3g} to {worst['f_hi_hz']:.3g} Hz"
        share = f"{100 * worst['share']:.0f} % of the excess lies at {band} on {lines}"
        return f"Not adequate: {size}; {share} (cost {self.cost_per_dof:.3g} times that of noise)."

    def to_dict(self) -> dict[str, Any]:
        """The values of `gsid compare --json`."""
        keys = (
            "adequate",
            "p_value",
            "log10_p_value",
            "alpha",
            "cost_per_dof",
            "rms_error",
            "noise_floor_rms",
            "model_uncertainty_rms",
            "model_uncertainty",
            "where",
            "n_periods",
            "hold",
            "hold_assumed",
            "delay_hold_uncertainty_s",
        )
        return {key: getattr(self, key) for key in keys} | {
            "n_realisations": self.n_records,
            "sentence": self.verdict,
        }

    def __repr__(self) -> str:
        lines = [self.verdict]
        for band in self.where:
            lines.append(
                f"  {band['f_lo_hz']:8.4g} to {band['f_hi_hz']:8.4g} Hz  {band['lines']:8}  "
                f"{100 * band['share']:5.1f} % of the excess  {band['db']:6.1f} dB of the response"
            )
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head = ("band [Hz]", "lines", "share of excess [%]", "error / response [dB]")
        rows = [
            (
                f"{band['f_lo_hz']:.4g} to {band['f_hi_hz']:.4g}",
                band["lines"],
                f"{100 * band['share']:.1f}",
                f"{band['db']:.1f}",
            )
            for band in self.where
        ]
        return paragraphs(self.verdict) + (Table(head, rows).html() if rows else "")


@dataclass
class _Lines:
    """Lines of one record in the band."""

    line: np.ndarray
    f_hz: np.ndarray
    kind: np.ndarray
    y: np.ndarray
    errors: Errors


def compare(
    model: RationalModel | PiecewiseModel | PlantModel,
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
    band: tuple[float, float] | None = None,
    alpha: float = 0.05,
    fitted: bool = False,
) -> Comparison:
    """Test a model against measurements and show where it fails (CMP-1, CMP-2).

    Parameters
    ----------
    model : RationalModel, PiecewiseModel or PlantModel
    records : Record or Spectra, or a sequence of them
        One or more realisations, each with at least two good periods.
    period, settle : int, optional
        Samples per period, and samples discarded at the start; default: as stated in the record or detected.
    band : (lo, hi), optional
        Band [Hz]; default from the first to the last excited line, for a plant as in `gsid.fit_plant`.
    alpha : float
        False-alarm rate of the test.
    fitted : bool
        Whether the free parameters were fitted to these records in this band. The test of the whole band then
        uses the number of parameters; the tests of single bands have a lower false-alarm rate than `alpha`.
        By default the model was fitted to other records, and the test includes its covariance. A model
        without covariance is treated as exact.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        The band contains no line, or alpha is not between 0 and 1.
    TypeError
        An argument is not a model or not a record.
    InputError
        A record has fewer than two good periods or no period, its units differ from those of the model, or a
        model in z has another sample rate.
    GsidError
        The plant cannot be simulated.

    Notes
    -----
    Records that do not state their hold are compared with both holds: see `Comparison.hold_assumed`.
    """
    if not 0 < alpha < 1:
        raise ValueError(f"alpha must be between 0 and 1, got {alpha}")
    measured = spectra_of(records, period=period, settle=settle)
    check_model(model)
    if isinstance(model, PlantModel) and not fitted:
        _warn_of_undetermined(model)
    if depends_on_hold(model) and is_open(measured):
        return _either(model, measured, lambda one, read: _compared(one, read, band, alpha, fitted=fitted))
    return _compared(model, measured, band, alpha, fitted=fitted)


def check_model(model: object) -> None:
    """Refuse what is not a model.

    Raises
    ------
    TypeError
        It is something else, for example the name of a file.
    """
    if not isinstance(model, PlantModel) and not hasattr(model, "response"):
        raise TypeError(f"model must be a gsid model, as returned by load_model, got {type(model).__name__}")


def depends_on_hold(model: RationalModel | PiecewiseModel | PlantModel) -> bool:
    """Whether the hold matters. The reference of a loop is always held; a model in z includes its hold.

    Parameters
    ----------
    model : RationalModel, PiecewiseModel or PlantModel
    """
    if isinstance(model, PlantModel):
        return not model.has_controller
    return getattr(model, "pieces", (model,))[0].domain == "s"


def _either(
    model: RationalModel | PiecewiseModel | PlantModel,
    measured: list[Spectra],
    compared: Callable[[Any, list[Spectra]], Comparison],
) -> Comparison:
    """Compare with both holds. Use the one with which the model is adequate, otherwise the likelier."""
    cases = fit_readings(lambda reading: compared(behind_hold(model, reading), read_as(measured, reading)))
    adequate = [reading for reading, case in cases.items() if case.adequate]
    likeliest = likelier({reading: case.deviance for reading, case in cases.items()})
    taken = adequate[0] if len(adequate) == 1 else likeliest
    case, half = cases[taken], 0.5 / measured[0].fs_hz
    case.hold, case.hold_assumed, case.delay_hold_uncertainty_s = taken, True, half
    delay_s = transport_delay_s(model) if isinstance(model, PlantModel) else getattr(model, "delay_s", None)
    if delay_s is not None:
        fitted = (model.fit or {}) if isinstance(model, PlantModel) else vars(model)
        other = fitted.get("other_delay_s") if fitted.get("hold") == taken else None
        case.other_delay_s = delay_s + (half if taken == "zoh" else -half) if other is None else other
        case.delay_hold_uncertainty_s = abs(delay_s - case.other_delay_s)
    return case


def behind_hold(model: RationalModel | PiecewiseModel | PlantModel, hold: str) -> Any:
    """The model for an input with this hold. A plant takes the hold from the records.

    Parameters
    ----------
    model : RationalModel, PiecewiseModel or PlantModel
    hold : {"zoh", "none"}
    """
    if isinstance(model, PlantModel):
        return model
    if hasattr(model, "pieces"):
        return replace(model, pieces=tuple(replace(piece, hold=hold) for piece in model.pieces))
    return replace(model, hold=hold)


def _compared(
    model: RationalModel | PiecewiseModel | PlantModel,
    measured: list[Spectra],
    band: tuple[float, float] | None,
    alpha: float,
    *,
    fitted: bool,
) -> Comparison:
    parts = [_lines(model, s, band, with_uncertainty=not fitted) for s in measured]
    found, where, ratio = _tested(parts, alpha, _n_parameters(model) if fitted else 0)
    ratios = np.split(ratio, np.cumsum([len(part.line) for part in parts])[:-1])
    shown = int(np.argmax([np.sum(np.abs(part.y) ** 2) for part in parts]))
    of = parts[shown]
    return Comparison(
        adequate=found.p_value >= alpha,
        p_value=found.p_value,
        log10_p_value=found.log_p_value / math.log(10),
        alpha=alpha,
        cost_per_dof=found.cost_per_dof,
        rms_error=found.rms_error,
        noise_floor_rms=found.noise_floor_rms,
        model_uncertainty_rms=found.model_uncertainty_rms,
        model_uncertainty="fitted" if fitted else "included" if has_covariance(model) else "none",
        where=where,
        line=of.line,
        f_hz=of.f_hz,
        kind=of.kind,
        error=of.errors.error,
        y=of.y,
        sigma=np.sqrt(of.errors.var_mean + of.errors.var_model),
        sigma_model=np.sqrt(of.errors.var_model),
        n_dof=measured[shown].n_periods - 1,
        cost=np.mean(ratios, axis=0) if _same_lines(parts) else ratios[shown],
        n_periods=sum(s.n_periods for s in measured),
        n_records=len(parts),
        y_unit=measured[0].y_unit,
        names=[s.name for s in measured],
        deviance=found.deviance,
        hold=_common_hold(model, measured),
    )


def _tested(parts: list[_Lines], alpha: float, n_fitted: int) -> tuple[Any, list[dict[str, Any]], np.ndarray]:
    """Test of all lines, `gsid_comparison`; bands that fail; ratio of each line (CMP-1, CMP-2)."""
    data, result = ffi.new("gsid_compare_data *"), ffi.new("gsid_comparison *")
    lines, kept = Errors.joined([part.errors for part in parts]).as_c()
    data.lines = lines[0]
    data.n_records, data.n_fitted = len(parts), n_fitted
    columns = {
        "n_of": ("uint32_t *", np.array([len(part.line) for part in parts], np.uint32)),
        "f_hz": ("double *", np.concatenate([part.f_hz for part in parts])),
        "kind": ("uint8_t *", _numbers_of_kinds(np.concatenate([part.kind for part in parts]))),
        "y": ("gsid_cplx *", np.concatenate([part.y for part in parts])),
    }
    for name, (kind, values) in columns.items():
        kept.append(ffi.from_buffer(values))
        setattr(data, name, ffi.cast(kind, kept[-1]))
    n = lines.n_lines
    bands, ratio = ffi.new("gsid_compare_band[]", n), np.empty(n)
    status = lib.gsid_compare(data, alpha, n, bands, ffi.from_buffer("double[]", ratio), result)
    check(status, "comparing a model with its measurement")
    return result, [_band(bands[i]) for i in range(result.n_bands)], ratio


def _numbers_of_kinds(kind: np.ndarray) -> np.ndarray:
    return np.array([KINDS.index(name) for name in kind], np.uint8)


def _band(band: Any) -> dict[str, Any]:
    return {
        "f_lo_hz": band.f_lo_hz,
        "f_hi_hz": band.f_hi_hz,
        "lines": KINDS[band.kind],
        "share": band.share,
        "p_value": band.p_value,
        "log10_p_value": band.log_p_value / math.log(10),
        "db": band.db,
    }


def _common_hold(model: RationalModel | PiecewiseModel | PlantModel, measured: list[Spectra]) -> str | None:
    is_loop = isinstance(model, PlantModel) and model.has_controller
    holds = {"zoh"} if is_loop else {one.hold for one in measured}
    return holds.pop() if len(holds) == 1 else None


def _n_parameters(model: RationalModel | PiecewiseModel | PlantModel) -> int:
    return len(model.free_names) if isinstance(model, PlantModel) else model.n_parameters


def _same_lines(parts: list[_Lines]) -> bool:
    return all(np.array_equal(part.line, parts[0].line) for part in parts)


def has_covariance(model: RationalModel | PiecewiseModel | PlantModel) -> bool:
    """Whether the covariance of a model covers all parameters that are free now.

    A parameter that was made free after the fit has no standard deviation and is not covered.
    """

    if isinstance(model, PlantModel):
        if any(model[name].std is None for name in model.free_names):
            return False
        covariances = [model.covariance]
    else:
        covariances = [piece.cov for piece in getattr(model, "pieces", (model,))]
    return all(cov is not None and bool(np.all(np.isfinite(cov))) for cov in covariances)


def _lines(
    model: RationalModel | PiecewiseModel | PlantModel,
    s: Spectra,
    band: tuple[float, float] | None,
    *,
    with_uncertainty: bool,
) -> _Lines:
    check_units(model, s)
    if isinstance(model, PlantModel):
        (s,) = with_mean_input([s], model)
        use = lines_used(model, s, band)
    else:
        model = at_rate_of(model, s)
        f_excited = s.f_hz[s.excited]
        inside = (s.line > 0) & (2 * s.line < s.period_samples)
        use = inside.copy()
        use[inside] = in_band(s.f_hz[inside], band if band is not None else (f_excited[0], f_excited[-1]))
    known_input = isinstance(model, PlantModel) or not np.any(s.U - s.U[0])
    answer, by_model = _answer(model, s, use, with_uncertainty and has_covariance(model))
    errors = s.Y[:, use] - answer
    variance, dof = s.noise_y[use] if known_input else np.var(errors, axis=0, ddof=1), s.n_periods - 1
    real = s.line[use] == 0
    for_weight = variance.copy()
    for_weight[~real] = for_weights(variance[~real], dof)
    return _Lines(
        line=s.line[use],
        f_hz=s.f_hz[use],
        kind=np.where(s.excited[use], "excited", np.where(s.line[use] % 2 == 1, "odd", "even")),
        y=s.Y[:, use].mean(axis=0),
        errors=Errors(
            error=errors.mean(axis=0),
            var_mean=variance / s.n_periods,
            dof=np.full(len(real), float(dof)),
            var_weight=for_weight / s.n_periods,
            real=real,
            by_model=by_model,
        ),
    )


def _answer(
    model: RationalModel | PiecewiseModel | PlantModel, s: Spectra, use: np.ndarray, with_uncertainty: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Output lines of the model, per period or common to all, and their change by its uncertainty."""
    none = np.zeros((int(np.count_nonzero(use)), 0), complex)
    if not isinstance(model, PlantModel):
        by_model = model.deviations(s.f_hz[use]) * s.u[use, None] if with_uncertainty else none
        return model.response(s.f_hz[use]) * s.U[:, use], by_model
    answer = model.predict(s, sensitivities=with_uncertainty)
    noise_rms = np.sqrt(np.sum(s.var_y[use]) / (2 * s.n_periods))
    if not answer.settled and answer.residual > SETTINGS.unsettled * noise_rms:
        _log.warning("no steady state was found for %s: do not trust this comparison", s.name)
    return answer.Y[use], answer.dY[:, use].T @ _plant_deviations(model) if with_uncertainty else none


def _plant_deviations(model: PlantModel) -> np.ndarray:
    """(n_free, r) one standard deviation of the parameters along each independent direction.

    A parameter that the fit did not determine has a standard deviation of its own size.
    """
    cov = np.array(model.covariance)
    for name in _undetermined(model):
        i = model.free_names.index(name)
        cov[i, i] += max(abs(model[name].value), least_size(model.parameter(name))) ** 2
    return half_of(cov)


def _undetermined(model: PlantModel) -> list[str]:
    """Free parameters that the fit did not determine, or estimated for each record separately."""
    own = {name for record in (model.fit or {}).get("per_record") or [] for name in record}
    stds = {name: model[name].std for name in model.free_names}
    return [name for name, std in stds.items() if name in own or (std is not None and np.isnan(std))]


def _warn_of_undetermined(model: PlantModel) -> None:
    found = _undetermined(model) if has_covariance(model) else []
    if found:
        text = "the fit does not determine %s for other records: the test allows a change by its own size"
        _log.warning(text, ", ".join(found))
