"""What a fleet shows: missing effects, parameters over units and time, drifted units, outliers, groups."""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gsid.base.files import write_atomically
from gsid.fleet.statistics import Discoveries, Population, Tested, Values, discoveries, group_p, population
from gsid.fleet.table import PARAMETERS, UNITS
from gsid.fleet.unit import DONE

if TYPE_CHECKING:
    import pandas as pd

UNIT_FILE = "units.csv"
LEAST_MEASURED = 3  # units with a parameter, for its statistics


@dataclass(frozen=True)
class Parameter:
    """One parameter of one effect over the fleet.

    Attributes
    ----------
    label : str
        Effect and parameter.
    n_units, n_values : int
    population : Population
    group_p : float
        p-value of equal means of the groups; NaN if there are no groups.
    """

    label: str
    n_units: int
    n_values: int
    population: Population
    group_p: float


@dataclass(frozen=True)
class Flag:
    """A unit that differs.

    Attributes
    ----------
    unit, parameter : str
    change, std : float
        Its drift, or its deviation from the fleet: relative where `is_relative`.
    is_relative : bool
    q : float
        Smallest false discovery rate at which it is reported.
    """

    unit: str
    parameter: str
    change: float
    std: float
    is_relative: bool
    q: float

    def __str__(self) -> str:
        return f"unit {self.unit}: {self.parameter} {self.amount}"

    @property
    def amount(self) -> str:
        """Change with its standard deviation."""
        if self.is_relative:
            return f"{self.change:+.1%} ± {self.std:.1%}"
        return f"{self.change:+.3g} ± {self.std:.2g}"


@dataclass(frozen=True)
class Findings:
    """What a fleet shows.

    Attributes
    ----------
    units : list of str
        In the order of the tests.
    n_status : dict of int
        Measurements by status.
    n_missing : dict of int
        Measurements by the missing effect, or by the verdict where none is named.
    parameters : list of Parameter
    drifted, outliers : list of Flag
    fdr : float
    """

    units: list[str]
    n_status: dict[str, int]
    n_missing: dict[str, int]
    parameters: list[Parameter]
    drifted: list[Flag] = field(default_factory=list)
    outliers: list[Flag] = field(default_factory=list)
    fdr: float = 0.01


def find(folder: str | Path, fdr: float) -> Findings:
    """Read the tables of a fleet, test its units, and write `units.csv`.

    Parameters
    ----------
    folder : path
        With the tables of :func:`gsid.fleet.table.merge`.
    fdr : float
        False discovery rate of drifted units, and of outliers.
    """
    import pandas as pd

    units = pd.read_parquet(Path(folder) / UNITS)
    rows = pd.read_parquet(Path(folder) / PARAMETERS)
    names = sorted(units["unit"].unique())
    said = units.loc[units["status"] == DONE]
    missing = said["missing"].fillna(said["verdict"]).dropna()
    parameters = _parameters(rows, names)
    found = Findings(
        names,
        units["status"].value_counts().to_dict(),
        missing.value_counts().to_dict(),
        parameters,
        _flags(names, parameters, [one.population.drift for one in parameters], fdr),
        _flags(names, parameters, [one.population.outlier for one in parameters], fdr),
        fdr,
    )
    table = unit_table(found, units)
    write_atomically(Path(folder) / UNIT_FILE, lambda part: table.to_csv(part, index=False))
    return found


def unit_table(found: Findings, units: pd.DataFrame) -> pd.DataFrame:
    """One row for each unit, to join with other tables of the factory."""
    latest = units.drop_duplicates("unit", keep="last").set_index("unit").loc[found.units]
    table = latest[["group", "status", "verdict", "missing", "failure"]].reset_index()
    for name, flags in (("drift", found.drifted), ("outlier", found.outliers)):
        by_unit = {flag.unit: flag for flag in flags}
        of_unit = [by_unit.get(unit) for unit in table["unit"]]
        table[name] = [flag is not None for flag in of_unit]
        for column in ("parameter", "change", "std", "q"):
            table[f"{name}_{column}"] = [getattr(flag, column, None) for flag in of_unit]
    return table


def _parameters(rows: pd.DataFrame, names: Sequence[str]) -> list[Parameter]:
    good = rows[np.isfinite(rows["value"]) & np.isfinite(rows["std"]) & (rows["std"] > 0)]
    number = {name: i for i, name in enumerate(names)}
    found = []
    for (effect, name), some in good.groupby(["effect", "parameter"]):
        unit = some["unit"].map(number).to_numpy()
        if len(set(unit)) < LEAST_MEASURED:
            continue
        values = Values(
            unit, some["value"].to_numpy(float), some["std"].to_numpy(float), times_of(some["time"])
        )
        whole = population(values, len(names))
        group = some.assign(number=unit).drop_duplicates("number").set_index("number")["group"].dropna()
        p = group_p(whole.outlier.estimate[group.index], whole.outlier.std[group.index], group.to_numpy(str))
        found.append(Parameter(f"{effect} {name}", len(set(unit)), len(some), whole, p))
    return found


def times_of(texts: Sequence[str | None]) -> np.ndarray:
    """Times as numbers: numbers as they are, dates in days; NaN where it is neither."""
    return np.array([_time(text) for text in texts])


def _time(text: str | None) -> float:
    if not isinstance(text, str):
        return math.nan
    try:
        number = float(text)
        return number if math.isfinite(number) else math.nan
    except ValueError:
        pass
    try:
        when = datetime.datetime.fromisoformat(text)
    except ValueError:
        return math.nan
    return when.replace(tzinfo=when.tzinfo or datetime.UTC).timestamp() / 86400


def _flags(
    names: Sequence[str], parameters: Sequence[Parameter], tested: Sequence[Tested], fdr: float
) -> list[Flag]:
    if not tested:
        return []
    found: Discoveries = discoveries(np.array([one.p for one in tested]), fdr)
    flags = []
    for unit, i, q in zip(found.units, found.parameter, found.q, strict=True):
        change, std = float(tested[i].estimate[unit]), float(tested[i].std[unit])
        is_log = parameters[i].population.is_log
        if is_log:  # of a logarithm
            change, std = math.expm1(change), std * math.exp(change)
        flags.append(Flag(names[unit], parameters[i].label, change, std, is_log, q))
    return flags
