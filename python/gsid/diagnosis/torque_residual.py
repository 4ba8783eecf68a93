"""The missing torque against rate, angle, command and time: a hint at the missing law, not a verdict.

The mean error of the output is deconvolved by the model's linear part with a Wiener filter (DIA-7):
tau = conj(G) E / (|G|^2 + s^2 / (P S)). G is the response from torque to output, s^2 / P the variance of the
mean, and S the power of a line of the torque, estimated from the excess of the error over noise. The torque
is shown against time, and averaged over bins of rate, angle or command along the simulated trajectory. Rate,
angle and command are correlated, and the free parameters of the fit have absorbed what they can imitate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsid.base.plottable import Plottable
from gsid.effects.custom import table
from gsid.effects.table_file import TORQUE, short_name, write_table
from gsid.effects.types import EffectType
from gsid.greybox.weights import lines_used, pooled_variance
from gsid.plant.model import PlantModel
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra

BINS = 30
BINS_OF_TIME = 100
OCCUPIED = 1e-3  # least share of the samples in a bin


@dataclass(eq=False)
class Curve:
    """Missing torque against one coordinate.

    Attributes
    ----------
    name, unit : str
        Name and unit of the coordinate.
    at : (b,) ndarray
        Centre of each bin.
    torque, std : (b,) ndarrays
        Mean over the bin, and its standard deviation due to noise, in the unit of :class:`TorqueResidual`.
    share : (b,) ndarray
        Share of the samples in each bin.
    explained : float
        Share of the mean square of the torque that the curve explains; large for a law of this coordinate.
    """

    name: str
    unit: str
    at: np.ndarray
    torque: np.ndarray
    std: np.ndarray
    share: np.ndarray
    explained: float

    def to_effect(self) -> EffectType:
        """Convert the curve into an effect, with reversed sign: a law gives the torque against the motion."""
        return table((self.name, self.at, -self.torque), unit=self.unit)

    def save(self, path: str | Path) -> None:
        """Write the curve as a CSV file for `gsid.effects.table` and `gsid add --table`.

        A curve against time is not a law and cannot be used in this way.

        Parameters
        ----------
        path : path
        """
        columns = {short_name(self.name): self.at, TORQUE: -self.torque, "std": self.std, "share": self.share}
        notes = {"unit": self.unit, "explained": f"{self.explained:.3g}"}
        write_table(path, columns, notes)


@dataclass(eq=False, repr=False)
class TorqueResidual(Plottable):
    """Result of :func:`torque_residual`.

    Attributes
    ----------
    rate, angle, command, time : Curve
        Curves over all records, except `time`, which is over one period of the first record.
    rms : float
        Rms of torque / inertia, in `unit`.
    unit : str
        Angle / s^2.
    """

    rate: Curve
    angle: Curve
    command: Curve
    time: Curve
    rms: float
    unit: str

    @property
    def curves(self) -> list[Curve]:
        """All four."""
        return [self.rate, self.angle, self.command, self.time]

    @property
    def best(self) -> Curve:
        """The curve that explains most of the torque, without the curve against time."""
        return max((self.rate, self.angle, self.command), key=lambda curve: curve.explained)

    @property
    def sentence(self) -> str:
        """The size of the missing torque and the coordinate it depends on, as a sentence."""
        best = self.best
        others = ", ".join(f"{c.name} {c.explained:.0%}" for c in self.curves[:3] if c is not best)
        share = f"{best.explained:.0%} of it depends on the {best.name} ({others})"
        return f"The missing torque has an rms of {self.rms:.3g} {self.unit}; {share}."

    def __repr__(self) -> str:
        shares = ", ".join(f"{curve.name} {curve.explained:.0%}" for curve in self.curves)
        return f"TorqueResidual(rms {self.rms:.3g} {self.unit}; explained by {shares})"


@dataclass(eq=False)
class _Path:
    """Torque lines of one record with their variance, and the model's trajectory."""

    n: int
    line: np.ndarray
    torque: np.ndarray
    variance: np.ndarray
    coordinates: dict[str, np.ndarray]


