"""How often `gsid fleet` reports units of fleets in which nothing drifts, and finds one that does.

A fleet has 300 units with six parameters, measured at two or three times. Units differ by 5 %, repeated
measurements scatter by 2 % beyond the standard deviations of their fits, which differ from fit to fit. In
half of the fleets one unit's spring becomes 30 % stiffer from its first to its last measurement.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from gsid.fleet.findings import Findings, find
from gsid.fleet.table import PARAMETERS, UNITS

NAMES = (
    ("spring", "stiffness"),
    ("viscous_friction", "rate"),
    ("coulomb_friction", "level"),
    ("motor", "gain"),
    ("delay", "delay_s"),
    ("mode", "f_hz"),
)
DRIFTED = "SN0217"
BETWEEN, WITHIN, STD = 0.05, 0.02, 0.01  # relative
RISE = 1.3


def write_fleet(folder: Path, rng: np.random.Generator, *, n: int, n_times: int, drifts: bool) -> None:
    """Write the tables that `gsid fleet` merges, of a simulated fleet."""
    rows = []
    for i in range(n):
        centre = {name: 10.0 * np.exp(rng.normal(0, BETWEEN)) for name in NAMES}
        for k in range(n_times):
            shared = {
                "unit": f"SN{i:04d}",
                "time": f"2026-{k + 1:02d}-01",
                "group": f"line{i % 2}",
                "key": f"{i}-{k}",
            }
            for effect, name in NAMES:
                value = centre[effect, name] * np.exp(rng.normal(0, WITHIN))
                if drifts and shared["unit"] == DRIFTED and effect == "spring":
                    value *= RISE ** (k / (n_times - 1))
                std = value * STD * np.exp(rng.normal(0, 0.5))
                value += rng.normal(0, std)
                named = {"status": "done", "verdict": "adequate", "effect": effect, "parameter": name}
                rows.append(shared | named | {"value": value, "std": std, "version": "study"})
    table = pd.DataFrame(rows)
    table.to_parquet(folder / PARAMETERS)
    units = table.drop_duplicates("key").drop(columns=["effect", "parameter", "value", "std"])
    units.assign(missing=None, failure=None).to_parquet(folder / UNITS)


def findings_of(seed: int, *, n: int, n_times: int, drifts: bool, fdr: float = 0.01) -> Findings:
    """What is found in a simulated fleet."""
    with tempfile.TemporaryDirectory() as folder:
        rng = np.random.default_rng([seed, n_times, drifts])
        write_fleet(Path(folder), rng, n=n, n_times=n_times, drifts=drifts)
        return find(folder, fdr)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", type=int, default=50)
    parser.add_argument("--units", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    for n_times in (2, 3):
        nulls, planted = (
            [
                findings_of(args.seed * 1000 + i, n=args.units, n_times=n_times, drifts=drifts)
                for i in range(args.fleets)
            ]
            for drifts in (False, True)
        )
        false = [sum(flag.unit != DRIFTED for flag in one.drifted) for one in nulls + planted]
        hits = [any(flag.unit == DRIFTED for flag in one.drifted) for one in planted]
        named = [
            one.drifted[0].parameter for one in planted if one.drifted and one.drifted[0].unit == DRIFTED
        ]
        figures = {
            "study": "drift",
            "seed": args.seed,
            "times": n_times,
            "units": args.units,
            "fleets": args.fleets,
            "null_fleets_with_drift": sum(bool(one.drifted) for one in nulls),
            "null_fleets_with_outliers": sum(bool(one.outliers) for one in nulls),
            "null_units_reported": sum(len(one.drifted) for one in nulls),
            "found": sum(hits),
            "spring_named": sum(name == "spring stiffness" for name in named),
            "others_reported": sum(false),
        }
        print(json.dumps(figures), flush=True)


if __name__ == "__main__":
    main()
