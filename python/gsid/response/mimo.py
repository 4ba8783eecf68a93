"""Matrix of frequency responses from records of several inputs and outputs.

Each experiment excites all inputs at once. At least n_u experiments with different phases or signs are needed
to separate the inputs; orthogonal multisines are best. With the means over periods of all experiments as
columns, Y = G U + N at each line (MIM-4):

    G = Y W U^H Q,    Q = (U W U^H)^-1,    W = diag(periods of each experiment)
    cov(G_ij, G_i'j') = C_ii' conj(Q_jj')

C is the covariance of the output error Y - G U of one period, which includes the error of the inputs.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gsid.base.bands import in_band
from gsid.base.errors import InputError
from gsid.records.mimo import MimoRecord
from gsid.records.periods import Periods, find_period, find_settling, split_periods
from gsid.spectrum.excited import excited_lines
from gsid.spectrum.lines import period_lines

_log = logging.getLogger(__name__)

CONDITION_MAX = 100.0
"""Largest condition number of the matrix of inputs over experiments at a line that is used."""
LEAST_KEPT = 0.5
"""Share of the excited lines that must be usable."""


@dataclass(repr=False)
class MimoFrf:
    """Matrix of frequency responses at the excited lines, with its covariance (MIM-4).

    Attributes
    ----------
    line : (F,) int
    f_hz : (F,) [Hz]
    g : (F, n_y, n_u) complex
    cov_y : (F, n_y, n_y) complex
        Covariance of the output errors of one period (variance: E|error|^2).
    spread : (F, n_u, n_u) complex
        Q, which scales `cov_y` to the covariance of g.
    dof : float
        Degrees of freedom of `cov_y`; infinite if it is known.
    source : {"periods", "experiments", "known"}
        Source of `cov_y`: the scatter over periods, which is noise only, or the scatter over experiments,
        which includes nonlinear distortion and needs more experiments than inputs.
    n_experiments, n_periods : int
        n_periods counts the periods of all experiments together.
    fs_hz : float
    period_samples : int
    inputs, outputs, u_units, y_units : list of str
        Names and units of the channels.
    hold : str
    masked_hz : (R,) [Hz]
        Excited lines that are not used, because the experiments do not separate the inputs there.
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
    masked_hz: np.ndarray = field(default_factory=lambda: np.empty(0))

    @property
    def n_masked(self) -> int:
        """Number of excited lines that are not used."""
        return len(self.masked_hz)

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
        """Import a measured matrix of responses, with independent errors of the outputs.

        Parameters
        ----------
        f_hz : (F,) array_like
            Frequencies [Hz].
        g : (F, n_y, n_u) complex array_like
        var_g : (F, n_y) array_like
            Variance of the responses of each output, assumed to be exact and the same for all inputs.
        fs_hz : float, optional
            Sample rate [Hz], for models in z.

        Returns
        -------
        MimoFrf

        Raises
        ------
        ValueError
            The shapes do not match.
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
        """Select the lines in a band (lo, hi) [Hz], limits included; None selects all lines."""
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
    """Estimate a matrix of frequency responses. At least as many experiments as inputs are needed.

    Parameters
    ----------
    records : sequence of MimoRecord
        One per experiment.
    band : (lo, hi), optional
        Use only lines within this band [Hz].

    Returns
    -------
    MimoFrf
        MIM-4. With more experiments than inputs, the covariance is estimated from the scatter over
        experiments, which includes nonlinear distortion, otherwise from the scatter over periods.

    Raises
    ------
    InputError
        There are too few experiments; the experiments differ in rate, period or channels; or the inputs
        cannot be separated at half of the lines of the band; or as `gsid.spectra`. Fewer such lines are
        masked, with a warning (`MimoFrf.masked_hz`).
    ValueError
        The band contains no line.
    """
    lines = experiment_lines(records, band=band)
    chosen, first, n_u = lines.excited, lines.first, len(lines.first.inputs)
    us, ys = ([x[..., chosen] for x in xs] for xs in (lines.us, lines.ys))  # each (P, channels, F)
    mean_u, mean_y, weight = means_of(us), means_of(ys), lines.weight
    spread = np.linalg.inv((mean_u * weight) @ adjoint(mean_u))
    g = (mean_y * weight) @ adjoint(mean_u) @ spread
    n_e = len(us)
    if n_e > n_u:
        cov_y, dof = scatter_over_experiments(mean_y - g @ mean_u, weight, n_u), n_e - n_u
    else:
        cov_y, dof = scatter_over_periods(us, ys, g)
    return MimoFrf(
        line=np.flatnonzero(chosen),
        f_hz=lines.f_hz[chosen],
        g=g,
        cov_y=cov_y,
        spread=spread,
        dof=float(dof),
        source="experiments" if n_e > n_u else "periods",
        n_experiments=n_e,
        n_periods=int(weight.sum()),
        fs_hz=first.fs_hz,
        period_samples=lines.n_period,
        inputs=first.inputs,
        outputs=first.outputs,
        hold=first.hold,
        u_units=first.u_units,
        y_units=first.y_units,
        masked_hz=lines.masked_hz,
    )


@dataclass(frozen=True)
class ExperimentLines:
    """Lines of several experiments with the same inputs, outputs and period.

    Attributes
    ----------
    first : MimoRecord
    us, ys : list of (P_e, channels, K) complex ndarrays
        Lines 0 .. N/2 of each good period of each experiment.
    n_period : int
    f_hz : (K,) [Hz]
    excited : (K,) bool
        Lines of the band that are used: each input is excited in some experiment, and they are separated.
    free : (K,) bool
        Lines between the first and the last of these at which no experiment excites an input.
    masked_hz : (R,) [Hz]
        Excited lines that are not used.
    """

    first: MimoRecord
    us: list[np.ndarray]
    ys: list[np.ndarray]
    n_period: int
    f_hz: np.ndarray
    excited: np.ndarray
    free: np.ndarray
    masked_hz: np.ndarray

    @property
    def weight(self) -> np.ndarray:
        """(E,) good periods of each experiment."""
        return np.array([len(u) for u in self.us], dtype=float)


def experiment_lines(
    records: MimoRecord | Sequence[MimoRecord], *, band: tuple[float, float] | None = None
) -> ExperimentLines:
    """Compute the lines of several experiments, and find those that are excited.

    Parameters
    ----------
    records : sequence of MimoRecord
    band : (lo, hi), optional
        Hz.

    Returns
    -------
    ExperimentLines

    Raises
    ------
    InputError, ValueError
        As `frf_mimo`.
    """
    records = [records] if isinstance(records, MimoRecord) else list(records)
    if not records:
        raise ValueError("no record to estimate a matrix of responses from")
    first = records[0]
    n_u, n_e = len(first.inputs), len(records)
    if n_e < n_u:
        hint = "measure at least as many experiments as inputs, with different signs or phases in each"
        raise InputError("fewer experiments than inputs", first.name, f"{n_e} for {n_u} inputs", hint)
    parts = [channel_lines(record) for record in records]
    require_same(records, [n_period for _, _, n_period in parts])
    n_period = parts[0][2]
    f_hz = np.arange(n_period // 2 + 1) * (first.fs_hz / n_period)
    chosen = _excited(parts, n_period)
    if not chosen.any():
        raise InputError(
            "no line is excited at every input", first.name, None, "excite all inputs on one grid"
        )
    chosen[chosen] = in_band(f_hz[chosen], band)
    us, ys = [part[0] for part in parts], [part[1] for part in parts]
    usable = _separable(means_of([u[..., chosen] for u in us]), f_hz[chosen], first.name)
    masked_hz = f_hz[chosen][~usable]
    chosen[chosen] = usable
    free = ~np.logical_or.reduce([any_excited(part, n_period) for part in parts])
    inside = np.flatnonzero(chosen)[[0, -1]]
    free[: inside[0]] = free[inside[1] :] = False
    return ExperimentLines(first, us, ys, n_period, f_hz, chosen, free, masked_hz)


def means_of(parts: list[np.ndarray]) -> np.ndarray:
    """Means over the periods of each experiment, (F, channels, E), of E arrays (P_e, channels, F)."""
    return np.stack([x.mean(axis=0) for x in parts], axis=-1).swapaxes(0, 1)


def channel_lines(record: MimoRecord) -> tuple[np.ndarray, np.ndarray, int]:
    """Compute the lines of inputs and outputs, (P, channels, K) each, and the period."""
    first = _periods(record)
    line = np.arange(first.period_samples // 2 + 1, dtype=np.uint32)

    def transform(columns: np.ndarray) -> np.ndarray:
        n, settle = first.period_samples, first.settle_samples
        rows = settle + n * first.number[:, None] + np.arange(n)
        return np.stack([period_lines(x[rows], line, settle) for x in columns.T], axis=1)

    return transform(record.u), transform(record.y), first.period_samples


def _periods(record: MimoRecord) -> Periods:
    """Periods after all channels have settled. The largest input gives the period; others may be zero."""
    largest = record.pair(int(np.argmax(record.u.std(axis=0))), 0)
    if record.settle_samples is not None:
        return split_periods(largest)
    period = record.period_samples
    if period is None:
        period = find_period(largest.u, valid=largest.valid, name=largest.name)
    settle = max(find_settling(pair, period) for pair in record.pairs())
    return split_periods(largest, period=period, settle=settle)


def _excited(parts: list, n_period: int) -> np.ndarray:
    """Lines that each input excites in at least one experiment."""
    n_u = parts[0][0].shape[1]
    by_input = [[excited_lines(u[:, i], n_period) for u, _, _ in parts] for i in range(n_u)]
    return np.logical_and.reduce([np.logical_or.reduce(each) for each in by_input])


def any_excited(part: tuple, n_period: int) -> np.ndarray:
    """Lines that at least one input excites in this experiment."""
    u = part[0]
    return np.logical_or.reduce([excited_lines(u[:, i], n_period) for i in range(u.shape[1])])


def require_same(records: list[MimoRecord], periods: list[int]) -> None:
    """Refuse experiments that differ in rate, channels, units, hold or period.

    Raises
    ------
    InputError
        They differ.
    """
    for record, period in zip(records, periods, strict=True):
        for what in ("fs_hz", "inputs", "outputs", "hold", "u_units", "y_units"):
            ours, theirs = getattr(records[0], what), getattr(record, what)
            if ours != theirs:
                raise InputError(
                    f"the experiments differ in {what}", record.name, f"{theirs!r}, not {ours!r}"
                )
        if period != periods[0]:
            raise InputError("the experiments differ in their period", record.name, period)


def _separable(u: np.ndarray, f_hz: np.ndarray, name: str) -> np.ndarray:
    """Lines at which the experiments separate the inputs, (F,) bool; the others are reported.

    Raises
    ------
    InputError
        Fewer than half of the lines remain.
    """
    size = np.linalg.norm(u, axis=-1, keepdims=True)
    condition = np.linalg.cond(u / np.where(size > 0, size, 1))
    usable = condition <= CONDITION_MAX
    if usable.all():
        return usable
    n_lost = int(np.sum(~usable))
    where = ", ".join(f"{f:g}" for f in f_hz[~usable][:8]) + ", ..." * (n_lost > 8)
    if np.mean(usable) < LEAST_KEPT:
        worst = int(np.argmax(condition))
        raise InputError(
            f"the inputs cannot be separated at {n_lost} of {len(f_hz)} lines ({where} Hz)",
            name,
            f"condition number up to {condition[worst]:.3g} of the inputs over the experiments",
            "use different phases or signs in each experiment, for example orthogonal multisines",
        )
    _log.warning(
        "%s: lines left out because the experiments do not separate the inputs there: %d (%s Hz)",
        name or "the experiments",
        n_lost,
        where,
    )
    return usable


def scatter_over_experiments(error: np.ndarray, weight: np.ndarray, n_u: int) -> np.ndarray:
    """Covariance of the error of one period from the errors (F, n_y, E) of the means over E experiments.

    A matrix of responses to n_u inputs was estimated from the same experiments.
    """
    return (error * weight) @ adjoint(error) / (len(weight) - n_u)


def scatter_over_periods(us: list[np.ndarray], ys: list[np.ndarray], g: np.ndarray) -> tuple[np.ndarray, int]:
    """Covariance (F, n_y, n_y) of the error Y - G U of one period, and its degrees of freedom."""
    total, dof = 0, 0
    for u, y in zip(us, ys, strict=True):
        error = np.moveaxis(y, 0, -1).swapaxes(0, 1) - g @ np.moveaxis(u, 0, -1).swapaxes(0, 1)  # (F, n_y, P)
        error = error - error.mean(axis=-1, keepdims=True)
        total = total + error @ adjoint(error)
        dof += error.shape[-1] - 1
    return total / dof, dof


def adjoint(matrix: np.ndarray) -> np.ndarray:
    """Conjugate transpose of each of (..., n, m) matrices."""
    return matrix.conj().swapaxes(-1, -2)
