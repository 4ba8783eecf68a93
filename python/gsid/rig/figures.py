"""Live figures of a run, for a picture that is drawn while the axis runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from gsid.rig.run import Progress
from gsid.rig.watch import RunLimits

if TYPE_CHECKING:
    from gsid.response.frf import Frf
    from gsid.response.streaming import StreamingFrf

PICTURES_HZ = 20.0
BINS = 4  # extremes of a signal between two pictures
RESPONSE_S = 0.25  # shortest time between two responses
LINES_MOST = 400  # of a response; more are thinned to this number, evenly in log f
PERIODS_MOST = 60  # the newest ones
DIGITS = 5


class Figures:
    """Reduce the samples of a run to at most `PICTURES_HZ` small sets of figures a second.

    Parameters
    ----------
    frf : StreamingFrf
        The response that is measured.
    limits : RunLimits
    settle_samples : int
    send : callable
        Receives each set: a dict of numbers, lists and None, which JSON can hold.

    Notes
    -----
    Keys of a set: `ticks`, `t_s` (end of each bin), `command`, `rate` and `travel_deg` (`low` and `high` of
    each bin, None without a sample), `limits` and `peaks` of these three, `good`, `spoiled` and `requested`
    periods, `periods` (newest last), `left_s`; and `response` when it has changed: `f_hz`, `magnitude`, its
    standard deviation `std`, `phase_deg` (-180 to 180), `n_lines` (before the thinning).
    """

    def __init__(
        self, frf: StreamingFrf, limits: RunLimits, settle_samples: int, send: Callable[[dict], None]
    ) -> None:
        self._frf, self._limits, self._settle, self._send = frf, limits, settle_samples, send
        self._begin: tuple[float, int] | None = None  # time of the first samples, and their number
        self._sent_s = self._response_s = -np.inf
        self._n_periods = 0
        self._first = 0  # tick of the first pending sample
        self._pending: list[tuple[np.ndarray, ...]] = []
        self._peaks = dict.fromkeys(("command", "rate", "travel_deg"), 0.0)
        self._last: Progress | None = None

    def take(self, now: Progress) -> None:
        """Take the samples that have arrived, and send a set of figures when one is due.

        Parameters
        ----------
        now : Progress
        """
        self._pending.append((now.u, now.y, now.travel_deg))
        self._last = now
        self._begin = self._begin or (time.monotonic(), now.ticks)
        if time.monotonic() >= self._sent_s + 1 / PICTURES_HZ:
            self.flush()

    def flush(self) -> None:
        """Send the figures of the pending samples, if there are any."""
        now = self._last
        if now is None or not self._pending:
            return
        self._sent_s = time.monotonic()
        signals = [np.concatenate(part) for part in zip(*self._pending, strict=True)]
        self._pending = []
        n = len(signals[0])
        edges = np.unique(np.linspace(0, n, BINS + 1).astype(int))
        found: dict[str, Any] = {
            "ticks": now.ticks,
            "t_s": _rounded((self._first + edges[1:]) / self._frf.fs_hz, 9),
            "limits": vars(self._limits),
            "good": now.good,
            "spoiled": now.lost,
            "requested": now.requested,
            "periods": [int(good) for good in now.periods[-PERIODS_MOST:]],
            "left_s": self._left_s(now),
        }
        for name, values in zip(self._peaks, signals, strict=True):
            low, high = (_extremes(one, values, edges) for one in (np.fmin, np.fmax))
            found[name] = {"low": _rounded(low), "high": _rounded(high)}
            self._peaks[name] = float(np.nanmax(np.abs([*low, *high, self._peaks[name]])))
        found["peaks"] = dict(zip(self._peaks, _rounded(np.array(list(self._peaks.values()))), strict=True))
        self._first = now.ticks
        self._send(found | self._response())

    def _left_s(self, now: Progress) -> float | None:
        """Time until the requested periods are measured, at the speed so far."""
        begin_s, n_before = self._begin or (0.0, 0)
        if now.ticks == n_before:
            return None
        ticks = self._settle + (now.lost + now.requested) * self._frf.n_period - now.ticks
        return round(max(0, ticks) * (time.monotonic() - begin_s) / (now.ticks - n_before), 1)

    def _response(self) -> dict[str, Any]:
        n = self._frf.n_periods
        if n < 2 or n == self._n_periods or self._sent_s < self._response_s + RESPONSE_S:
            return {}
        self._n_periods, self._response_s = n, self._sent_s
        return {"response": response_figures(self._frf.result())}


def response_figures(frf: Frf) -> dict[str, Any]:
    """A response as lists of numbers.

    Parameters
    ----------
    frf : Frf

    Returns
    -------
    dict
        f_hz, magnitude, std (of the magnitude), phase_deg : list of float
        n_lines : int
    """
    n = len(frf.f_hz)
    chosen = np.arange(n)
    if n > LINES_MOST:
        at = np.geomspace(frf.f_hz[0], frf.f_hz[-1], LINES_MOST)
        chosen = np.unique(np.searchsorted(frf.f_hz, at).clip(0, n - 1))
    g = frf.g[chosen]
    return {
        "f_hz": _rounded(frf.f_hz[chosen], 9),
        "magnitude": _rounded(np.abs(g)),
        "std": _rounded(np.sqrt(frf.var_g[chosen] / 2)),  # var_g is that of both parts
        "phase_deg": _rounded(np.degrees(np.angle(g))),
        "n_lines": n,
    }


def _extremes(of: np.ufunc, values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Of each bin; not a number where the bin has no sample."""
    return of.reduceat(values, edges[:-1])


def _rounded(values: np.ndarray, digits: int = DIGITS) -> list[float | None]:
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in values.tolist()]
