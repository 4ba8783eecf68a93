"""The record of one measured realisation.

A record is the contents of one file: the samples of input and output, the sample rate and, if known, the
period of the excitation and the settling at the start. Unknown values are determined from the data.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gsid.base.arguments import printable_text, real_number, sample_rate, whole_samples
from gsid.base.errors import InputError
from gsid.base.plottable import Plottable
from gsid.base.tables import Table

if TYPE_CHECKING:
    import pandas

LARGEST = 1e100  # of a sample: above it, and below its inverse, sums of squares exceed the range of doubles


@dataclass(repr=False)
class Record(Plottable):
    """Samples of one realisation.

    Attributes
    ----------
    u, y : (n,) float64
        Input and output, units `u_unit` and `y_unit`. All values are finite.
    fs_hz : float
        Sample rate [Hz], > 0.
    period_samples, settle_samples : int or None
        Values from the file or the user; None: found from the data.
    valid : (n,) bool
        False for a lost sample. There, u and y are placeholders, not data (0 if the value was not finite).
        Default: all True.
    u_unit, y_unit : str
    hold : {"zoh", "none"} or None
        "zoh": u is a command that was held over each sample. "none": u is a signal without lines above half
        the sample rate. None: unknown; results that depend on the hold are fitted both ways
        (`gsid.base.hold`).
    name : str
    columns : dict of (n,) arrays
        Other columns of the file, for example `theta_deg`.
    meta : dict of str
        Other `# key: value` lines of the file.

    Raises
    ------
    InputError
        The lengths differ, a shape is not (n,), a value is not a finite real number, or the sample rate is
        not positive.
    TypeError, ValueError
        The sample rate is not a number, or the period or the settling is not a whole number.
    """

    u: np.ndarray
    y: np.ndarray
    fs_hz: float
    period_samples: int | None = None
    settle_samples: int | None = None
    valid: np.ndarray | None = None
    u_unit: str = ""
    y_unit: str = ""
    hold: str | None = None
    name: str = ""
    columns: dict[str, np.ndarray] = field(default_factory=dict)
    meta: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = np.size(self.u)
        self.valid = np.ones(n, bool) if self.valid is None else np.asarray(self.valid).astype(bool)
        self.u = self._samples("u", self.u)
        self.y = self._samples("y", self.y)
        for label, array in {"y": self.y, "valid": self.valid, **self.columns}.items():
            if np.shape(array) != self.u.shape:
                raise InputError(
                    f"u and {label} are of unequal lengths",
                    self.name,
                    f"{len(self.u)} and {np.size(array)} samples",
                    "export them from the same time span",
                )
        self.fs_hz = sample_rate(real_number("fs_hz", self.fs_hz, "Hz"), self.name)
        if self.hold not in ("zoh", "none", None):
            raise InputError("unknown hold", self.name, self.hold, "write zoh (a held command) or none")
        for name in ("u_unit", "y_unit"):
            printable_text(name, getattr(self, name), self.name)
        self.period_samples = whole_samples("period_samples", self.period_samples)
        self.settle_samples = whole_samples("settle_samples", self.settle_samples)

    def _samples(self, label: str, values: np.ndarray) -> np.ndarray:
        if np.iscomplexobj(values):
            raise InputError(
                f"{label} is complex",
                self.name,
                None,
                "give real samples; for a frequency response use gsid.Frf.from_arrays",
            )
        try:
            array = np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError) as error:
            hint = "give an array, Record(u, y, fs_hz)"
            raise InputError(f"{label} does not hold numbers", self.name, error, hint) from error
        if array.ndim != 1:
            raise InputError(
                f"{label} is not one row of samples",
                self.name,
                f"shape {array.shape}",
                "select one channel and one realisation first",
            )
        finite = np.isfinite(array)
        if finite.all():
            return array
        lost = ~self.valid if self.valid.shape == array.shape else np.zeros(array.shape, bool)
        bad = np.flatnonzero(~finite & ~lost)
        if bad.size:
            raise InputError(
                f"{label} is not finite",
                f"{self.name} sample {bad[0]}".strip(),
                array[bad[0]],
                "repair the sample, or mark it as lost with valid = 0",
            )
        return np.where(finite, array, 0.0)

    def __len__(self) -> int:
        return len(self.u)

    @property
    def t_s(self) -> np.ndarray:
        """Time of each sample, (n,) [s], from 0."""
        return np.arange(len(self.u)) / self.fs_hz

    def to_pandas(self) -> pandas.DataFrame:
        """Return one row per sample, indexed by t_s: u, y, valid and the other columns."""
        import pandas

        index = pandas.Index(self.t_s, name="t_s")
        return pandas.DataFrame({"u": self.u, "y": self.y, "valid": self.valid, **self.columns}, index=index)

    @classmethod
    def from_pandas(
        cls,
        frame: pandas.DataFrame,
        *,
        u: str = "u",
        y: str = "y",
        fs_hz: float | None = None,
        **facts: object,
    ) -> Record:
        """Make a record from a frame with one row per sample.

        Parameters
        ----------
        frame : pandas.DataFrame
            The column `valid` marks lost samples. Other columns are kept.
        u, y : str
            Names of the columns.
        fs_hz : float, optional
            Sample rate [Hz]; default: from the index, which must then hold equally spaced times [s].
        **facts
            Other fields of Record: period_samples, u_unit, hold, ...

        Raises
        ------
        InputError
            A column is missing, the times are not equally spaced, or the data are not valid for Record.
        """
        missing = [name for name in (u, y) if name not in frame.columns]
        if missing:
            there = ", ".join(map(str, frame.columns))
            raise InputError("a column is missing", "frame", missing[0], f"the frame has {there}")
        if fs_hz is None:
            steps = np.diff(np.asarray(frame.index, dtype=float))
            if len(steps) == 0 or not np.allclose(steps, steps.mean(), rtol=1e-3) or steps.mean() <= 0:
                raise InputError("the index does not hold equally spaced times", "frame", None, "give fs_hz")
            fs_hz = float(1 / steps.mean())
        others = {str(name): frame[name].to_numpy() for name in frame.columns if name not in (u, y, "valid")}
        valid = frame["valid"].to_numpy() if "valid" in frame.columns else None
        return cls(frame[u].to_numpy(), frame[y].to_numpy(), fs_hz, valid=valid, columns=others, **facts)

    def __repr__(self) -> str:
        lost = int(np.count_nonzero(~self.valid))
        length = f"{len(self)} samples at {self.fs_hz:g} Hz, {len(self) / self.fs_hz:.4g} s"
        period = f", period {self.period_samples}" if self.period_samples else ""
        return f"Record({self.name or 'unnamed'}: {length}{period}{f', {lost} lost' if lost else ''})"

    def _repr_html_(self) -> str:
        lost = int(np.count_nonzero(~self.valid))
        held = {"zoh": "held over each sample", "none": "not held", None: "not stated"}
        period = f"{self.period_samples} samples" if self.period_samples else "found from the data"
        rows = [
            ("samples", f"{len(self)} at {self.fs_hz:g} Hz, {len(self) / self.fs_hz:.4g} s; {lost} lost"),
            ("period", period),
            *((name, self._range(name)) for name in ("u", "y")),
            ("hold of u", held[self.hold]),
            *([("other columns", ", ".join(self.columns))] if self.columns else []),
        ]
        return Table((), rows, title=f"Record {self.name or 'unnamed'}").html()

    def _range(self, name: str) -> str:
        """Range and rms of u or y, without lost samples."""
        samples, unit = getattr(self, name)[self.valid], getattr(self, f"{name}_unit")
        if len(samples) == 0:
            return "no valid sample"
        rms = np.sqrt(np.mean(samples**2))
        return f"{samples.min():.4g} to {samples.max():.4g}, rms {rms:.4g} {unit}".rstrip()


def check_range(record: Record) -> None:
    """Refuse samples whose squares exceed the range of doubles.

    Raises
    ------
    InputError
        The largest sample of u or y is above 1e100, or below 1e-100 and not 0.
    """
    for name, samples in (("u", record.u), ("y", record.y)):
        peak = float(np.max(np.abs(samples), initial=0.0))
        if peak > LARGEST or 0 < peak < 1 / LARGEST:
            size = "large" if peak > LARGEST else "small"
            hint = f"write {name} in another unit, within 1e-100 .. 1e100"
            raise InputError(f"the samples of {name} are too {size}", record.name, f"peak {peak:.3g}", hint)
