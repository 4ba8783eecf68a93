"""How often a linear effect is named where none is missing: nothing, or a law that is not linear.

Axes are those of linear_axes.py without spring or damping, and the model lacks nothing else. A law
of the catalogue acts on the axis, simulated by gsid, with a strength drawn by what it changes in noise units.
In every second round of laws its family is taken out of the catalogue. A linear name is right only if that
effect, fitted to the answer without noise, leaves less than CLEAR. Results stay in the folder; a study that
was broken off goes on where it stopped.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # other studies may run

import argparse
import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import linear_axes as axes
import numpy as np
from first_stage_study import put_into
from missing_linear_study import BUDGET_S, Row

import gsid
from gsid.base.errors import GsidError
from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.missing_torque.catalogue import family
from gsid.effects.types import catalogue, find
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel

TARGET = "linear-names-study"
SEED, TRIALS = 5400, 60
CHANGE = (150.0, 5000.0)  # of the law in the output [noise units], before any fit
LAWS = (
    None,
    "coulomb_friction",
    "quadratic_drag",
    "cubic_spring",
    "motor_cogging",
    "presliding_friction",
    "drive_dead_zone",
    "drive_saturation",
    "stribeck_friction",
)
OUTCOMES = ("none", "unknown", "nearest", "the law", "equal linear effect", "LINEAR NAME", "another name")


# ---- trials ----------------------------------------------------------------------------------------


def model_of(stack: axes.Values, fs_hz: float, output: str) -> PlantModel:
    effects = [
        Effect(label.partition("#")[0], {name: Param(float(value)) for name, value in params.items()})
        for label, params in stack.items()
    ]
    return PlantModel(fs_hz, effects, output)


def values_of(
    law: str, share: float, torque: float, angle: float, rate: float, u: np.ndarray, shape: float
) -> dict:
    """Values of a law whose torque is about a share of the motor's; the shape is from 0 to 1."""
    level, spread = share * torque, 0.05 * 20**shape
    return {
        "coulomb_friction": {"level": level},
        "quadratic_drag": {"rate": level / rate**2},
        "cubic_spring": {"stiffness": level / angle**3},
        "motor_cogging": {"level": level, "cycles_per_rev": 60 / (angle * spread), "phase_rad": 6 * shape},
        "presliding_friction": {"level": level, "stiffness": 1 / (angle * spread)},
        "drive_dead_zone": {"half_width": share * np.std(u)},
        "drive_saturation": {"limit": np.max(np.abs(u)) * (1 - min(share, 0.9))},
        "stribeck_friction": {"level": level, "extra": level / 2, "velocity": rate * spread},
    }[law]


def drawn(seed: int, index: int) -> tuple[axes.Trial, axes.Values, str | None, float, list]:
    """An axis, its stack, the law, the noise over the output's rms, and (u, y) of each record without it."""
    rng = np.random.default_rng([seed, index])
    law = LAWS[index % len(LAWS)]
    while True:
        lacks = str(rng.choice(["cable_spring", "viscous_friction"]))
        trial = axes.drawn(seed, lacks, int(rng.integers(1 << 20)))
        stack = trial.lacking
        if "cable_spring" in stack and "viscous_friction" not in stack:
            continue  # it would not settle
        try:
            noise = 10 ** (-rng.uniform(15, 55) / 20)
            return trial, stack, law, noise, answers(trial, stack, law, noise, rng)
        except (GsidError, axes.DrawError):
            continue


def answers(
    trial: axes.Trial, stack: axes.Values, law: str | None, noise: float, rng: np.random.Generator
) -> list[tuple[np.ndarray, np.ndarray]]:
    """One period of u and of the simulated y of each record, with the law in the strength that was drawn."""
    n = trial.period_samples
    u = [one[:n] for one, _ in trial.records]
    base = model_of(stack, trial.fs_hz, trial.output)
    before = [base.simulate(one).y for one in u]
    if law is None:
        return list(zip(u, before, strict=True))
    motion = [model_of(stack, trial.fs_hz, output).simulate(u[0]).y for output in ("angle", "rate")]
    angle, rate = (1.7 * np.std(one) for one in motion)
    torque = stack["rigid_body"]["gain"] * np.std(u[0])
    share, shape, wanted = 0.03, rng.random(), np.exp(rng.uniform(*np.log(CHANGE)))
    n_periods = len(trial.records[0][0]) // n
    for _ in range(4):
        law_values = values_of(law, share, torque, angle, rate, u[0], shape)
        y = [base.with_effect(law, law_values).simulate(one).y for one in u]
        power = [np.var(a - b) * n**2 / 2 / np.var(b) for a, b in zip(y, before, strict=True)]
        change = 2 * n_periods * sum(power) / (n * noise**2)
        if abs(np.log(change / wanted)) < 0.3:
            return list(zip(u, y, strict=True))
        share = float(np.clip(share * np.sqrt(wanted / max(change, 1e-9)), 1e-6, 0.6))
    raise axes.DrawError


# ---- verdicts --------------------------------------------------------------------------------------


