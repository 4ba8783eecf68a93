"""Response to an excitation that is not periodic: H1 estimate and coherence from windows over the record.

The signal is cut off at the ends of each window, which causes leakage. A Hann window reduces the leakage but
does not remove it. The estimate is biased where the response changes within a few lines. A periodic
excitation does not have this error.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from gsid.base.bands import within
from gsid.base.errors import InputError
from gsid.records.record import Record, check_range
from gsid.response.frf import Frf
from gsid.spectrum.excited import SHARE_OF_LARGEST
from gsid.spectrum.noise import CORRELATION, hann_windows
from gsid.spectrum.realisation import require_same

_log = logging.getLogger(__name__)

FEWEST_WINDOWS = 8  # number of windows without overlap that gives the default length
SHORTEST = 64  # samples: shortest default window
FIRST_LINE = 2  # lower lines contain the mean of the window


def default_window(records: Sequence[Record]) -> int | None:
    """Largest power of two that fits 8 times into the shortest record; None if it is less than 64 samples."""
    most = min(len(record) for record in records) // FEWEST_WINDOWS
    return 1 << (most.bit_length() - 1) if most >= SHORTEST else None


def windowed_frf(
    records: Sequence[Record],
    window: int,
    *,
    settle: int | None = None,
    band: tuple[float, float] | None = None,
    min_input: float = 0.0,
) -> Frf:
    """Estimate the response with Hann windows that overlap by half (WIN-1), and warn of the bias.

    Parameters
    ----------
    records : sequence of Record
        The average is over the windows of all records.
    window : int
        Length of a window [samples].
    settle : int, optional
        Samples discarded at the start. Default: the value of each record, else none.
    band : (lo, hi), optional
        Use only lines within this band [Hz].
    min_input : float
        Omit lines whose input amplitude is smaller, unit of u.

    Returns
    -------
    Frf
        `n_periods` counts the windows. u is an rms amplitude without a phase. Lines whose input is below 1 %
        of the largest are omitted (`rejected_hz`).

    Raises
    ------
    InputError
        There are fewer than 3 windows or no line in the band, or the records differ in sample rate, hold or
        units.
    """
    first = records[0]
    parts = [_Sums(record, window, settle) for record in records]
    for part in parts[1:]:
        require_same(parts[0], part)
    n_windows = sum(part.n_windows for part in parts)
    n_effective = sum(part.n_effective for part in parts)
    if n_windows < 3:
        size = f"{n_windows} windows of {window} samples"
        hint = "shorten them (--window)"
        raise InputError("too few windows to estimate the noise", first.name, size, hint)
    uu, yy, yu = (sum(getattr(part, name) for part in parts) / n_windows for name in ("uu", "yy", "yu"))
    line = np.arange(len(uu))
    f_hz = line * (first.fs_hz / window)
    candidate = (line >= FIRST_LINE) & (2 * line < window) & within(f_hz, band)
    amplitude = np.sqrt(uu)
    use = candidate & (amplitude > SHARE_OF_LARGEST * amplitude[FIRST_LINE:].max()) & (amplitude >= min_input)
    if not use.any():
        raise InputError("no line is excited", first.name, None, "widen the band, or excite the axis more")
    g = yu[use] / uu[use]
    # variance of one window; estimating g uses one degree of freedom
    var_y = np.maximum(yy[use] - np.abs(g) ** 2 * uu[use], 0) * n_effective / (n_effective - 1)
    _log.warning(
        "%s: averaging over %d Hann windows of %d samples (H1) instead of periods: leakage biases the "
        "response where it changes within %.3g Hz; use a periodic excitation (gsid design) to avoid this",
        first.name or "record",
        n_windows,
        window,
        4 * first.fs_hz / window,
    )
    return Frf(
        line=line[use],
        f_hz=f_hz[use],
        g=g,
        var_g=var_y / uu[use] / n_effective,
        u=amplitude[use].astype(complex),
        y=g * amplitude[use],
        var_u=np.zeros(len(g)),
        var_y=var_y,
        cov_yu=np.zeros(len(g), complex),
        n_periods=n_windows,
        n_realisations=len(records),
        n_spoiled=sum(part.n_spoiled for part in parts),
        settle_samples=parts[0].settle_samples,
        period_samples=window,
        fs_hz=first.fs_hz,
        hold=first.hold,
        u_unit=first.u_unit,
        y_unit=first.y_unit,
        name=", ".join(record.name for record in records if record.name),
        n_dof=n_effective - 1,
        method="windows",
        rejected_hz=f_hz[candidate & ~use],
    )


class _Sums:
    """Sums of powers over the windows of one record, scaled as squared amplitudes of sines.

    Attributes
    ----------
    uu, yy : (K,) float
    yu : (K,) complex
        Sums over the windows.
    n_windows, n_spoiled, settle_samples : int
        Good windows, windows with a lost sample, and samples discarded before the first window.
    n_effective : float
        Equivalent number of independent windows.
    """

    def __init__(self, record: Record, window: int, settle: int | None) -> None:
        check_range(record)
        self.settle_samples = (record.settle_samples or 0) if settle is None else settle
        part = slice(self.settle_samples, None)
        U, Y = (hann_windows(x[part], record.valid[part], window) for x in (record.u, record.y))
        self.uu, self.yy = (np.sum(np.abs(X) ** 2, axis=0) for X in (U, Y))
        self.yu = np.sum(Y * U.conj(), axis=0)
        self.n_windows = len(U)
        all_windows = max(0, (len(record.u[part]) - window) // max(1, window // 2) + 1)
        self.n_spoiled = all_windows - len(U)
        self.n_effective = len(U) / (1 + 2 * CORRELATION * max(len(U) - 1, 0) / max(len(U), 1))
        self.period_samples, self.name = window, record.name
        self.fs_hz, self.hold = record.fs_hz, record.hold
        self.u_unit, self.y_unit = record.u_unit, record.y_unit
