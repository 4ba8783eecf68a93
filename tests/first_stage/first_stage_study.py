"""How often the first stage of the diagnosis ranks and names the right law, on trials of its own simulator.

Trials are drawn as those of `make blind`, by seed and index. Each is judged as it is, and a single effect
once more with its whole family taken out of the catalogue: whatever is named then is wrong. Records and
results stay in the folder; a study that was broken off goes on where it stopped. Delete the results (not the
records) after a change of the first stage.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # times are those of one core

import argparse
import json
import statistics
import time
from collections import Counter
from collections.abc import Collection, Iterable
from pathlib import Path

import trials

from gsid.diagnosis.missing_torque.catalogue import family
from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.effects.types import catalogue
from gsid.models.load import load_model
from gsid.plant.model import PlantModel
from gsid.records.files import read_record
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra

TARGET = "first-stage-study"
SEED = 16161
SIZES = {"singles": 60, "nulls": 20, "foreign": 20}  # trials of each kind
BEGIN, END = "<!-- made by `make {}` -->", "<!-- end -->"
CLEAR = 64.0  # predicted drop from which an effect has to be found
Row = dict


# ---- running ---------------------------------------------------------------------------------------


def drawn(folder: Path, seed: int, kind: str, index: int) -> Path:
    """Folder of a trial's records, with its key; drawn if it is not there."""
    place = folder / "records" / f"{seed}_{kind}_{index:04d}"
    if not (place / "key.json").exists():
        trial = trials.make_trial(seed, index, {kind: 1.0})
        written = trials.write_trial(trial, place)
        for path in written.iterdir():
            path.rename(place / path.name)
        written.rmdir()
        (place / "key.json").write_text(json.dumps(trial.key, default=float))
    return place


def judged(place: Path, kind: str, index: int, seed: int) -> list[Row]:
    """Rows of one trial: as it is, and with the true family taken out."""
    key = json.loads((place / "key.json").read_text())
    model = load_model(place / "null.json")
    measured = spectra_of([read_record(path) for path in sorted(place.glob("fit_*.npz"))])
    hidden = [effect["id"] for effect in key["effects"]]
    row = {
        "seed": seed,
        "index": index,
        "kind": kind,
        "hidden": hidden,
        "drop": sum(key["predicted_drop"] or [0]),
    }
    rows = [row | answer(measured, model, ())]
    if kind == "single" and row["drop"] >= CLEAR:
        out = {e.id for e in catalogue().values() if family(e) == family(catalogue()[hidden[0]])}
        rows.append(row | {"kind": "removed"} | answer(measured, model, out))
    return rows


def answer(measured: list[Spectra], model: PlantModel, without: Collection[str]) -> Row:
    """What the first stage says, and its processor time."""
    begin = time.process_time()
    found = first_stage(measured, model, without=without)
    return {
        "kind of conclusion": found.conclusion.kind,
        "effects": list(found.conclusion.effects),
        "order": [one.effects[0] for one in found.ranking],
        "share": found.ranking[0].share_kept_out,
        "margin": found.ranking[0].margin,
        "scatter": found.ranking[0].scatter,
        "cost": [found.cost_per_dof, found.ranking[0].cost_per_dof],
        "seconds": found.seconds,
        "processor_s": time.process_time() - begin,
    }


