"""Records of several inputs and outputs, and the matrix of frequency responses that they measure.

One experiment excites all inputs at once; n_u experiments or more, with other phases or signs in each, tell
the inputs apart (orthogonal multisines do it best).  With the means over periods of all experiments beside
each other, Y = G U + N at each line (MIM-4):

    G = Y W U^H Q,    Q = (U W U^H)^-1,    W = diag(periods of each experiment)
    cov(G_ij, G_i'j') = C_ii' conj(Q_jj')

C is the covariance of one period's output error Y - G U, which contains the error of the inputs too.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from gsid.bands import in_band
from gsid.errors import InputError
from gsid.excited import excited_lines
from gsid.io import read_record
from gsid.record import Periods, Record, find_period, find_settling, split_periods
from gsid.spectra import period_lines

if TYPE_CHECKING:
    from gsid.mimo_model import MimoModel

CONDITION_MAX = 100.0
"""Of the inputs' lines over the experiments: beyond it they are not told apart."""


@dataclass(repr=False)
class MimoRecord:
    """Samples of one experiment with several inputs and outputs.

    Parameters
    ----------
    u : (n, n_u) array_like
        Inputs.
    y : (n, n_y) array_like
        Outputs.
    fs_hz : float
        Sample rate [Hz].
    inputs, outputs : list of str, optional
        Names; default u1, u2, ... and y1, y2, ...
    settle_samples : int, optional
        Default: until no channel stands out of its later periods (`gsid.record.find_settling`).
    u_units, y_units : list of str, optional
        Unit of each input and output; default none.
    period_samples, valid, hold, name
        As in `gsid.Record`.

    Raises
    ------
    InputError
        As `gsid.Record`.
    """

    u: np.ndarray
    y: np.ndarray
    fs_hz: float
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    period_samples: int | None = None
    settle_samples: int | None = None
    valid: np.ndarray | None = None
    u_units: list[str] = field(default_factory=list)
    y_units: list[str] = field(default_factory=list)
    hold: str | None = None
    name: str = ""

    def __post_init__(self) -> None:
        self.u, self.y = (np.asarray(x, dtype=float) for x in (self.u, self.y))
        for label, samples in (("u", self.u), ("y", self.y)):
            if samples.ndim != 2 or samples.shape[1] == 0:
                hint = "one row per sample, one column per channel"
                raise InputError(f"{label} is not a table of samples", self.name, samples.shape, hint)
        self.inputs = self.inputs or [f"u{i + 1}" for i in range(self.u.shape[1])]
        self.outputs = self.outputs or [f"y{i + 1}" for i in range(self.y.shape[1])]
        if len(self.inputs) != self.u.shape[1] or len(self.outputs) != self.y.shape[1]:
            raise InputError("names and channels differ in number", self.name, self.inputs + self.outputs)
        self.u_units = self.u_units or [""] * len(self.inputs)
        self.y_units = self.y_units or [""] * len(self.outputs)
        if len(self.u_units) != len(self.inputs) or len(self.y_units) != len(self.outputs):
            raise InputError("units and channels differ in number", self.name, self.u_units + self.y_units)
        self.pairs()

    def pairs(self) -> list[Record]:
        """Every channel in a record at least."""
        n_u, n_y = len(self.inputs), len(self.outputs)
        return [self.pair(min(i, n_u - 1), min(i, n_y - 1)) for i in range(max(n_u, n_y))]

    def pair(self, i: int, j: int) -> Record:
        """Input i and output j as a record of their own."""
        return Record(
            self.u[:, i],
            self.y[:, j],
            self.fs_hz,
            period_samples=self.period_samples,
            settle_samples=self.settle_samples,
            valid=self.valid,
            u_unit=self.u_units[i],
            y_unit=self.y_units[j],
            hold=self.hold,
            name=self.name,
        )

    def __repr__(self) -> str:
        names = f"{', '.join(self.inputs)} -> {', '.join(self.outputs)}"
        return f"MimoRecord({self.name or 'unnamed'}: {names}, {len(self.u)} samples at {self.fs_hz:g} Hz)"


