"""Comparison of all estimators on the same response (thesis, section 7.10)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gsid.base.bands import in_band
from gsid.base.errors import GsidError
from gsid.base.plottable import Plottable
from gsid.base.tables import Table
from gsid.fitting.rational import METHODS, fit, initial_delay
from gsid.fitting.validation import HELD_OUT, Validation, held_out_text, validate
from gsid.response.frf import Frf

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.models.rational import RationalModel


@dataclass(frozen=True)
class Estimate:
    """Result of one estimator.

    Attributes
    ----------
    method : str
    model : RationalModel or None
        None if the fit failed; `note` contains the reason.
    amplitude_db, phase_deg, error_db : float
        Rms errors over the lines: of the amplitude [dB], of the phase [deg], and of the complex error
        relative to the response [dB] (-26 dB is 5 %).
    cost : float
        V of eq. 7.28 for all methods except "ml-io", for which it is V of eq. 7.26. `Estimators` contains
        the value expected from noise alone.
    seconds : float
        Computing time [s].
    note : str
        "" if the estimator converged to a stable model.
    held_out : Validation or None
        Validation on the held-out response, if given.
    """

    method: str
    model: RationalModel | None
    amplitude_db: float
    phase_deg: float
    error_db: float
    cost: float
    seconds: float
    note: str
    held_out: Validation | None = None


@dataclass(frozen=True, repr=False)
class Estimators(Plottable):
    """Results of all estimators, as in the table of section 7.10 of the thesis.

    Attributes
    ----------
    rows : tuple of Estimate
    order : str
    initial_delay_s : float
        Delay from the slope of the phase (eq. 7.8) [s].
    n_lines : int
    cost_expected : float or None
        Cost of "ml" expected from noise alone.
    """

    rows: tuple[Estimate, ...]
    order: str
    initial_delay_s: float
    n_lines: int
    cost_expected: float | None

    def __getitem__(self, method: str) -> Estimate:
        for row in self.rows:
            if row.method == method:
                return row
        raise KeyError(method)

    def best(self) -> Estimate:
        """Return the stable, converged estimate of least cost.

        "ml-io" is not compared, because its cost has another definition. If noise biases the estimate of
        least cost, the result is that of the method that its warning recommends.

        Raises
        ------
        ValueError
            No estimator converged to a stable model.
        """
        good = [row for row in self.rows if not row.note and row.method != "ml-io"]
        if not good:
            raise ValueError("no estimator converged to a stable model")
        least = min(good, key=lambda row: row.cost)
        right = [warning.use for warning in least.model.warnings]
        return next((row for row in self.rows if row.method in right and not row.note), least)

    def table(self) -> Table:
        """Return a row for each method."""
        head = [
            "method",
            "amplitude [dB]",
            "phase [deg]",
            "error [dB]",
            "cost",
            "time [ms]",
            "delay [ms]",
            *HELD_OUT,
            "",
        ]
        rows = [_text(row) for row in self.rows]
        return Table(head, rows, left=["method", ""]).without_empty(HELD_OUT)

    def plot(self, frf: Frf) -> Figure:
        """Draw the errors of every estimator over frequency, beside the measured response `frf`."""
        return self._figure(frf)

    def __repr__(self) -> str:
        return f"Estimators of order {self.order}, {self.n_lines} lines\n{self.table().text()}"

    def _repr_html_(self) -> str:
        return self.table().html()


def fit_all(
    frf: Frf,
    order: str | tuple[int, int] = "4/3",
    *,
    methods: Sequence[str] = tuple(METHODS),
    reference: np.ndarray | None = None,
    band: tuple[float, float] | None = None,
    held_out: Frf | None = None,
    **options: object,
) -> Estimators:
    """Fit with several estimators and compare the results (thesis, section 7.10).

    Parameters
    ----------
    frf : Frf
    order : "POLES/ZEROS" or (poles, zeros)
    methods : sequence of str
        Names from `gsid.fitting.rational.METHODS`.
    reference : (F,) complex array_like, optional
        True response at the lines of the band, if known. The errors refer to it; default: the measured
        response.
    band : (lo, hi), optional
        Lines to use [Hz].
    held_out : Frf, optional
        Response of held-out realisations, on which every model is validated (`gsid.fitting.validation`).
    **options
        Further arguments of `fit`.

    Returns
    -------
    Estimators
        If the best model of a method is unstable, the row contains this model and a note.

    Raises
    ------
    ValueError
        An argument is invalid.
    """
    frf, options = _one_variance(frf, order, {**options, "band": band})
    use = in_band(frf.f_hz, band)
    measured = frf.g[use] if reference is None else np.asarray(reference, complex)
    if measured.shape != (np.count_nonzero(use),):
        raise ValueError(
            f"reference has shape {measured.shape}; the band contains {np.count_nonzero(use)} lines"
        )
    rows = tuple(_estimate(frf, order, method, frf.f_hz[use], measured, options) for method in methods)
    if held_out is not None:
        rows = tuple(
            row if row.model is None else replace(row, held_out=validate(row.model, held_out)) for row in rows
        )
    by_ml = [row.model for row in rows if row.method == "ml" and row.model is not None]
    return Estimators(
        rows=rows,
        order=order if isinstance(order, str) else f"{order[0]}/{order[1]}",
        initial_delay_s=initial_delay(frf, band),
        n_lines=len(measured),
        cost_expected=by_ml[0].cost_expected if by_ml else None,
    )


def _one_variance(frf: Frf, order, options: dict) -> tuple[Frf, dict]:
    """The same variance for every method, so that their costs compare: that of maximum likelihood."""
    if frf.var_total is None or options.get("relative_error") is not None:
        return frf, options
    try:
        weights = fit(frf, order, quiet=True, **options).weights
    except GsidError:
        weights = "noise"
    if weights == "noise":
        return replace(frf, var_total=None), options
    return frf, options | {"relative_error": 0.0}


def _estimate(frf: Frf, order, method: str, f_hz, reference, options: dict) -> Estimate:
    began = time.perf_counter()
    model, note = None, ""
    try:
        model = fit(frf, order, method=method, quiet=True, **options)
        note = "" if model.converged else "not converged"
    except GsidError as error:
        note = str(error)
        try:  # show the unstable model
            unstable = {**options, "allow_unstable": True, "quiet": True}
            model = fit(frf, order, method=method, **unstable)
            note = "UNSTABLE"
        except GsidError:
            pass
    seconds = time.perf_counter() - began
    if model is None:
        return Estimate(method, None, np.nan, np.nan, np.nan, np.nan, seconds, note)
    ratio = model.response(f_hz) / reference
    return Estimate(
        method=method,
        model=model,
        amplitude_db=_rms(20 * np.log10(np.abs(ratio))),
        phase_deg=_rms(np.degrees(np.angle(ratio))),
        error_db=float(20 * np.log10(_rms(np.abs(ratio - 1)))),
        cost=float(model.cost),
        seconds=seconds,
        note=note,
    )


def bootstrap(model: RationalModel, frf: Frf, *, n: int = 200, seed: int = 0) -> np.ndarray:
    """Standard deviations of the parameters by a parametric bootstrap, to check the covariance.

    Parameters
    ----------
    model : RationalModel
        Model fitted to `frf`.
    frf : Frf
        Measured response. Its lines and variances define the noise that is added to the model's response.
    n : int
        Number of responses to draw.
    seed : int
        Random seed of the bootstrap.

    Returns
    -------
    (p,) ndarray
        Standard deviations of (den[1:], num, delay if free), in the order of `model.cov`.

    Raises
    ------
    ValueError
        The model was not fitted, or n is less than 2.
    """
    if model.method is None or model.cov is None or n < 2:
        raise ValueError("a bootstrap needs a fitted model and at least two responses")
    rng = np.random.default_rng(seed)
    use = in_band(frf.f_hz, model.band_hz)
    g = model.response(frf.f_hz[use])
    nothing = np.zeros(len(g))
    parameters = []
    for _ in range(n):
        noise = (rng.standard_normal(len(g)) + 1j * rng.standard_normal(len(g))) / np.sqrt(2)
        drawn = replace(
            Frf.from_arrays(
                frf.f_hz[use], g + np.sqrt(frf.var_g[use]) * noise, frf.var_g[use], fs_hz=frf.fs_hz
            ),
            u=np.abs(frf.u[use]) + 0j,
            var_u=nothing,
            hold=frf.hold,
        )
        one = fit(
            drawn,
            (model.n_poles, model.n_zeros),
            method=model.method,
            delay="free" if model.free_delay else model.delay_s,
            domain=model.domain,
            hold=model.hold,
            start=None if model.method in ("ls", "iwls", "ga") else model,
            allow_unstable=True,
            quiet=True,
        )
        parameters.append([*one.den[1:], *one.num, *([one.delay_s] if model.free_delay else [])])
    return np.std(parameters, axis=0, ddof=1)


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def _text(row: Estimate) -> list[str]:
    numbers = [f"{row.amplitude_db:.3g}", f"{row.phase_deg:.3g}", f"{row.error_db:.1f}", f"{row.cost:.5g}"]
    delay = "-" if row.model is None else f"{1e3 * row.model.delay_s:.4g}"
    warnings = () if row.model is None else row.model.warnings
    remarks = "; ".join(filter(None, [row.note, *(warning.short for warning in warnings)]))
    return [row.method, *numbers, f"{1e3 * row.seconds:.0f}", delay, *held_out_text(row.held_out), remarks]
