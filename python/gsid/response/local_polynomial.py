"""Local polynomial method: removes the transient, and estimates the noise from one or two periods.

Over a few lines, the response G and the leakage T, which is mainly the transient, are smooth functions of the
frequency. Around each line, low-order polynomials with a common denominator are fitted to them. The residual
is noise (LPM-1, LPM-2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsid.base.arguments import whole_samples
from gsid.base.errors import InputError
from gsid.records.periods import find_period, require_period
from gsid.records.record import Record, check_range
from gsid.response.frf import Frf, response_of
from gsid.spectrum.excited import excited_lines, large_lines, warn_of_slip
from gsid.spectrum.lines import period_lines
from gsid.spectrum.realisation import require_same

ORDER = 2  # of the polynomials
N_DOF = 9  # degrees of freedom of the noise variance at each line
ROUNDING = 1e-10  # of the largest line: smaller values come from rounding
WELL_POSED = 1e-8  # smallest diagonal of R over the largest: below, G and T cannot be separated


@dataclass(repr=False)
class Unsettled:
    """One realisation, transformed as a whole, including the transient.

    Attributes
    ----------
    U, Y : (N P / 2 + 1,) complex
        Lines of all P periods together. Every P-th is a line of the period.
    excited : (N/2 + 1,) bool
        Excited lines of the period.
    n_periods, settle_samples, period_samples : int
    fs_hz : float
    hold, u_unit, y_unit, name : str
    """

    U: np.ndarray
    Y: np.ndarray
    excited: np.ndarray
    n_periods: int
    settle_samples: int
    period_samples: int
    fs_hz: float
    hold: str | None
    u_unit: str
    y_unit: str
    name: str

    @property
    def f_hz(self) -> np.ndarray:
        """Frequencies of the period's lines, (N/2 + 1,) [Hz]."""
        return np.arange(len(self.excited)) * (self.fs_hz / self.period_samples)

    @property
    def large(self) -> np.ndarray:
        """As `Realisation.large`."""
        return large_lines(self.U[None, :: self.n_periods], self.period_samples)

    def frf(self, line: np.ndarray) -> Frf:
        """Estimate the response at these lines of the period, (F,) int.

        Returns
        -------
        Frf
            The variances have 9 degrees of freedom, which are partly shared between neighbouring lines.

        Raises
        ------
        InputError
            Neighbouring lines of one period are too similar to separate response and transient.
        """
        estimate = _between_lines if self.n_periods > 1 else _with_neighbours
        try:
            values = estimate(self.U, self.Y, line, self.n_periods)
        except np.linalg.LinAlgError as error:
            what = "neighbouring lines of the input are too similar to separate response and transient"
            raise InputError(what, self.name, None, "use random phases, or two periods") from error
        n_period, settle = self.period_samples, self.settle_samples
        # phases relative to the first sample, (co)variances of one period
        phase_factor = np.exp(-2j * np.pi * (line * (settle % n_period) % n_period) / n_period)
        values["u"], values["y"] = values["u"] * phase_factor, values["y"] * phase_factor
        for name in ("var_u", "var_y", "cov_yu"):
            values[name] = values[name] * self.n_periods
        return Frf(
            line=line,
            f_hz=self.f_hz[line],
            **values,
            n_periods=self.n_periods,
            n_realisations=1,
            n_spoiled=0,
            settle_samples=settle,
            period_samples=n_period,
            fs_hz=self.fs_hz,
            hold=self.hold,
            u_unit=self.u_unit,
            y_unit=self.y_unit,
            name=self.name,
            n_dof=N_DOF,
            method="lpm",
        )


def unsettled(
    records: Sequence[Record], *, period: int | None = None, settle: int | None = None
) -> list[Unsettled]:
    """Transform records of one experiment, each as a whole.

    Parameters
    ----------
    records : sequence of Record
        One per realisation, with at least one period. They need not start from rest.
    period, settle : int, optional
        Period and settling [samples]. Default: the values of each record, else the period found from u and no
        settling.

    Returns
    -------
    list of Unsettled

    Raises
    ------
    InputError
        A sample is lost, there is less than one period, the period is not found, or there are too few lines;
        or the realisations differ in period, sample rate, hold or units.
    ValueError
        The sequence is empty.
    """
    if not records:
        raise ValueError("no record of any realisation")
    parts = [_unsettled(record, period, settle) for record in records]
    for part in parts[1:]:
        require_same(parts[0], part)
    return parts