def read_mimo_record(
    path: str | os.PathLike,
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    fs_hz: float | None = None,
    period: int | None = None,
    settle: int | None = None,
    hold: str | None = None,
) -> MimoRecord:
    """Read one experiment from a file that has a column or array for each channel.

    Parameters
    ----------
    path : path_like
        As `gsid.read_record`.
    inputs, outputs : sequence of str
        Names of the columns or arrays.
    fs_hz : float, optional
        Sample rate [Hz], where the file has neither times nor the rate.
    period, settle : int, optional
        Samples; take the place of what the file states.
    hold : {"zoh", "none"}, optional
        As `gsid.read_record`.

    Returns
    -------
    MimoRecord

    Raises
    ------
    InputError
        As `gsid.read_record`.
    """
    how = {"fs_hz": fs_hz, "period": period, "settle": settle, "hold": hold}
    us = [read_record(path, u=name, y=outputs[0], **how) for name in inputs]
    ys = [us[0]] + [read_record(path, u=inputs[0], y=name, **how) for name in outputs[1:]]
    first = us[0]
    return MimoRecord(
        np.column_stack([record.u for record in us]),
        np.column_stack([record.y for record in ys]),
        first.fs_hz,
        inputs=list(inputs),
        outputs=list(outputs),
        period_samples=first.period_samples,
        settle_samples=first.settle_samples,
        valid=np.logical_and.reduce([record.valid for record in us + ys]),
        u_units=[record.u_unit for record in us],
        y_units=[record.y_unit for record in ys],
        hold=first.hold,
        name=first.name,
    )


@dataclass(repr=False)
class MimoFrf:
    """Matrix of frequency responses at the excited lines, with its covariance (MIM-4).

    Attributes
    ----------
    line : (F,) int
    f_hz : (F,) [Hz]
    g : (F, n_y, n_u) complex
    cov_y : (F, n_y, n_y) complex
        Covariance of one period's output errors (variance: E|error|^2).
    spread : (F, n_u, n_u) complex
        Q, what the inputs' lines make of it.
    dof : float
        Degrees of freedom of `cov_y`; infinite when it is known.
    source : {"periods", "experiments", "known"}
        Where `cov_y` comes from: the scatter over periods is noise alone; the scatter over experiments, where
        there are more of them than inputs, contains nonlinear distortion too.
    n_experiments, n_periods : int
        n_periods of all experiments together.
    fs_hz : float
    period_samples : int
    inputs, outputs, u_units, y_units : list of str
        Names and units of the channels.
    hold : str
    """

    line: np.ndarray
    f_hz: np.ndarray
    g: np.ndarray
    cov_y: np.ndarray
    spread: np.ndarray
    dof: float
    source: str
    n_experiments: int
    n_periods: int
    fs_hz: float
    period_samples: int
    inputs: list[str]
    outputs: list[str]
    u_units: list[str]
    y_units: list[str]
    hold: str | None = "none"

    @property
    def n_y(self) -> int:
        """Number of outputs."""
        return self.g.shape[1]

    @property
    def n_u(self) -> int:
        """Number of inputs."""
        return self.g.shape[2]

    @property
    def var_g(self) -> np.ndarray:
        """(F, n_y, n_u) variance E|error|^2 of each response."""
        return np.einsum("kii,kjj->kij", self.cov_y, self.spread).real

    @classmethod
    def from_arrays(
        cls, f_hz: np.ndarray, g: np.ndarray, var_g: np.ndarray, *, fs_hz: float = float("nan")
    ) -> MimoFrf:
        """Take a matrix of responses measured elsewhere, whose errors are independent from output to output.

        Parameters
        ----------
        f_hz : (F,) array_like
            Hz.
        g : (F, n_y, n_u) complex array_like
        var_g : (F, n_y) array_like
            Variance of the responses of each output, known exactly and the same for all inputs.
        fs_hz : float, optional
            Sample rate [Hz], for models in z.

        Returns
        -------
        MimoFrf

        Raises
        ------
        ValueError
            Unequal shapes.
        """
        f_hz, g, var_g = np.asarray(f_hz, float), np.asarray(g, complex), np.asarray(var_g, float)
        if g.ndim != 3 or f_hz.shape != g.shape[:1] or var_g.shape != g.shape[:2]:
            raise ValueError(f"f_hz, g and var_g have shapes {f_hz.shape}, {g.shape} and {var_g.shape}")
        n_lines, n_y, n_u = g.shape
        return cls(
            line=np.arange(1, n_lines + 1),
            f_hz=f_hz,
            g=g,
            cov_y=var_g[:, :, None] * np.eye(n_y),
            spread=np.broadcast_to(np.eye(n_u), (n_lines, n_u, n_u)),
            dof=np.inf,
            source="known",
            n_experiments=n_u,
            n_periods=n_u,
            fs_hz=fs_hz,
            period_samples=0,
            inputs=[f"u{i + 1}" for i in range(n_u)],
            outputs=[f"y{i + 1}" for i in range(n_y)],
            u_units=[""] * n_u,
            y_units=[""] * n_y,
        )

    def in_band(self, band: tuple[float, float] | None) -> MimoFrf:
        """The lines in a band (lo, hi) [Hz], ends included; all of them for None."""
        use = in_band(self.f_hz, band)
        names = ("line", "f_hz", "g", "cov_y", "spread")
        return replace(self, **{name: getattr(self, name)[use] for name in names})

    def __repr__(self) -> str:
        error = np.sqrt(np.median(self.var_g / np.abs(self.g) ** 2))
        lines = f"{len(self.line)} lines {self.f_hz[0]:g} .. {self.f_hz[-1]:g} Hz"
        return (
            f"MimoFrf({self.n_y} x {self.n_u}: {lines}, "
            f"{self.n_experiments} experiments, std / gain {error:.2g} in the median, from the scatter over "
            f"{self.source})"
        )