def run(folder: Path, seed: int, counts: dict[str, int]) -> list[Row]:
    """All rows; those that are there already are not made again."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "results.jsonl"
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
            print(kind, index, new[0]["hidden"], new[0]["kind of conclusion"], new[0]["effects"], flush=True)
    return [row for row in rows if row["seed"] == seed]


# ---- the table -------------------------------------------------------------------------------------


def outcome(row: Row) -> str:
    """One word for a conclusion."""
    kind, effects = row["kind of conclusion"], row["effects"]
    if kind in ("none", "unknown"):
        return kind
    right = bool(set(effects) & set(row["hidden"])) and row["kind"] != "removed"
    if right:
        return f"{kind} right"
    if row["kind"] != "single":  # the law of a foreign trial is not in the catalogue
        return f"{kind} wrong"
    same = family(catalogue()[row["hidden"][0]]) == family(catalogue()[effects[0]])
    return f"{kind} {'family' if same else 'wrong'}"


COLUMNS = ("named right", "named family", "named wrong", "nearest right", "nearest family", "nearest wrong")
COLUMNS += ("unknown", "none")


def line(title: str, rows: list[Row]) -> str:
    counts = Counter(outcome(row) for row in rows)
    return " | ".join([f"| {title}", str(len(rows)), *(str(counts[c] or "") for c in COLUMNS)]) + " |"


def place_of(row: Row) -> int:
    """Place of the hidden effect in the ranking, 1 is the first; 0: not in it."""
    at = [i for i, effect in enumerate(row["order"]) if effect in row["hidden"]]
    return at[0] + 1 if at else 0


def table(rows: list[Row], command: str) -> str:
    """The results as Markdown."""
    by = {kind: [r for r in rows if r["kind"] == kind] for kind in ("single", "removed", "null", "foreign")}
    clear = [r for r in by["single"] if r["drop"] >= CLEAR]
    weak = [r for r in by["single"] if r["drop"] < CLEAR]
    places = Counter(place_of(r) for r in clear)
    of_family = sum(family(catalogue()[r["order"][0]]) == family(catalogue()[r["hidden"][0]]) for r in clear)
    processor_s = [r["processor_s"] for r in rows]
    steps: dict[str, list[float]] = {}
    for r in rows:
        for step, seconds in r["seconds"].items():
            steps.setdefault(step, []).append(seconds)
    wrong = [r for r in rows if outcome(r) in ("named wrong", "named family")]
    head = ["trials", "n", *COLUMNS]
    return "\n".join(
        [
            f"Made by `{command}`.",
            "",
            "| " + " | ".join(head) + " |",
            "|---" * len(head) + "|",
            line(f"one effect, drop >= {CLEAR:g}", clear),
            line(f"one effect, drop < {CLEAR:g}", weak),
            line("the same >= 64, true family taken out", by["removed"]),
            line("nothing hidden", by["null"]),
            line("a law outside the catalogue", by["foreign"]),
            "",
            f"Of the {len(clear)} effects with a drop >= {CLEAR:g} the right law is first in {places[1]}, "
            f"second or third in {places[2] + places[3]}, further down in "
            f"{sum(places[k] for k in places if k > 3)}, and not in the ranking in {places[0]}; "
            f"its family is first in {of_family}.",
            "",
            f"Processor time: median {statistics.median(processor_s):.2f} s, worst {max(processor_s):.2f} s. "
            "Median clock time by step: "
            + ", ".join(f"{step} {1e3 * statistics.median(times):.0f} ms" for step, times in steps.items())
            + ".",
            "",
            "Names that are not the hidden law (seed and index):",
            "",
            *([f"- {told(r)}" for r in wrong] or ["- none"]),
            "",
            "Effects with a drop >= 64 that are not first in the ranking, or whose conclusion is unknown or "
            "none:",
            "",
            *(f"- {told(r)}" for r in clear if place_of(r) != 1 or outcome(r) in ("unknown", "none")),
        ]
    )


def told(row: Row) -> str:
    effects = " or ".join(row["effects"]) or f"first {row['order'][0]}"
    hidden = ", ".join(row["hidden"]) or "nothing"
    return (
        f"{row['seed']} {row['kind']} {row['index']}: {hidden}, drop {row['drop']:.0f}; "
        f"{row['kind of conclusion']}, {effects}; cost {row['cost'][0]:.3g} -> {row['cost'][1]:.3g}"
    )


def put_into(page: Path, text: str, target: str) -> None:
    """Replace the part of a page between the marks of a target."""
    begin = BEGIN.format(target)
    before, found, rest = page.read_text().partition(begin)
    _, _, after = rest.partition(END)
    assert found, f"{page} has no marks of {target}"
    page.write_text(f"{before}{begin}\n\n{text}\n\n{END}{after}")


def main(arguments: Iterable[str] | None = None) -> None:
    """Run the study of the first stage and write its table."""
    parser = argparse.ArgumentParser(description="Run the study and write its table.")
    parser.add_argument("--seed", type=int, default=SEED, help="1 to 999 while developing")
    for name, size in SIZES.items():
        parser.add_argument(f"--{name}", type=int, default=size)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--page", type=Path, help="page to put the table into")
    args = parser.parse_args(arguments)
    sizes = {name: getattr(args, name) for name in SIZES}
    words = " ".join(f"{name.upper()}={n}" for name, n in sizes.items())
    rows = run(args.folder, args.seed, {name.removesuffix("s"): n for name, n in sizes.items()})
    text = table(rows, f"make {TARGET} SEED={args.seed} {words}")
    print(text)
    if args.page:
        put_into(args.page, text, TARGET)


if __name__ == "__main__":
    main()
