"""How often the diagnosis from the records alone is right, on trials of the blind study's simulator.

Each single effect is diagnosed as it is, and once more with its whole family taken out of the catalogue:
whatever is named then is wrong. A linear effect (spring, lag, mode, a held sensor) is a part of the structure
that is found from the records: nothing is missing then. Records and results stay in the folder; a study that
was broken off goes on where it stopped. Delete the results (not the records) after a change of the diagnosis.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # times are those of one core

import json
import statistics
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from first_stage_study import drawn, study

import gsid
from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.missing_torque.catalogue import family
from gsid.effects.types import catalogue
from gsid.records.files import read_record
from gsid.spectrum.realisation import spectra_of

SEED = 21610
CLEAR = 64.0  # predicted drop from which an effect has to be found
COLUMNS = (
    "named right",
    "nearest right",
    "in the structure",
    "none",
    "unknown",
    "nearest wrong",
    "WRONG NAME",
)
WORD = {
    "missing_effect": "named",
    "nearest_effect": "nearest",
    "unknown_effect": "unknown",
    "adequate": "none",
}
BUDGET_S = 600.0  # the answer shall not depend on what else runs; the processor time is in the table
BACKLASH = "gear_backlash"
Row = dict


def judged(place: Path, kind: str, index: int, seed: int) -> list[Row]:
    """Rows of one trial: as it is, and with the family of its effect taken out."""
    key = json.loads((place / "key.json").read_text())
    measured = spectra_of([read_record(path) for path in sorted(place.glob("fit_*.npz"))])
    hidden = [effect["id"] for effect in key["effects"]]
    row = {"seed": seed, "index": index, "kind": kind, "hidden": hidden}
    row["drop"] = sum(key["predicted_drop"] or [0])
    rows = [row | answer(measured, ())]
    if kind == "single" and row["drop"] >= CLEAR and not is_linear(hidden[0]) and hidden[0] != BACKLASH:
        out = {e.id for e in catalogue().values() if family(e) == family(catalogue()[hidden[0]])}
        rows.append(row | {"kind": "removed"} | answer(measured, out))
    return rows


def answer(measured, without) -> Row:
    """The verdict and its time."""
    begin = time.perf_counter(), time.process_time()
    found = gsid.diagnose_records(measured, without=without, time_s=BUDGET_S)
    return {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "structure": [label for label, _ in found.model.labels()] if found.model else [],
        "found": [list(effects) for effects in found.found],
        "ranking": [
            [" or ".join(one.effects), one.cost_per_dof_after, one.share_kept_out, one.margin, one.by]
            for one in found.ranking[:6]
        ],
        "reasons": list(found.reasons),
        "cost": [found.cost_per_dof, found.cost_per_dof_after],
        "p_value": found.p_value,
        "seconds": found.seconds,
        "wall_s": time.perf_counter() - begin[0],
        "processor_s": time.process_time() - begin[1],
    }


def run(folder: Path, seed: int, counts: dict[str, int]) -> list[Row]:
    """All rows; those that are there already are not made again."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "from_records.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {(row["seed"], row["kind"], row["index"]) for row in rows}
    for kind, n in counts.items():
        for index in range(n):
            if (seed, kind, index) in done:
                continue
            new = judged(drawn(folder, seed, kind, index), kind, index, seed)
            with path.open("a") as out:
                out.writelines(json.dumps(row) + "\n" for row in reversed(new))  # the trial itself last
            rows += new
            print(*(described(row) for row in new), sep="\n", flush=True)
    return [row for row in rows if row["seed"] == seed and row["kind"] in (*counts, "removed")]


def outcome(row: Row) -> str:
    """One of `COLUMNS`."""
    word, hidden = WORD[row["verdict"]], row["hidden"]
    if word in ("named", "nearest"):
        right = bool(set(row["effects"]) & set(hidden)) and row["kind"] != "removed"
        return f"{word} right" if right else "nearest wrong" if word == "nearest" else "WRONG NAME"
    linear = hidden and all(is_linear(effect) for effect in hidden)
    return "in the structure" if word == "none" and linear and row["kind"] != "removed" else word


def described(row: Row) -> str:
    """One row in words."""
    hidden = ", ".join(row["hidden"]) or "nothing"
    said = f"{WORD[row['verdict']]} {' or '.join(row['effects'])}".strip()
    return (
        f"{row['seed']} {row['kind']} {row['index']}: {hidden}, drop {row['drop']:.0f}; {said}; "
        f"cost {row['cost'][0]:.3g} -> {row['cost'][1]:.3g}; {row['wall_s']:.1f} s; {outcome(row)}"
    )


def line(title: str, rows: list[Row]) -> str:
    counts = Counter(outcome(row) for row in rows)
    return " | ".join([f"| {title}", str(len(rows)), *(str(counts[c] or "") for c in COLUMNS)]) + " |"


def table(rows: list[Row], command: str) -> str:
    """The results as Markdown."""
    by = {kind: [r for r in rows if r["kind"] == kind] for kind in ("single", "removed", "null", "foreign")}
    clear = [r for r in by["single"] if r["drop"] >= CLEAR]
    weak = [r for r in by["single"] if r["drop"] < CLEAR]
    lines = [
        f"Made by `{command}`.",
        "",
        "| trials | n | " + " | ".join(COLUMNS) + " |",
        "|---" * (len(COLUMNS) + 2) + "|",
        line(f"one effect, drop >= {CLEAR:g}", clear),
        line(f"one effect, drop < {CLEAR:g}", weak),
        line("laws >= 64, true family taken out", by["removed"]),
        line("nothing hidden", by["null"]),
        line("a law outside the catalogue", by["foreign"]),
        "",
        "| step | median s | worst s |",
        "|---|---|---|",
    ]
    for step in dict.fromkeys(step for row in rows for step in row["seconds"]):
        times = [row["seconds"][step] for row in rows if step in row["seconds"]]
        lines.append(f"| {step} | {statistics.median(times):.2f} | {max(times):.1f} |")
    for name, key in (("all, clock", "wall_s"), ("all, processor", "processor_s")):
        times = [row[key] for row in rows]
        lines.append(f"| {name} | {statistics.median(times):.2f} | {max(times):.1f} |")
    lines += [
        "",
        "Effects with a drop >= 64 without a right answer, and names that are not the hidden law:",
        "",
    ]
    bad = [r for r in rows if outcome(r) == "WRONG NAME" or (r in clear and outcome(r) in COLUMNS[3:])]
    return "\n".join([*lines, *([f"- {described(r)}" for r in bad] or ["- none"])])


def main(arguments: Iterable[str] | None = None) -> None:
    """Run the study of the diagnosis from records."""
    study("from-records-study", run, table, arguments, SEED, singles=30, nulls=10, foreign=10)


if __name__ == "__main__":
    main()
