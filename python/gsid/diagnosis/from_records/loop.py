"""The controller of a closed loop, from the reference, the output and the command that were recorded.

In a closed loop a simulated axis drifts away from the measured motion if it is driven by the measured
command. Driven by the reference, with the controller around it, it does not. The controller is no guess: its
input and its output are both measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid._lib import lib
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.plant.effect import Effect, Param
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra

LOOP = "position_velocity_loop"


def referenced(records: Sequence[Record], measured: Sequence[Spectra], reference: str) -> list[Spectra]:
    """The same periods with the reference as the input.

    Parameters
    ----------
    records : sequence of Record
    measured : sequence of Spectra
        Of these records; they have their period and their settling.
    reference : str
        Column of the reference.
    """
    return spectra_of([_settled(*both, reference) for both in zip(records, measured, strict=True)])


def _settled(record: Record, one: Spectra, reference: str) -> Record:
    how = {"period_samples": one.period_samples, "settle_samples": one.settle_samples}
    return replace(record, u=record.columns[reference], u_unit="", **how)


def identified_loop(
    records: Sequence[Record], measured: Sequence[Spectra], reference: str, settings: DecisionSettings
) -> Effect | None:
    """The position loop around a velocity loop that gives the measured command; None if none does.

    u = kv (kp (reference - angle) - rate) + constant is linear in kv kp and kv. The rate is the change of the
    output over as many samples as leave least.

    Parameters
    ----------
    records, measured, reference
        As `referenced`.
    settings : DecisionSettings
    """
    fits = [_fitted(records, measured, reference, n) for n in range(1, int(lib.GSID_RATE_SAMPLES_MAX) + 1)]
    left, n_samples, (by_angle, kv) = min(fits)
    if left > settings.loop_error or kv == 0 or by_angle / kv <= 0:
        return None
    values = {"kp": by_angle / kv, "kv": kv, "limit": 0.0, "rate_samples": float(n_samples)}
    return Effect(LOOP, {name: Param(value, free=False) for name, value in values.items()})


def _fitted(
    records: Sequence[Record], measured: Sequence[Spectra], reference: str, n_samples: int
) -> tuple[float, int, tuple[float, float]]:
    """Rms of the command that is left, over its rms, and the gains, with a rate over so many samples."""
    rows, commands = [], []
    for record, one in zip(records, measured, strict=True):
        at = np.arange(max(one.settle_samples, n_samples), len(record.u))
        at = at[record.valid[at] & record.valid[at - n_samples]]
        y = record.y
        rate = (y[at] - y[at - n_samples]) * record.fs_hz / n_samples
        part = np.stack([record.columns[reference][at] - y[at], -rate], axis=1)
        rows.append(part - part.mean(axis=0))
        commands.append(record.u[at] - record.u[at].mean())
    columns, command = np.concatenate(rows), np.concatenate(commands)
    gains, *_ = np.linalg.lstsq(columns, command, rcond=None)
    left = float(np.std(command - columns @ gains) / np.std(command))
    return left, n_samples, (float(gains[0]), float(gains[1]))
