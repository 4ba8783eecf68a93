"""Test whether a model of several inputs and outputs is adequate, and locate where it is not (CMP-4).

At each line the errors of all outputs and experiments, Y - G U, are tested together against their joint
noise, which is correlated from output to output, and against the covariance of the model. No matrix of
responses is estimated: any number of experiments with any inputs will do.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from gsid.base.bands import in_band
from gsid.base.errors import InputError
from gsid.models.mimo_misfit import MimoErrors, MimoMisfit, mimo_misfit
from gsid.models.sample_rate import at_rate_of
from gsid.records.mimo import MimoRecord
from gsid.response.mimo import any_excited, channel_lines, require_same
from gsid.spectrum.lines import bins_between_lines

if TYPE_CHECKING:
    from gsid.models.mimo import MimoModel

KINDS = ("excited", "odd", "even")
DEPENDENT = 1e-10  # least eigenvalue of a correlation matrix: rounding leaves 1e-15
ALIKE = 10.0  # bands are joined if their mean excess per line differs by no more than this factor


@dataclass(frozen=True)
class OutputComparison:
    """Errors of one output.

    Attributes
    ----------
    name, unit : str
    p_value : float
        Of this output alone.
    rms_error, noise_floor_rms, model_uncertainty_rms : float
        Rms over the experiments of the error of the mean output in the band, and the parts that noise and
        the covariance of the model cause on average.
    """

    name: str
    unit: str
    p_value: float
    rms_error: float
    noise_floor_rms: float
    model_uncertainty_rms: float


@dataclass(frozen=True, repr=False)
class MimoComparison:
    """Result of :func:`compare_mimo`.

    Attributes
    ----------
    adequate : bool
        Whether the test of all outputs together does not reject the model at level `alpha`.
    p_value, alpha : float
        Probability of a misfit this large or larger if the model is correct, and false-alarm rate.
    cost_per_dof : float
        Misfit over its mean for a correct model.
    model_uncertainty : {"included", "none", "fitted"}
        As `Comparison.model_uncertainty`.
    outputs : list of OutputComparison
    where : list of dict
        Bands in which the model fails, as `Comparison.where`, each of one output: output, f_lo_hz, f_hi_hz,
        lines, share, p_value.
    n_lines, n_experiments, n_periods : int
    hold : {"zoh", "none"} or None
    hold_assumed : bool
        True if the records do not state their hold; it is then the one with the larger p-value.
    """

    adequate: bool
    p_value: float
    alpha: float
    cost_per_dof: float
    model_uncertainty: str
    outputs: list[OutputComparison]
    where: list[dict[str, Any]]
    n_lines: int
    n_experiments: int
    n_periods: int
    hold: str | None
    hold_assumed: bool = False

    @property
    def verdict(self) -> str:
        """The result in one or two sentences."""
        exact = " The model has no covariance: it is judged as if it were known exactly."
        end = exact if self.model_uncertainty == "none" else ""
        rate = f"p = {self.p_value:.2g} at a false-alarm rate of {self.alpha:g}"
        if self.adequate:
            return f"Adequate: only noise remains at the {len(self.outputs)} outputs ({rate}).{end}"
        if not self.where:
            return f"Not adequate: the excess is spread over all outputs and the whole band ({rate}).{end}"
        worst = self.where[0]
        band = f"{worst['f_lo_hz']:.3g} to {worst['f_hi_hz']:.3g} Hz"
        share = f"{100 * worst['share']:.0f} % of the excess lies at output {worst['output']}, {band}"
        return f"Not adequate ({rate}): {share}, {_kind_words(worst['lines'])}.{end}"

    def to_dict(self) -> dict[str, Any]:
        """The values of `gsid compare --json`."""
        keys = ("adequate", "p_value", "alpha", "cost_per_dof", "model_uncertainty", "where", "n_lines")
        keys += ("n_experiments", "n_periods", "hold", "hold_assumed")
        own = {key: getattr(self, key) for key in keys}
        return own | {"outputs": [vars(one) for one in self.outputs], "sentence": self.verdict}

    def __repr__(self) -> str:
        rows = [f"  {one.name}: p = {one.p_value:.2g}, error {one.rms_error:.3g}" for one in self.outputs]
        return "\n".join([self.verdict, *rows])


def compare_mimo(
    model: MimoModel,
    records: MimoRecord | Sequence[MimoRecord],
    *,
    band: tuple[float, float] | None = None,
    alpha: float = 0.05,
    fitted: bool = False,
) -> MimoComparison:
    """Test a model of several inputs and outputs against measurements.  Eq: CMP-4

    Parameters
    ----------
    model : MimoModel
    records : sequence of MimoRecord
        One or more experiments, each with at least two good periods.
    band : (lo, hi), optional
        Band [Hz]; default from the first to the last excited line.
    alpha : float
        False-alarm rate of the test.
    fitted : bool
        Whether the model was fitted to these records in this band. By default it was fitted to others, and
        the test includes its covariance.

    Returns
    -------
    MimoComparison

    Raises
    ------
    ValueError
        The band contains no line, alpha is not between 0 and 1, or there is no record.
    InputError
        The experiments differ from each other or from the model in channels, units or rate, or have too few
        periods for the joint noise of all outputs.
    """
    if not 0 < alpha < 1:
        raise ValueError(f"alpha must be between 0 and 1, got {alpha}")
    measured = _measured(records, band)
    first = measured.first
    for name in ("inputs", "outputs", "u_units", "y_units"):
        ours, theirs = getattr(model, name), getattr(first, name)
        both_known = not name.endswith("units") or all(map(all, (ours, theirs)))
        if both_known and ours != theirs:
            hint = "select the columns with --u and --y in the order of the model"
            raise InputError(f"the {name} differ from those of the model", first.name, f"{theirs}", hint)
    if first.hold is not None or model.domain == "z":
        return _compared(at_rate_of(model, first), measured, alpha, fitted=fitted)
    cases = []
    for hold in ("zoh", "none"):
        if hold == "none" or model.n_zeros < model.n_poles:
            held = replace(model, hold=hold, fs_hz=model.fs_hz or first.fs_hz)
            read = replace(measured, first=replace(first, hold=hold))
            cases.append(_compared(at_rate_of(held, read.first), read, alpha, fitted=fitted))
    return replace(max(cases, key=lambda case: case.p_value), hold_assumed=True)


@dataclass(frozen=True)
class _Measured:
    """Lines of the band of all experiments, and their scatter.

    Attributes
    ----------
    first : MimoRecord
    u, y : (K, channels, E) complex ndarrays
        Means over the periods.
    periods : list of (U, Y)
        Each period, (P, channels, K), of each experiment.
    between : list of (K, n_y, P - 1) ndarrays
        Noise between the lines (FRF-6); None where the input does not repeat.
    """

    first: MimoRecord
    f_hz: np.ndarray
    kind: np.ndarray
    u: np.ndarray
    y: np.ndarray
    periods: list[tuple[np.ndarray, np.ndarray]]
    between: list[np.ndarray | None]

    @property
    def weight(self) -> np.ndarray:
        """(E,) periods of each experiment."""
        return np.array([len(u) for u, _ in self.periods], float)

    @property
    def dof(self) -> int:
        """Degrees of freedom of the noise of all experiments."""
        return int(self.weight.sum() - len(self.weight))

    def scatter(self, g: np.ndarray) -> np.ndarray:
        """Sum of squares (K, n_y, n_y) of the noise of single periods."""
        total: np.ndarray | float = 0.0
        for (u, y), samples in zip(self.periods, self.between, strict=True):
            if samples is None:
                error = np.moveaxis(y - np.einsum("kij,pjk->pik", g, u), 0, -1).swapaxes(0, 1)
                samples = error - error.mean(axis=-1, keepdims=True)
            total = total + samples @ samples.conj().swapaxes(-1, -2)
        # Rounding is noise as well: a record without noise has a scatter of 0 otherwise.
        least = np.max(np.abs(self.y), axis=2) * np.finfo(float).eps
        return total + np.maximum(least, np.finfo(float).tiny ** 0.5)[:, :, None] ** 2 * np.eye(g.shape[1])


def _measured(records: MimoRecord | Sequence[MimoRecord], band: tuple[float, float] | None) -> _Measured:
    records = [records] if isinstance(records, MimoRecord) else list(records)
    if not records:
        raise ValueError("no record to compare the model with")
    parts = [channel_lines(record) for record in records]
    require_same(records, [n_period for _, _, n_period in parts])
    first, n_period = records[0], parts[0][2]
    f_hz = np.arange(n_period // 2 + 1) * (first.fs_hz / n_period)
    excited = np.logical_or.reduce([any_excited(part, n_period) for part in parts])
    if not excited.any():
        raise InputError("no line is excited", first.name, None, "name the columns of the inputs with --u")
    use = (f_hz > 0) & (2 * np.arange(len(f_hz)) < n_period)
    lo, hi = f_hz[np.flatnonzero(excited)[[0, -1]]]
    use[use] = in_band(f_hz[use], band or (lo, hi))
    between = []
    for u, y, _ in parts:
        repeats = not np.any(u - u[0])
        samples = [bins_between_lines(y[:, i], n_period, 0)[use] for i in range(y.shape[1])]
        between.append(np.stack(samples, axis=1) if repeats else None)
    line = np.flatnonzero(use)
    found = _Measured(
        first=first,
        f_hz=f_hz[use],
        kind=np.where(excited[use], "excited", np.where(line % 2 == 1, "odd", "even")),
        u=np.stack([u[..., use].mean(axis=0).T for u, _, _ in parts], axis=-1),
        y=np.stack([y[..., use].mean(axis=0).T for _, y, _ in parts], axis=-1),
        periods=[(u[..., use], y[..., use]) for u, y, _ in parts],
        between=between,
    )
    if found.dof < len(first.outputs):
        hint = "measure more periods, or more experiments"
        what = f"too few periods for the joint noise of {len(first.outputs)} outputs"
        raise InputError(what, first.name, f"{found.dof} degrees of freedom", hint)
    return found


def _compared(model: MimoModel, measured: _Measured, alpha: float, *, fitted: bool) -> MimoComparison:
    g = model.response(measured.f_hz)
    root = np.sqrt(measured.weight)
    deviations = np.zeros((*g.shape, 0)) if fitted else model.deviations(measured.f_hz)
    by_model = np.einsum("kijr,kje->kier", deviations, measured.u) * root[:, None]
    errors = MimoErrors(
        error=(measured.y - g @ measured.u) * root,
        scatter=measured.scatter(g),
        dof=measured.dof,
        by_model=by_model,
    )
    _require_independent(errors.scatter, measured.first)
    found = mimo_misfit(errors)
    n_fitted = model.n_parameters if fitted else 0
    p_value, n = found.total.p_value_of_fit(n_fitted), errors.error.size
    expected = errors.dof / (errors.dof - 1) if errors.dof > 1 else 1.0
    uncertainty = "fitted" if fitted else "none" if model.cov is None else "included"
    return MimoComparison(
        adequate=p_value >= alpha,
        p_value=p_value,
        alpha=alpha,
        cost_per_dof=float(np.sum(found.left.t) / expected + found.total.moved / 2)
        / max(n - n_fitted / 2, 1),
        model_uncertainty=uncertainty,
        outputs=_outputs(measured, errors, n_fitted),
        where=_where(measured, errors, alpha),
        n_lines=len(measured.f_hz),
        n_experiments=len(measured.weight),
        n_periods=int(measured.weight.sum()),
        hold=model.hold if measured.first.hold is None else measured.first.hold,
    )


def _require_independent(scatter: np.ndarray, first: MimoRecord) -> None:
    """Raise if the noise of an output follows from that of the others: such outputs have no joint test."""
    size = np.sqrt(np.einsum("kii->ki", scatter).real)
    correlation = scatter / (size[:, :, None] * size[:, None, :])
    if np.linalg.eigvalsh(correlation).min() < DEPENDENT:
        hint = "leave out an output that is computed from the others"
        raise InputError(
            "the noise of the outputs is linearly dependent", first.name, ", ".join(first.outputs), hint
        )


def _outputs(measured: _Measured, errors: MimoErrors, n_fitted: int) -> list[OutputComparison]:
    """Each output alone; fitted parameters are shared equally between the outputs."""
    found, first = [], measured.first
    variance = np.einsum("kii->ki", errors.scatter).real / errors.dof
    n_e, n_y = len(measured.weight), len(first.outputs)
    for i in range(n_y):
        alone = mimo_misfit(errors.of_output(i))
        by_model = np.sum(np.abs(errors.by_model[:, i]) ** 2, axis=2)
        squares = np.abs(errors.error[:, i]) ** 2 / measured.weight
        found.append(
            OutputComparison(
                name=first.outputs[i],
                unit=first.y_units[i],
                p_value=alone.total.p_value_of_fit(n_fitted / n_y),
                rms_error=float(np.sqrt(np.sum(squares) / (2 * n_e))),
                noise_floor_rms=float(np.sqrt(np.sum(variance[:, i]) * np.mean(1 / measured.weight) / 2)),
                model_uncertainty_rms=float(np.sqrt(np.sum(by_model / measured.weight) / (2 * n_e))),
            )
        )
    return found


def _where(measured: _Measured, errors: MimoErrors, alpha: float) -> list[dict[str, Any]]:
    """Third-octave bands of each output and kind of line that fail at a joint level alpha (CMP-2)."""
    f_hz = measured.f_hz
    n_bands = int(np.ceil(3 * np.log2(f_hz.max() / f_hz.min()) + 1e-9))
    edges = f_hz.min() * 2 ** (np.arange(n_bands + 2) / 3 - 1 / 6)
    cells: list[dict[str, Any]] = []
    for (i, output), kind in itertools.product(enumerate(measured.first.outputs), KINDS):
        for lo, hi in itertools.pairwise(edges):
            lines = (measured.kind == kind) & (f_hz >= lo) & (f_hz < hi)
            if np.any(lines):
                found = mimo_misfit(errors[lines].of_output(i))
                cells.append(_cell(len(cells), (output, kind), lines, found))
    groups = _joined(_holm(cells, alpha))
    total = float(sum(max(cell["excess"], 0.0) for cell in cells))
    return sorted((_band(group, f_hz, total) for group in groups), key=lambda band: -band["share"])


def _holm(cells: list[dict[str, Any]], alpha: float) -> list[dict[str, Any]]:
    """Cells rejected by Holm's step-down procedure, with their corrected p, in the given order."""
    corrected = 0.0
    for rank, cell in enumerate(sorted(cells, key=lambda cell: cell["p"])):
        corrected = max(corrected, min(1.0, cell["p"] * (len(cells) - rank)))
        cell["p_corrected"] = corrected
    return [cell for cell in cells if cell["p_corrected"] < alpha]