def torque_residual(
    model: PlantModel,
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    band: tuple[float, float] | None = None,
    along: PlantModel | None = None,
) -> TorqueResidual:
    """Estimate the torque that explains the difference of model and measurement (DIA-7).

    Parameters
    ----------
    model : PlantModel
        A model fitted to the records.
    records : Record or Spectra, or a sequence of them
    band : (lo, hi), optional
        Hz; default as in `gsid.fit_plant`. The mean torque is left out.
    along : PlantModel, optional
        Gives the trajectory; default the model itself. A model with the missing law moves more like the axis.

    Returns
    -------
    TorqueResidual

    Raises
    ------
    ValueError, InputError, GsidError
        As `gsid.fit_plant`.
    """
    measured = spectra_of(records)
    variances = pooled_variance(measured)
    paths = [_path(model, along or model, s, v, band) for s, (v, _) in zip(measured, variances, strict=True)]
    total = sum(path.n * float(np.sum(np.abs(path.torque) ** 2)) / 2 for path in paths)
    units = {"rate": f"{model.angle_unit}/s", "angle": model.angle_unit, "command": model.u_unit}
    if not units["command"] and not model.has_controller:  # whose input is the reference
        units["command"] = measured[0].u_unit
    time = np.arange(paths[0].n) / measured[0].fs_hz
    paths[0].coordinates["time"] = time
    return TorqueResidual(
        **{name: _curve(name, unit, paths, BINS) for name, unit in units.items()},
        time=_curve("time", "s", paths[:1], BINS_OF_TIME),
        rms=float(np.sqrt(total / sum(path.n for path in paths))),
        unit=f"{model.angle_unit}/s²",
    )


def _path(
    model: PlantModel,
    along: PlantModel,
    s: Spectra,
    variance: np.ndarray,
    band: tuple[float, float] | None,
) -> _Path:
    use = lines_used(model, s, band) & (s.line > 0)
    answer = model.predict(s)
    error, noise = (s.y - answer.Y)[use], variance[use] / s.n_periods
    g = model.linear_response(s, use).torque
    # The assumed torque is at least that of noise: without an excess, noise is halved and not amplified.
    excess = max(float(np.sum(np.abs(error) ** 2 - noise)), float(np.sum(noise)))
    back = np.conj(g) / (np.abs(g) ** 2 + noise * np.sum(np.abs(g) ** 2) / excess)
    delay = model.stack().get("transport_delay", {}).get("delay_s", 0.0)
    moved = answer if along is model else along.predict(s)
    command = np.roll(model.drive_command(s, moved), round(delay * s.fs_hz))  # as it arrives
    return _Path(
        n=s.period_samples,
        line=s.line[use],
        torque=back * error,
        variance=np.abs(back) ** 2 * noise,
        coordinates={"rate": moved.rate, "angle": moved.angle, "command": command},
    )


def _curve(name: str, unit: str, paths: list[_Path], n_bins: int) -> Curve:
    values = [path.coordinates[name] for path in paths]
    low, high = min(v.min() for v in values), max(v.max() for v in values)
    edges = np.linspace(low, high, n_bins + 1)
    count, total, variance = np.zeros((3, n_bins))
    for path, value in zip(paths, values, strict=True):
        index = np.clip(np.digitize(value, edges) - 1, 0, n_bins - 1)
        inside = index[None, :] == np.arange(n_bins)[:, None]
        # Sum of the torque over the samples of a bin, for each line, so that the variance can be summed too.
        sums = np.conj(np.fft.rfft(inside, axis=1)[:, path.line])
        count += inside.sum(axis=1)
        total += (sums @ path.torque).real
        variance += np.abs(sums) ** 2 @ path.variance / 2
    n = count.sum()
    kept = count >= max(1.0, OCCUPIED * n)
    count, total, variance = count[kept], total[kept], variance[kept]
    power = sum(path.n * float(np.sum(np.abs(path.torque) ** 2)) / 2 for path in paths)
    return Curve(
        name=name,
        unit=unit,
        at=(edges[:-1] + np.diff(edges) / 2)[kept],
        torque=total / count,
        std=np.sqrt(variance) / count,
        share=count / n,
        explained=float(np.sum(total**2 / count)) / power if power > 0 else 0.0,
    )
