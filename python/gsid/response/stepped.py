"""Frequency response from a stepped sine: one sine after another, each with a waiting time and P periods.

Each sine is a measurement of one line (FRF-1, FRF-2; thesis, figure 3.2): after the waiting time the lines of
its P periods give the response, and their scatter the variance. The layout comes from the keys
that `gsid design stepped-sine` writes and `gsid run --u` keeps in the record.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from gsid.base.bands import within
from gsid.base.errors import InputError
from gsid.records.record import Record, check_range
from gsid.response.frf import Frf, response_of
from gsid.spectrum.line_test import exponential_score
from gsid.spectrum.lines import covariance, period_lines, sample_variance
from gsid.spectrum.realisation import require_same

_log = logging.getLogger(__name__)

ALPHA = 1e-3  # false-alarm rate of the warning that the waiting time is too short
REPEATS = 1e-6  # largest difference of the input's periods, relative to its line, that counts as rounding


@dataclass(frozen=True)
class Steps:
    """Layout of a stepped sine.

    Attributes
    ----------
    base_samples : int
        Period N of all sines [samples]; line k is at k fs/N.
    settle_samples : int
        Waiting time of each sine [samples].
    n_periods : int
        Periods P measured at each sine.
    """

    base_samples: int
    settle_samples: int
    n_periods: int

    @property
    def step_samples(self) -> int:
        """Length of a step [samples]."""
        return self.settle_samples + self.n_periods * self.base_samples

    def keys(self) -> dict[str, int]:
        """Keys of a file that state this layout."""
        return dict(zip(STEP_KEYS, (self.base_samples, self.settle_samples, self.n_periods), strict=True))


STEP_KEYS = ("stepped_base_samples", "stepped_settle_samples", "stepped_periods")


def steps_of(meta: Mapping[str, str], name: str = "") -> Steps | None:
    """Layout that the keys of a file state; None: they state none.

    Parameters
    ----------
    meta : mapping
    name : str
        Of the file, for the error.

    Raises
    ------
    InputError
        Some keys are missing, or a value is not valid.
    """
    given = [str(meta[key]) for key in STEP_KEYS if key in meta]
    if not given:
        return None
    if len(given) < len(STEP_KEYS) or not all(text.isdecimal() and len(text) < 10 for text in given):
        hint = f"state {', '.join(STEP_KEYS)} as whole numbers, or remove these keys"
        raise InputError("the layout of the stepped sine is not valid", name, ", ".join(given), hint)
    steps = Steps(*map(int, given))
    if steps.base_samples < 3 or steps.n_periods < 1:
        hint = "make the sequence again with `gsid design stepped-sine`"
        raise InputError("the layout of the stepped sine is not valid", name, ", ".join(given), hint)
    return steps


def are_stepped(records: Sequence[object]) -> bool:
    """Whether all records state the layout of a stepped sine."""
    return all(isinstance(one, Record) and steps_of(one.meta, one.name) is not None for one in records)


def stepped_frf(
    records: Sequence[Record], *, band: tuple[float, float] | None = None, min_input: float = 0.0
) -> Frf:
    """Estimate the response at the sines of a stepped sine, with the variance over their periods.

    Parameters
    ----------
    records : sequence of Record
        Each with whole sequences of the same layout. Their periods are combined.
    band : (lo, hi), optional
        Use only lines within this band [Hz].
    min_input : float
        Omit lines whose input amplitude is smaller, unit of u.

    Returns
    -------
    Frf
        `period_samples` is the period N of the sines. `dof` is set if lost samples leave lines with fewer
        periods. Lines with fewer than two good periods are in `rejected_hz`.

    Raises
    ------
    InputError
        A record has no layout, or none of its steps; the records differ in layout, sample rate, hold or
        units; or no line has two good periods.
    """
    first = records[0]
    steps = steps_of(first.meta, first.name)
    rows: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}
    n_spoiled = 0
    for record in records:
        _require_layout(record, steps, first)
        found, n_lost = _steps(record, steps)
        n_spoiled += n_lost
        for line, u, y in found:
            rows.setdefault(line, []).append((u, y))
    periods = {
        line: [np.concatenate(part) for part in zip(*rows[line], strict=True)] for line in sorted(rows)
    }
    f0_hz = first.fs_hz / steps.base_samples
    wanted = {
        line: (u, y)
        for line, (u, y) in periods.items()
        if within(np.array([line * f0_hz]), band)[0] and (not len(u) or abs(u.mean()) >= min_input)
    }
    used = {line: both for line, both in wanted.items() if len(both[0]) >= 2}
    if not used:
        hint = "measure with `--periods 2` or more at each sine, or widen the band"
        raise InputError("no sine has two good periods", first.name, None, hint)
    _warn_of_transients(first.name, rows, used)
    return _response(
        first, records, steps, used, np.array(sorted(set(wanted) - set(used))) * f0_hz, n_spoiled
    )


def _require_layout(record: Record, steps: Steps | None, first: Record) -> None:
    own = steps_of(record.meta, record.name)
    if own is None:
        hint = f"write the keys {', '.join(STEP_KEYS)} of the design into the file"
        raise InputError("the record does not state the layout of its stepped sine", record.name, None, hint)
    if own != steps:
        hint = "give records of one sequence"
        raise InputError("the records differ in the layout of their stepped sine", record.name, own, hint)
    if record is not first:
        require_same(*(replace(one, period_samples=None) for one in (first, record)))
    check_range(record)


def _steps(record: Record, steps: Steps) -> tuple[list[tuple[int, np.ndarray, np.ndarray]], int]:
    """Line of each step, its input and output in each good period; and the number of spoiled periods."""
    start, length = record.settle_samples or 0, steps.step_samples
    found, n_spoiled = [], 0
    for begin in range(start, len(record.u) - length + 1, length):
        part = slice(begin + steps.settle_samples, begin + length)
        shape = (steps.n_periods, steps.base_samples)
        u, y = record.u[part].reshape(shape), record.y[part].reshape(shape)
        good = record.valid[part].reshape(shape).all(axis=1)
        n_spoiled += int(np.sum(~good))
        if not good.any():
            _log.warning("%s: all periods of the sine at sample %d are lost", record.name or "record", begin)
            continue
        line = _line_of(u[good], f"{record.name}, sample {begin}")
        at = np.array([line], np.uint32)
        lines = (period_lines(x[good], at, 0)[:, 0] for x in (u, y))
        found.append((line, *lines))
    if not found:
        hint = f"a step lasts {length} samples, the record {len(record.u) - start} after its settling"
        raise InputError("the record has no whole step of its stepped sine", record.name, None, hint)
    return found, n_spoiled


def _line_of(u: np.ndarray, where: str) -> int:
    """Line of the sine in the periods u of a step, (P, N).

    Raises
    ------
    InputError
        A period is not this one sine: the record begins elsewhere, or is another signal.
    """
    power = np.abs(np.fft.rfft(u)[:, 1:]) ** 2
    line = 1 + int(np.argmax(power.sum(axis=0)))
    if not np.all(power[:, line - 1] > 0.5 * power.sum(axis=1)):
        hint = "the record must begin with the sequence (--settle), and state the layout of its design"
        raise InputError("the input of a step is not one sine", where, None, hint)
    return line


def _warn_of_transients(
    name: str,
    rows: Mapping[int, Sequence[tuple[np.ndarray, np.ndarray]]],
    used: Mapping[int, Sequence[np.ndarray]],
) -> None:
    """Warn if the first periods of the steps differ from the later ones: the waiting time is too short."""
    scores, worst = [], (0.0, 0)
    for line in used:
        for _, y in rows[line]:
            if len(y) < 3:
                continue
            later, dof = y[1:], len(y) - 2
            variance = float(sample_variance(later[:, None])[0]) * (1 + 1 / len(later))
            jump = abs(y[0] - later.mean())
            if variance > 0:
                scores.append(exponential_score(np.array([jump**2 / variance]), np.array([dof]))[0])
            worst = max(worst, (float(jump / max(abs(later.mean()), np.finfo(float).tiny)), line))
    if not scores:
        return
    p_value = special.chdtrc(2 * len(scores), 2 * float(np.sum(scores)))
    if p_value < ALPHA:
        _log.warning(
            "%s: the first periods of the sines differ from the later ones by up to %.2g %% (line %d, "
            "p = %.1g): the waiting time is too short; increase --settle of the design",
            name or "record",
            100 * worst[0],
            worst[1],
            p_value,
        )


def _response(
    first: Record,
    records: Sequence[Record],
    steps: Steps,
    used: Mapping[int, Sequence[np.ndarray]],
    rejected_hz: np.ndarray,
    n_spoiled: int,
) -> Frf:
    line, counts = np.array(list(used)), np.array([len(u) for u, _ in used.values()])
    even = bool(np.all(counts == counts[0]))
    each = [_one_line(*both) for both in used.values()]
    arrays = {key: np.concatenate([one[key] for one in each]) for key in each[0]}
    most = int(np.max(counts))
    for key in ("var_u", "var_y", "cov_yu"):  # of one period; a line with fewer periods counts accordingly
        arrays[key] = arrays[key] * (most / counts)
    return Frf(
        line=line,
        f_hz=line * (first.fs_hz / steps.base_samples),
        **arrays,
        n_periods=most,
        n_realisations=1,
        n_spoiled=n_spoiled,
        settle_samples=steps.settle_samples,
        period_samples=steps.base_samples,
        fs_hz=first.fs_hz,
        hold=first.hold,
        u_unit=first.u_unit,
        y_unit=first.y_unit,
        name=", ".join(record.name for record in records if record.name),
        n_dof=most - 1 if even else float(len(counts) / np.sum(1 / (counts - 1.0))),
        rejected_hz=rejected_hz,
        dof=None if even else counts - 1.0,
    )


def _one_line(u: np.ndarray, y: np.ndarray) -> dict[str, np.ndarray]:
    """Response and (co)variances of one line from its periods, (P,) complex each."""
    U, Y = u[:, None], y[:, None]
    repeats = bool(np.max(np.abs(u - u[0])) <= REPEATS * abs(u[0]))
    var_u = np.zeros(1) if repeats else sample_variance(U)
    cov_yu = np.zeros(1, complex) if repeats else covariance(Y, U)
    return response_of(U.mean(axis=0), Y.mean(axis=0), var_u, sample_variance(Y), cov_yu, len(u))
