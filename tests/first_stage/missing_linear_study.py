"""How often a linear effect that a given model lacks is named.

A trial is drawn from (seed, effect, number) alone, by linear_axes.py, and diagnosed twice: with a model whose
values are 5 % off, and 30 % off. Results stay in the folder; a study that was broken off goes on where it
stopped. Delete the results after a change of the diagnosis.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # two processes share the machine

import argparse
import json
import statistics
import time
from collections.abc import Collection, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import TYPE_CHECKING

import linear_axes as axes
import numpy as np
from first_stage_study import put_into

if TYPE_CHECKING:
    import gsid

TARGET = "missing-linear-study"
SEED, TRIALS = 5300, 100
OFF = (5, 30)  # percent
BUDGET_S = 600.0  # the answer shall not depend on what else runs
WEAK = 100.0  # drop below which an effect is hardly above noise
LAGS = ("motor_lag", "sensor_lag")
Row = dict


def judged(folder: Path, seed: int, effect: str, index: int, percent: int) -> Row:
    """The verdict of one trial, from its file if there is one."""
    path = folder / f"{seed}_{effect}_{index:04d}_{percent:02d}.json"
    if path.exists():
        return json.loads(path.read_text())
    trial = axes.drawn(seed, effect, index)
    row = {"seed": seed, "effect": effect, "index": index, "percent": percent, "drop": trial.drop}
    row |= {"hold": trial.hold, "declared": trial.declared, "output": trial.output, "axis": trial.axis}
    try:
        row |= answer(trial, percent)
    except Exception as error:
        row |= {"verdict": f"error: {error!r}", "effects": [], "cost": [np.nan, np.nan], "seconds": 0.0}
        row |= {"processor_s": 0.0}
    part = path.with_suffix(".part")
    part.write_text(json.dumps(row, default=float))
    part.replace(path)
    return row


def answer(trial: axes.Trial, percent: int) -> Row:
    """The verdict and its time."""
    import gsid

    stack = trial.start(np.random.default_rng([percent, trial.period_samples]), percent / 100)
    model = model_of(trial, stack)
    hold = trial.hold if trial.declared else None
    records = [gsid.Record(u, y, trial.fs_hz, trial.period_samples, 0, hold=hold) for u, y in trial.records]
    begin = time.perf_counter(), time.process_time()
    found = gsid.diagnose_records(records, model, time_s=BUDGET_S)
    return {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "found": [list(effects) for effects in found.found],
        "reasons": list(found.reasons),
        "cost": [found.cost_per_dof, found.cost_per_dof_after],
        "seconds": time.perf_counter() - begin[0],
        "processor_s": time.process_time() - begin[1],
    }


def model_of(trial: axes.Trial, values: axes.Values) -> gsid.PlantModel:
    """The model with the values of some effects."""
    import gsid
    from gsid.plant.effect import Effect, Param

    effects = [
        Effect(label.partition("#")[0], {name: Param(value) for name, value in params.items()})
        for label, params in values.items()
    ]
    return gsid.PlantModel(trial.fs_hz, effects, trial.output)


def is_named(row: Row) -> bool:
    """Whether the missing effect was named, a lag by either name."""
    return row["verdict"] == "missing_effect" and _is_right(row, row["effects"])


def has_another_name(row: Row) -> bool:
    """Whether something was named that is not missing, also beside the right name."""
    named = row["verdict"] == "missing_effect"
    return named and not all(_is_right(row, effects) for effects in [row["effects"], *row["found"]])


def _is_right(row: Row, effects: Collection[str]) -> bool:
    return bool(set(_right(row)) & set(effects))


def _right(row: Row) -> Collection[str]:
    return LAGS if row["effect"] == "lag" else (row["effect"],)


def described(row: Row) -> str:
    """One row in words."""
    answer = f"{row['verdict']} {' or '.join(row['effects'])}".strip()
    return (
        f"{row['seed']} {row['effect']} {row['index']}, {row['percent']} %: drop {row['drop']:.3g}, "
        f"{row['output']}, hold {row['hold']}{'' if row['declared'] else ' (not declared)'}; {answer}; "
        f"cost {row['cost'][0]:.3g} -> {row['cost'][1]:.3g}; {row['seconds']:.1f} s"
    )


def table(rows: list[Row], command: str) -> str:
    """The results as Markdown."""
    lines = [f"Made by `{command}`.", "", "| missing | " + " | ".join(f"{p} % off" for p in OFF)]
    lines[-1] += " | another name | drop, median (least) | median s | worst s |"
    lines.append("|---" * (len(OFF) + 5) + "|")
    for effect in axes.EFFECTS:
        own = [row for row in rows if row["effect"] == effect]
        if not own:
            continue
        cells = [effect]
        for percent in OFF:
            some = [row for row in own if row["percent"] == percent]
            cells.append(f"{sum(map(is_named, some))} of {len(some)}")
        wrong = sum(map(has_another_name, own))
        drops, times = [row["drop"] for row in own], [row["processor_s"] for row in own]
        cells += [str(wrong), f"{statistics.median(drops):.2g} ({min(drops):.0f})"]
        cells += [f"{statistics.median(times):.1f}", f"{max(times):.0f}"]
        lines.append("| " + " | ".join(cells) + " |")
    missed = [row for row in rows if not is_named(row)]
    weak = [row for row in rows if row["drop"] < WEAK]
    lines += ["", f"{len(weak)} of the {len(rows)} diagnoses are of an effect with a drop below {WEAK:g}."]
    lines[-1] += f" Of these {sum(map(is_named, weak))} named it."
    named = [row for row in rows if is_named(row)]
    wide = [row for row in named if set(row["effects"]) - set(_right(row))]
    lines[-1] += f" {len(wide)} of the {len(named)} names are groups with another effect in them."
    return "\n".join(
        [*lines, "", "Not named:", "", *([f"- {described(row)}" for row in missed] or ["- none"])]
    )


def main(arguments: Iterable[str] | None = None) -> None:
    """Run the trials that have no result yet, and write the table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--seed", type=int, default=SEED, help="1 to 999 while developing")
    parser.add_argument("--trials", type=int, default=TRIALS, help="of each effect")
    parser.add_argument("--effect", action="append", choices=axes.EFFECTS)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--page", type=Path, help="page to put the table into")
    parser.add_argument("--processes", type=int, default=1)
    args = parser.parse_args(arguments)
    args.folder.mkdir(parents=True, exist_ok=True)
    rows = []
    with ProcessPoolExecutor(args.processes) as pool:
        jobs = [
            pool.submit(judged, args.folder, args.seed, effect, index, percent)
            for index in range(args.trials)
            for effect in args.effect or axes.EFFECTS
            for percent in OFF
        ]
        for job in as_completed(jobs):
            rows.append(job.result())
            if not is_named(rows[-1]):
                print(described(rows[-1]), flush=True)
    rows.sort(key=lambda row: (axes.EFFECTS.index(row["effect"]), row["index"], row["percent"]))
    text = table(rows, f"make {TARGET} SEED={args.seed} N={args.trials}")
    print(text)
    if args.page:
        put_into(args.page, text, TARGET)


if __name__ == "__main__":
    main()