def _joined(cells: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Group neighbouring cells of one output and kind with similar excess per line."""
    groups: list[list[dict[str, Any]]] = []
    for cell in cells:
        group = groups[-1] if groups else None
        if group and group[-1]["kind"] == cell["kind"] and group[-1]["index"] + 1 == cell["index"]:
            densities = [member["density"] for member in group] + [cell["density"]]
            if max(densities) <= ALIKE * min(densities):
                group.append(cell)
                continue
        groups.append([cell])
    return groups


def _cell(index: int, kind: tuple[str, str], lines: np.ndarray, found: MimoMisfit) -> dict[str, Any]:
    density = max(found.excess / np.count_nonzero(lines), np.finfo(float).tiny)
    own = {"kind": kind, "index": index, "lines": lines}
    return own | {"p": found.total.p_value, "excess": found.excess, "density": density}


def _band(group: list[dict[str, Any]], f_hz: np.ndarray, total: float) -> dict[str, Any]:
    f = f_hz[np.any([cell["lines"] for cell in group], axis=0)]
    output, kind = group[0]["kind"]
    return {
        "output": output,
        "f_lo_hz": float(f.min()),
        "f_hi_hz": float(f.max()),
        "lines": kind,
        "share": sum(max(cell["excess"], 0.0) for cell in group) / total if total > 0 else 0.0,
        "p_value": min(cell["p_corrected"] for cell in group),
    }


def _kind_words(kind: str) -> str:
    return "on excited lines" if kind == "excited" else f"on {kind} detection lines"