def judged(folder: Path, seed: int, index: int) -> Row:
    """The verdict of one trial, from its file if there is one."""
    path = folder / f"{seed}_{index:04d}.json"
    if path.exists():
        return json.loads(path.read_text())
    trial, stack, law, noise, clean = drawn(seed, index)
    rng = np.random.default_rng([seed, index, 1])
    off = (0.05, 0.3)[index % 2]
    start = {e: {n: v * (1 + off * rng.choice([-1, 1])) for n, v in p.items()} for e, p in stack.items()}
    out = [one.id for one in catalogue().values() if law and family(one) == family(find(law))]
    out = out if (index // len(LAWS)) % 2 else []
    n_periods = len(trial.records[0][0]) // trial.period_samples
    records = []
    for u, y in clean:
        measured = np.tile(y, n_periods) + noise * np.std(y) * rng.standard_normal(n_periods * len(y))
        u_all = np.tile(u, n_periods)
        records.append(gsid.Record(u_all, measured, trial.fs_hz, trial.period_samples, 0, hold="zoh"))
    model = model_of(start, trial.fs_hz, trial.output)
    found = gsid.diagnose_records(records, model, without=out, time_s=BUDGET_S)
    row = {"seed": seed, "index": index, "law": law, "removed": bool(out), "verdict": found.verdict}
    row |= {"found": [list(one) for one in found.found] or [list(found.effects)], "left": None}
    row["cost"] = [found.cost_per_dof, found.cost_per_dof_after]
    linear = [one[0] for one in row["found"] if one and is_linear(one[0])]
    if found.verdict == "missing_effect" and linear and law:
        row["left"] = left_by(trial, found.model, clean, noise)
    path.write_text(json.dumps(row, default=float))
    return row


def left_by(trial: axes.Trial, model: PlantModel | None, clean: list, noise: float) -> float | None:
    """Cost that a linear model leaves of the answers without noise, fitted to them."""
    if model is None or not all(is_linear(one.id) or one.id == "rigid_body" for one in model.effects):
        return None
    n, fs_hz = trial.period_samples, trial.fs_hz
    U, Y = (np.fft.rfft([record[i] for record in clean]) for i in (0, 1))
    n_periods = len(trial.records[0][0]) // n
    weight = np.sqrt(2 * n_periods / n) / (noise * np.std([y for _, y in clean], axis=1))
    excited = np.flatnonzero(np.abs(U[0]) > 1e-6 * np.max(np.abs(U[0])))
    between = np.setdiff1d(np.arange(excited[0], excited[-1]), excited)
    line = excited[:: max(len(excited) // axes.FITTED, 1)]
    share = np.sqrt(len(excited) / len(line))
    stack = {label: {name: p.value for name, p in one.params.items()} for label, one in model.labels()}
    measured = [(u[line], y[line]) for u, y in zip(U, Y, strict=True)]
    weights = [np.full(len(line), share * one) for one in weight]
    left, _ = axes.refitted(stack, line * fs_hz / n, fs_hz, trial.output, "zoh", measured, weights)
    return left + float(np.sum(np.abs(weight[:, None] * Y[:, between]) ** 2))


def outcome(row: Row) -> str:
    """One of `OUTCOMES`."""
    if row["verdict"] != "missing_effect":
        return {"adequate": "none", "unknown_effect": "unknown", "nearest_effect": "nearest"}[row["verdict"]]
    others = [effects for effects in row["found"] if row["law"] not in effects]
    if not others:
        return "the law"
    if not any(is_linear(effect) for effects in others for effect in effects):
        return "another name"
    left = row["left"]
    return "equal linear effect" if left is not None and left < axes.CLEAR else "LINEAR NAME"


# ---- table -----------------------------------------------------------------------------------------


def table(rows: list[Row], command: str) -> str:
    """The results as Markdown."""
    groups = {
        "nothing missing": [row for row in rows if row["law"] is None],
        "a law": [row for row in rows if row["law"] and not row["removed"]],
        "a law, its family taken out": [row for row in rows if row["removed"]],
    }
    lines = [f"Made by `{command}`.", "", "| missing | n | " + " | ".join(OUTCOMES) + " |"]
    lines.append("|---" * (len(OUTCOMES) + 2) + "|")
    for title, some in groups.items():
        counts = Counter(map(outcome, some))
        cells = [str(counts[one] or "") for one in OUTCOMES]
        lines.append(f"| {title} | {len(some)} | " + " | ".join(cells) + " |")
    bad = [described(row) for row in rows if outcome(row) in ("LINEAR NAME", "another name")]
    return "\n".join([*lines, "", "Wrong names:", "", *(bad or ["- none"])])


def described(row: Row) -> str:
    """One row in words."""
    names = ", then ".join(" or ".join(one) for one in row["found"])
    left = "" if row["left"] is None else f", leaves {row['left']:.0f}"
    law = f"{row['law'] or 'nothing'}{', family taken out' if row['removed'] else ''}"
    cost = " -> ".join(f"{one:.3g}" for one in row["cost"])
    return f"- {row['seed']} {row['index']}: {law}; {names}{left}; cost {cost}"


def main(arguments: Iterable[str] | None = None) -> None:
    """Run the trials that have no result yet, and write the table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--seed", type=int, default=SEED, help="1 to 999 while developing")
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--page", type=Path, help="page to put the table into")
    args = parser.parse_args(arguments)
    args.folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for index in range(args.trials):
        rows.append(judged(args.folder, args.seed, index))
        if outcome(rows[-1]) in ("LINEAR NAME", "another name"):
            print(described(rows[-1]), flush=True)
    text = table(rows, f"make {TARGET} SEED={args.seed} N={args.trials}")
    print(text)
    if args.page:
        put_into(args.page, text, TARGET)


if __name__ == "__main__":
    main()