def frf_mimo(records: Sequence[MimoRecord], *, band: tuple[float, float] | None = None) -> MimoFrf:
    """Matrix of frequency responses of as many experiments as there are inputs, or more.

    Parameters
    ----------
    records : sequence of MimoRecord
        One per experiment.
    band : (lo, hi), optional
        Only lines within [Hz].

    Returns
    -------
    MimoFrf
        MIM-4. With more experiments than inputs its covariance is the scatter over experiments, which
        contains nonlinear distortion, else the scatter over periods.

    Raises
    ------
    InputError
        Too few experiments, experiments that differ in rate, period or channels, inputs that are not told
        apart at a line of the band, or as `gsid.spectra`.
    ValueError
        No line in the band.
    """
    records = [records] if isinstance(records, MimoRecord) else list(records)
    if not records:
        raise ValueError("no record to estimate a matrix of responses from")
    first = records[0]
    n_u, n_e = len(first.inputs), len(records)
    if n_e < n_u:
        hint = "measure at least as many experiments as inputs, with other signs or phases in each"
        raise InputError("fewer experiments than inputs", first.name, f"{n_e} for {n_u} inputs", hint)
    parts = [_lines_of(record) for record in records]
    _require_same(records, [n_period for _, _, n_period in parts])
    n_period = parts[0][2]
    f_hz = np.arange(n_period // 2 + 1) * (first.fs_hz / n_period)
    chosen = _excited(parts, n_period)
    if not chosen.any():
        raise InputError(
            "no line is excited at every input", first.name, None, "excite all inputs on one grid"
        )
    chosen[chosen] = in_band(f_hz[chosen], band)
    us, ys = ([part[i][..., chosen] for part in parts] for i in (0, 1))  # each (P, channels, F)
    mean_u, mean_y = (np.stack([x.mean(axis=0) for x in xs], axis=-1).swapaxes(0, 1) for xs in (us, ys))
    weight = np.array([len(u) for u in us], dtype=float)
    _require_told_apart(mean_u, f_hz[chosen], first.name)
    spread = np.linalg.inv((mean_u * weight) @ _adjoint(mean_u))
    g = (mean_y * weight) @ _adjoint(mean_u) @ spread
    error_of_mean = mean_y - g @ mean_u
    if n_e > n_u:
        cov_y, dof = (error_of_mean * weight) @ _adjoint(error_of_mean) / (n_e - n_u), n_e - n_u
    else:
        cov_y, dof = _scatter_over_periods(us, ys, g)
    return MimoFrf(
        line=np.flatnonzero(chosen),
        f_hz=f_hz[chosen],
        g=g,
        cov_y=cov_y,
        spread=spread,
        dof=float(dof),
        source="experiments" if n_e > n_u else "periods",
        n_experiments=n_e,
        n_periods=int(weight.sum()),
        fs_hz=first.fs_hz,
        period_samples=n_period,
        inputs=first.inputs,
        outputs=first.outputs,
        hold=first.hold,
        u_units=first.u_units,
        y_units=first.y_units,
    )


def nrmse(
    model: MimoModel, records: Sequence[MimoRecord], *, band: tuple[float, float] | None = None
) -> np.ndarray:
    """Error of a model's steady answer, over all periods of all records and all lines but the mean.

    Parameters
    ----------
    model : MimoModel
    records : sequence of MimoRecord
    band : (lo, hi), optional
        Of error and output count only the lines within [Hz]: outside of its band a model extrapolates.

    Returns
    -------
    (n_y,) ndarray
        Root mean square of the error over that of each output.

    Raises
    ------
    InputError
        As `frf_mimo`; channels other than the model's.
    ValueError
        No line in the band.
    """
    records = [records] if isinstance(records, MimoRecord) else list(records)
    error, size = np.zeros(model.n_y), np.zeros(model.n_y)
    for record in records:
        if (record.inputs, record.outputs) != (model.inputs, model.outputs):
            raise InputError("the channels are not the model's", record.name, record.inputs + record.outputs)
        u, y, n_period = part = _lines_of(record)
        chosen = _any_excited(part, n_period)
        f_hz = np.arange(len(chosen)) * (record.fs_hz / n_period)
        left = y.copy()
        left[..., chosen] -= np.einsum("kij,pjk->pik", model.response(f_hz[chosen]), u[..., chosen])
        use = in_band(f_hz, band) & (f_hz > 0)
        error += np.sum(np.abs(left[..., use]) ** 2, axis=(0, 2))
        size += np.sum(np.abs(y[..., use]) ** 2, axis=(0, 2))
    return np.sqrt(error / size)


def _lines_of(record: MimoRecord) -> tuple[np.ndarray, np.ndarray, int]:
    """Lines of inputs and outputs, (P, channels, K) each, and the period."""
    first = _periods(record)
    line = np.arange(first.period_samples // 2 + 1, dtype=np.uint32)

    def transform(columns: np.ndarray) -> np.ndarray:
        n, settle = first.period_samples, first.settle_samples
        rows = settle + n * first.number[:, None] + np.arange(n)
        return np.stack([period_lines(x[rows], line, settle) for x in columns.T], axis=1)

    return transform(record.u), transform(record.y), first.period_samples


def _periods(record: MimoRecord) -> Periods:
    """Cut where all channels have settled; the period is that of the busiest input: others may rest."""
    busiest = record.pair(int(np.argmax(record.u.std(axis=0))), 0)
    if record.settle_samples is not None:
        return split_periods(busiest)
    period = record.period_samples
    if period is None:
        period = find_period(busiest.u, valid=busiest.valid, name=busiest.name)
    settle = max(find_settling(pair, period) for pair in record.pairs())
    return split_periods(busiest, period=period, settle=settle)


def _excited(parts: list, n_period: int) -> np.ndarray:
    """Lines that each input excites in one experiment at least."""
    n_u = parts[0][0].shape[1]
    by_input = [[excited_lines(u[:, i], n_period) for u, _, _ in parts] for i in range(n_u)]
    return np.logical_and.reduce([np.logical_or.reduce(each) for each in by_input])


def _any_excited(part: tuple, n_period: int) -> np.ndarray:
    """Lines that one input at least excites in this experiment."""
    u = part[0]
    return np.logical_or.reduce([excited_lines(u[:, i], n_period) for i in range(u.shape[1])])


def _require_same(records: list[MimoRecord], periods: list[int]) -> None:
    for record, period in zip(records, periods, strict=True):
        for what in ("fs_hz", "inputs", "outputs", "hold", "u_units", "y_units"):
            ours, theirs = getattr(records[0], what), getattr(record, what)
            if ours != theirs:
                raise InputError(
                    f"the experiments differ in {what}", record.name, f"{theirs!r}, not {ours!r}"
                )
        if period != periods[0]:
            raise InputError("the experiments differ in their period", record.name, period)


def _require_told_apart(u: np.ndarray, f_hz: np.ndarray, name: str) -> None:
    size = np.linalg.norm(u, axis=-1, keepdims=True)
    condition = np.linalg.cond(u / size)
    worst = int(np.argmax(condition))
    if not condition[worst] < CONDITION_MAX:
        raise InputError(
            f"the inputs are not told apart at {f_hz[worst]:g} Hz",
            name,
            f"condition {condition[worst]:.3g} of their lines over the experiments",
            "give each experiment other phases or signs, for example orthogonal multisines",
        )


def _scatter_over_periods(us: list, ys: list, g: np.ndarray) -> tuple[np.ndarray, int]:
    total, dof = 0, 0
    for u, y in zip(us, ys, strict=True):
        error = np.moveaxis(y, 0, -1).swapaxes(0, 1) - g @ np.moveaxis(u, 0, -1).swapaxes(0, 1)  # (F, n_y, P)
        error = error - error.mean(axis=-1, keepdims=True)
        total = total + error @ _adjoint(error)
        dof += error.shape[-1] - 1
    return total / dof, dof


def _adjoint(matrix: np.ndarray) -> np.ndarray:
    return matrix.conj().swapaxes(-1, -2)