def _unsettled(record: Record, period: int | None, settle: int | None) -> Unsettled:
    check_range(record)
    settle = (record.settle_samples or 0) if settle is None else whole_samples("settle", settle)
    period = record.period_samples if period is None else whole_samples("period", period)
    if period is None:
        period = find_period(record.u, valid=record.valid, name=record.name)
    require_period(period, settle, record.name)
    n_periods = (len(record) - settle) // period
    size = f"{len(record)} samples, period {period}, settle {settle}"
    if n_periods < 1:
        raise InputError("less than one period", record.name, size, "measure longer")
    part = slice(settle, settle + n_periods * period)
    lost = np.flatnonzero(~record.valid[part])
    if lost.size:
        what, where = (
            "the local polynomial method needs every sample",
            f"{record.name} sample {settle + lost[0]}",
        )
        raise InputError(what, where, "lost", "discard the samples up to it (--settle), or omit --lpm")
    bins = np.arange(n_periods * period // 2 + 1, dtype=np.uint32)
    if len(bins) < 4 * N_DOF:
        raise InputError("too few lines for the local polynomial method", record.name, size, "measure longer")
    U, Y = (period_lines(x[part][None], bins, 0)[0] for x in (record.u, record.y))
    rows = record.u[part].reshape(n_periods, period)
    lines = period_lines(rows, bins[: period // 2 + 1], 0)
    warn_of_slip(record.name, lines, period)
    excited = excited_lines(lines, period)
    if not excited.any():
        what = "u has no line above its noise"
        raise InputError(what, record.name, size, "excite the axis more, or give the right --period")
    return Unsettled(
        U,
        Y,
        excited,
        n_periods,
        settle,
        period,
        record.fs_hz,
        record.hold,
        record.u_unit,
        record.y_unit,
        record.name,
    )


def _between_lines(U: np.ndarray, Y: np.ndarray, line: np.ndarray, n_periods: int) -> dict[str, np.ndarray]:
    """Two periods or more: between the lines of the period are only transient and noise (LPM-2)."""
    free = np.arange(1, len(U))
    free = free[free % n_periods != 0]
    powers, neighbours = _powers(line * n_periods, free, ORDER + 2 + N_DOF)
    transient, leverage, residual_y = _local_fit(powers.astype(complex), powers, Y[neighbours])
    u, y, residual_u = U[line * n_periods], Y[line * n_periods] - transient[:, 0], np.zeros_like(residual_y)
    if np.abs(U[neighbours]).max() > ROUNDING * np.abs(u).max():  # otherwise u is periodic from the start
        transient, _, residual_u = _local_fit(powers.astype(complex), powers, U[neighbours])
        u = u - transient[:, 0]
    var_y, var_u, cov_yu = (
        np.einsum("kr,kr->k", a, b.conj()) / N_DOF
        for a, b in ((residual_y, residual_y), (residual_u, residual_u), (residual_y, residual_u))
    )
    found = response_of(u, y, var_u.real, var_y.real, cov_yu, 1)
    return found | {"var_g": found["var_g"] * (1 + leverage)}  # with the error of the transient at the line


def _with_neighbours(
    U: np.ndarray, Y: np.ndarray, line: np.ndarray, _n_periods: int
) -> dict[str, np.ndarray]:
    """One period: response and transient from the neighbouring lines, excited or not (LPM-1)."""
    powers, neighbours = _powers(line, np.arange(1, len(U) - 1), 2 * ORDER + 3 + N_DOF)
    size = np.abs(U[line])  # scales the columns to similar size
    columns = np.concatenate([powers * (U[neighbours] / size[:, None])[:, :, None], powers], axis=2)
    fitted, leverage, residual = _local_fit(columns, powers, Y[neighbours])
    var_y = np.sum(np.abs(residual) ** 2, axis=1) / N_DOF
    return {
        "g": fitted[:, 0] / size,
        "var_g": var_y * leverage / size**2,
        "u": U[line],
        "y": Y[line] - fitted[:, ORDER + 1],
        "var_u": np.zeros(len(line)),
        "var_y": var_y,
        "cov_yu": np.zeros(len(line), complex),
    }


def _powers(at: np.ndarray, usable: np.ndarray, n_rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Powers 0 .. ORDER of the scaled distance of the usable lines nearest to each `at`, and those lines."""
    first = np.clip(np.searchsorted(usable, at) - n_rows // 2, 0, len(usable) - n_rows)
    neighbours = usable[first[:, None] + np.arange(n_rows)]
    distance = neighbours - at[:, None]
    scaled = distance / np.abs(distance).max(axis=1, keepdims=True)
    return scaled[:, :, None] ** np.arange(ORDER + 1), neighbours


def _local_fit(
    columns: np.ndarray, powers: np.ndarray, X: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit X (1 + d x) = columns times coefficients around each line; x is 0 at the line itself.

    With the pole, the fit can follow a resonance that is only a few lines wide. Returns the coefficients (F,
    C), the variance of the first coefficient over that of the noise (F,), and the residuals (F, R).
    """
    size = np.abs(X).max(axis=1, keepdims=True)
    with_pole = -powers[:, :, 1] * X / np.maximum(size, np.finfo(float).tiny)
    q, r = np.linalg.qr(np.concatenate([columns, with_pole[:, :, None]], axis=2))
    diagonal = np.abs(np.diagonal(r, axis1=1, axis2=2))[:, : columns.shape[2]]
    if np.any(diagonal.min(axis=1) < WELL_POSED * diagonal.max(axis=1)):
        raise np.linalg.LinAlgError("columns too similar")
    projected = np.einsum("krc,kr->kc", q.conj(), X)
    residual = X - np.einsum("krc,kc->kr", q, projected)
    inverse = np.linalg.inv(r)
    fitted = np.einsum("kcd,kd->kc", inverse, projected)
    return fitted[:, :-1], np.sum(np.abs(inverse[:, 0]) ** 2, axis=1), residual
