"""Blind trials of `diagnose` and `add`: run the tool, open the keys, count.

Each trial is drawn, its key sealed and the key's SHA-256 put in the manifest before the tool sees the
records; the keys are opened when all trials have run. A run that was broken off goes on where it stopped.

"First group" is what the verdict names first, "found" all that was found. An effect counts as named only when
the verdict is that a catalogue effect is missing.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # two processes share the machine

import click
import numpy as np
import pandas as pd
import trials
from nulls import LINE_JUDGED
from rich.console import Console
from rich.progress import Progress
from scipy import stats
from scipy.ndimage import median_filter

from gsid.base.files import write_atomically
from gsid.fleet.address import address
from gsid.fleet.cluster import Cluster, run_on
from gsid.fleet.forks import Setup
from gsid.fleet.run import run_here
from gsid.fleet.store import Store
from gsid.fleet.table import failure_text
from gsid.fleet.unit import FAILED, Job, version, work_of

ALPHA = 0.05  # nominal rate of false alarms
CLEAR_DROP = 64.0  # from here on a hidden effect has to be named
CONFIDENT = 0.95
DROP_EDGES = (0, 6, 12, 24, 48, 96, 192, 512, 2048, 8192, math.inf)
PROBABILITY_EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)


# ---- the tool --------------------------------------------------------------------------------------


def gsid_tool(place: Path) -> dict:
    """What gsid says of the records in a folder; the only place here that knows its interface."""

    from gsid.diagnosis.from_records.diagnose import diagnose
    from gsid.models.load import load_model
    from gsid.records.files import read_record

    fit, held = (
        [read_record(path) for path in sorted(place.glob(f"{kind}_*.npz"))] for kind in ("fit", "held")
    )
    begin = time.perf_counter()
    # The answer shall not depend on what else runs.
    diagnosis = diagnose(load_model(place / "null.json"), fit, time_s=600.0)
    seconds = time.perf_counter() - begin
    group = [{"effects": list(diagnosis.effects), "probability": diagnosis.probability}]
    return {
        "adequate": diagnosis.adequate,
        "p_value": diagnosis.p_value,
        "verdict": diagnosis.verdict,
        "ranking": group if diagnosis.effects else [],
        "found": [list(effects) for effects in diagnosis.found],
        "nearest": [list(effects) for effects in diagnosis.nearest],
        "seconds": seconds,
        "error_over_floor": error_over_floor(lambda u: diagnosis.model.simulate(u).y, held),
    }


def error_over_floor(simulate: Callable[[np.ndarray], np.ndarray], records: Iterable) -> float:
    """RMS error of the periodic answer over the noise floor of the mean, on records that were held out.

    Judged here, not by the tool: over lines up to 200 Hz, the floor from the scatter of the periods (8 of
    them in all kinds but null). Lines that scatter 4 times as much as those around them are left out: a fan
    adds to the scatter and little to the mean.
    """
    error = floor = 0.0
    lines = slice(1, LINE_JUDGED + 1)
    for record in records:
        spectra = trials.amplitudes(record.y.reshape(-1, trials.N))[:, lines]
        answer = trials.amplitudes(np.asarray(simulate(record.u[: trials.N])))[lines]
        scatter = np.var(spectra, axis=0, ddof=1)
        quiet = scatter < 4 * median_filter(scatter, 101)
        error += np.sum(np.abs(spectra.mean(0) - answer)[quiet] ** 2)
        floor += np.sum(scatter[quiet]) / len(spectra)
    return float(np.sqrt(error / floor))


# ---- running ---------------------------------------------------------------------------------------


NOTHING_SAID = {
    "adequate": True,
    "p_value": None,
    "verdict": "broken",
    "ranking": [],
    "found": [],
    "nearest": [],
    "seconds": None,
    "error_over_floor": None,
}


def run_trial(
    tool: Callable[[Path], dict], seed: int, kinds: dict[str, float] | None, folder: Path, index: int
) -> None:
    """Draw one trial, seal its key, let the tool look at it, keep what it says."""
    trial = trials.make_trial(seed, index, kinds)
    text, digest = trials.seal(trial.key, seed)
    with open(folder / "manifest.txt", "a") as manifest:
        manifest.write(f"{digest}  {trial.name}\n")
    (folder / "keys" / f"{trial.name}.json").write_text(text)
    place = trials.write_trial(trial, folder / "records")
    try:
        result = tool(place)
    except Exception as error:  # a tool that breaks has not found the effect: that is its result
        result = NOTHING_SAID | {"broken": f"{type(error).__name__}: {error}"}
    shutil.rmtree(place)
    path = _result_path(folder, seed, index)
    part = path.with_suffix(".part")
    part.write_text(json.dumps({"name": trial.name, **result}))
    part.replace(path)


def _result_path(folder: Path, seed: int, index: int) -> Path:
    return folder / "results" / f"trial_{seed}_{index:05d}.json"


def run(
    folder: Path,
    n_trials: int,
    seed: int,
    kinds: dict[str, float] | None = None,
    *,
    tool: Callable[[Path], dict] = gsid_tool,
    n_processes: int = 2,
) -> list[Row]:
    """Run the trials that have no result yet, then open the keys of all."""
    for name in ("keys", "records", "results"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    _same_settings(folder, {"seed": seed, "kinds": kinds or trials.KINDS})
    todo = [i for i in range(n_trials) if not _result_path(folder, seed, i).exists()]
    jobs = {job.key: job for job in (_job(tool, seed, kinds, folder, i) for i in todo)}
    setup = Setup(str(folder / "fleet"), ("score",), paths=(str(Path(__file__).parent),))
    with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("trials", total=n_trials, completed=n_trials - len(todo))

        def done(answer: dict) -> None:
            _keep_failure(setup, jobs[answer["key"]])
            progress.advance(bar)

        if n_processes == 1:
            run_here(setup, jobs.values(), done)
        elif jobs:
            run_on(Cluster(None, n_processes), setup, jobs.values(), done, print)
    return [open_key(folder, _result_path(folder, seed, i)) for i in range(n_trials)]


def _job(tool: Callable, seed: int, kinds: dict[str, float] | None, folder: Path, index: int) -> Job:
    """One trial as a unit of a fleet."""
    name = f"{tool.__module__}:{tool.__qualname__}".replace("__main__", "score")
    arguments = {"tool": name, "kinds": kinds, "folder": str(folder.absolute()), "index": index}
    key = address("blind", {"seed": seed, **arguments}, [])
    return Job(key, "score:trial_of_job", f"trial_{seed}_{index:05d}", arguments=arguments, seed=seed)


def trial_of_job(job: Job) -> dict:
    """Run one trial in its own process; its result is a file beside those of the other trials."""
    given = job.arguments
    run_trial(work_of(given["tool"]), job.seed, given["kinds"], Path(given["folder"]), given["index"])
    return {}


def _keep_failure(setup: Setup, job: Job) -> None:
    """The result of a trial whose process has crashed: the tool is broken there, as after an exception."""
    folder = Path(job.arguments["folder"])
    result = Store(setup.folder).read(job.key)
    Store(setup.folder).remove(job.key)  # the file of the trial has the answer
    if result["status"] != FAILED:
        return
    why = failure_text(result)
    if result["failure"]["kind"] == "exception" or not (folder / "keys" / f"{job.unit}.json").exists():
        raise RuntimeError(f"{job.unit}: {why}")  # not of the tool: the trial could not be drawn
    broken = {"name": job.unit, **NOTHING_SAID, "broken": why}
    _result_path(folder, job.seed, job.arguments["index"]).write_text(json.dumps(broken))


def add_to_table(path: Path, rows: list[Row], seed: int) -> int:
    """Add trials to the table of all seeds, or replace them; returns the number of its rows."""
    new = pd.DataFrame(
        [
            {
                "trial": row.result["name"],
                "seed": seed,
                "version": version(),
                "kind": row.kind,
                "hidden": " ".join(row.hidden),
                "predicted_drop": row.drop,
                "verdict": row.result["verdict"],
                "named": " or ".join(row.group),
                "right": bool(row.right),
                "wrong": bool(row.wrong),
                "probability": row.probability,
                "seconds": row.result["seconds"],
            }
            for row in rows
        ]
    )
    old = pd.read_parquet(path) if path.exists() else new.iloc[:0]
    table = pd.concat([old, new]).drop_duplicates(["trial", "version"], keep="last")
    write_atomically(path, lambda part: table.sort_values(["version", "trial"]).to_parquet(part, index=False))
    return len(table)


def _same_settings(folder: Path, settings: dict) -> None:
    path = folder / "settings.json"
    if path.exists() and json.loads(path.read_text()) != settings:
        raise click.UsageError(f"{folder} holds trials of other settings: {path.read_text()}")
    path.write_text(json.dumps(settings))


@dataclass
class Row:
    """One trial: the answer beside what the tool said."""

    key: dict
    result: dict

    @property
    def kind(self) -> str:
        return self.key["kind"]

    @property
    def hidden(self) -> list[str]:
        return [effect["id"] for effect in self.key["effects"]]

    @property
    def drop(self) -> float:
        return min(self.key["predicted_drop"], default=0.0)

    @property
    def separable(self) -> bool:
        """Whether no other effect of the catalogue explains it; keys of faint effects do not say."""
        return (self.key["unexplained"] or 0.0) >= trials.SEPARABLE

    @property
    def broken(self) -> bool:
        return "broken" in self.result

    @property
    def rejected(self) -> bool:
        return not self.result["adequate"]

    @property
    def group(self) -> list[str]:
        """The first group, whatever the verdict."""
        return self.result["ranking"][0]["effects"] if self.rejected and self.result["ranking"] else []

    @property
    def probability(self) -> float | None:
        """Stated probability of the first group; None if none is stated."""
        return self.result["ranking"][0]["probability"] if self.group else None

    @property
    def in_group(self) -> bool:
        return bool(set(self.group) & set(self.hidden))

    @property
    def named(self) -> bool:
        """The tool says that it knows what is missing."""
        return self.result["verdict"] == "missing_effect" and bool(self.group)

    @property
    def right(self) -> bool:
        return self.named and self.in_group

    @property
    def all_found(self) -> bool:
        return all(any(effect in group for group in self.result["found"]) for effect in self.hidden)

    @property
    def all_in_answer(self) -> bool:
        """At least one hidden effect is named, and the others are named or the nearest beside it."""
        answer = [*self.result["found"], *self.result["nearest"]]
        return self.right and all(any(effect in group for group in answer) for effect in self.hidden)

    @property
    def flagged(self) -> bool:
        return self.result["verdict"] == "unknown_effect"

    @property
    def wrong(self) -> bool:
        return self.named and not self.in_group

    @property
    def confidently_wrong(self) -> bool:
        return self.wrong and self.probability is not None and self.probability >= CONFIDENT


def open_key(folder: Path, path: Path) -> Row:
    """Open one key, after checking that it is the one that was sealed."""
    result = json.loads(path.read_text())
    text = (folder / "keys" / f"{result['name']}.json").read_text()
    digest = hashlib.sha256(text.encode()).hexdigest()
    if f"{digest}  {result['name']}" not in (folder / "manifest.txt").read_text().splitlines():
        raise RuntimeError(f"the key of {result['name']} is not the one that was sealed")
    return Row(json.loads(text), result)


# ---- counting --------------------------------------------------------------------------------------


def share(hits: Iterable[bool]) -> dict:
    """Share of hits, with its 95 % (Clopper-Pearson) interval."""
    hits = list(hits)
    n, k = len(hits), int(np.count_nonzero(hits))
    if n == 0:
        return {"n": 0, "hits": 0, "share": None, "low": None, "high": None}
    interval = stats.binomtest(k, n).proportion_ci()
    return {"n": n, "hits": k, "share": k / n, "low": float(interval.low), "high": float(interval.high)}


def confidently_wrong(rows: list[Row]) -> dict:
    """Share of wrong names with a high probability; of no rows where none states a probability."""
    states = [row.probability is not None for row in rows]
    judged = [row for row, states_one in zip(rows, states, strict=True) if states_one or not row.named]
    return share(row.confidently_wrong for row in judged if any(states))


def false_alarms(rows: list[Row]) -> dict:
    """Rejections of null files, in all and by what the file is like."""
    nulls = [row for row in rows if row.kind == "null" and not row.broken]

    def rejected(some: Iterable[Row]) -> dict:
        return share(row.rejected for row in some)

    p_values = [row.result["p_value"] for row in nulls if row.result["p_value"] is not None]
    parts = {}
    for n in (2, 4, 8):
        parts[f"{n} periods"] = rejected(row for row in nulls if row.key["n_periods"] == n)
    for n in (1, 4):
        text = "1 realisation" if n == 1 else f"{n} realisations"
        parts[text] = rejected(row for row in nulls if row.key["n_realisations"] == n)
    parts["with a fan"] = rejected(row for row in nulls if row.key["noise"]["fan"])
    for name in sorted({row.key["noise"]["unlisted"] for row in nulls}):
        parts[f"with {name}"] = rejected(row for row in nulls if row.key["noise"]["unlisted"] == name)
    low, high = stats.binom.interval(0.99, len(nulls), ALPHA) if nulls else (0, 0)
    return {
        **rejected(nulls),
        "allowed": [int(low), int(high)],
        "parts": parts,
        "effect_named": share(row.named for row in nulls),
        "uniformity_p": float(stats.kstest(p_values, "uniform").pvalue) if len(p_values) > 1 else None,
    }


def power(rows: list[Row]) -> list[dict]:
    """Single effects by predicted drop."""
    table = []
    for low, high in pairwise(DROP_EDGES):
        some = [row for row in rows if row.kind == "single" and low <= row.drop < high]
        table.append(
            {
                "drop": [low, None if math.isinf(high) else high],
                "n": len(some),
                "detected": share(row.rejected for row in some),
                "in_first_group": share(row.right for row in some),
                "alone_in_it": share(row.right and len(row.group) == 1 for row in some),
                "wrong": share(row.wrong for row in some),
            }
        )
    return table


def confusion(rows: list[Row]) -> dict[str, dict[str, int]]:
    """Hidden effect, clear and single -> what was named: itself, a group with it, or another."""
    table: dict[str, Counter] = {}
    for row in rows:
        if row.kind != "single" or row.drop < CLEAR_DROP:
            continue
        effect = row.hidden[0]
        if not row.named:
            said = row.result["verdict"]
        elif effect in row.group:
            said = effect if len(row.group) == 1 else " or ".join(sorted(row.group))
        else:
            said = row.group[0]
        table.setdefault(effect, Counter())[said] += 1
    return {effect: dict(table[effect].most_common()) for effect in sorted(table)}


def reliability(rows: list[Row]) -> list[dict]:
    """Stated probability of the first group against how often it was right."""
    kinds = ("single", "two", "dirty")
    judged = [row for row in rows if row.kind in kinds and row.named and row.probability is not None]
    table = []
    for low, high in pairwise(PROBABILITY_EDGES):
        some = [row for row in judged if low <= row.probability < high or row.probability == high == 1.0]
        stated = float(np.mean([row.probability for row in some])) if some else None
        table.append({"from": low, "to": high, "stated": stated, "right": share(row.right for row in some)})
    return table


def summary(rows: list[Row]) -> dict:
    """Everything that is counted."""

    def kind(*names: str) -> list[Row]:
        return [row for row in rows if row.kind in names]

    clear = [row for row in kind("single") if row.drop >= CLEAR_DROP]
    ratios = [row.result["error_over_floor"] for row in clear + kind("two")]
    seconds = [row.result["seconds"] for row in rows if row.result["seconds"] is not None]
    return {
        "n_trials": len(rows),
        "false_alarms": false_alarms(rows),
        "first_group": share(row.right for row in clear),
        "alone": share(row.right and len(row.group) == 1 for row in clear),
        "alone_if_separable": share(row.right and len(row.group) == 1 for row in clear if row.separable),
        "wrong": share(row.wrong for row in kind("single", "two", "form", "dirty")),
        "confidently_wrong": confidently_wrong(kind("single", "two", "form", "dirty")),
        "both_found": share(row.all_found for row in kind("two")),
        "both_in_answer": share(row.all_in_answer for row in kind("two")),
        "nothing_else_added": share(row.all_found and len(row.result["found"]) == 2 for row in kind("two")),
        "foreign_flagged": share(row.flagged for row in kind("foreign")),
        "very_foreign_flagged": share(
            row.flagged for row in kind("foreign") if row.key["unexplained"] > 0.1 * row.drop
        ),
        "foreign_by_effect": {
            effect: share(row.flagged for row in kind("foreign") if effect in row.hidden)
            for effect in trials.FOREIGN
        },
        "other_form_named": share(row.in_group for row in kind("form")),
        "dirty_named": share(row.in_group for row in kind("dirty")),
        "fan_named": share("periodic_disturbance" in row.group for row in kind("fan")),
        "fan_rejected": share(row.rejected for row in kind("fan")),
        "held_out_at_floor": share(ratio is not None and ratio <= 1.1 for ratio in ratios),
        "error_over_floor": _spread([r for r in ratios if r is not None]),
        "power": power(rows),
        "confusion": confusion(rows),
        "reliability": reliability(rows),
        "seconds": _spread(seconds),
        "worked": share(not row.broken for row in rows),
        "broken": Counter(row.result["broken"] for row in rows if row.broken),
    }


def _spread(values: list[float]) -> dict | None:
    if not values:
        return None
    return {
        name: float(np.percentile(values, q)) for name, q in (("median", 50), ("p95", 95), ("worst", 100))
    }


# The required figures: figure, name, bound, whether it is a lower bound.
REQUIRED = [
    ("worked", "trials that diagnose did not break off", 1.0, True),
    ("first_group", f"effect in the first group, drop >= {CLEAR_DROP:g}", 0.98, True),
    (
        "alone_if_separable",
        f"alone in it, where other effects leave >= {trials.SEPARABLE:g} of it",
        0.98,
        True,
    ),
    ("confidently_wrong", f"wrong with a stated probability >= {CONFIDENT:g}", 0.01, False),
    ("both_found", "both of two effects found", 0.92, True),
    ("foreign_flagged", "foreign effect flagged", 0.92, True),
    ("held_out_at_floor", "held-out error <= 1.1 of the noise floor after add", 0.95, True),
]


def verdicts(figures: dict) -> list[dict]:
    """Each required figure: met, missed, or (None) not tested."""
    alarms = figures["false_alarms"]
    low, high = alarms["allowed"]
    found = [
        {
            "text": "null files rejected",
            "figure": alarms,
            "required": f"{low}..{high} of {alarms['n']}",
            "met": low <= alarms["hits"] <= high if alarms["n"] else None,
        }
    ]
    for name, text, bound, least in REQUIRED:
        value = figures[name]["share"]
        met = None if value is None else value >= bound if least else value <= bound
        required = f"{'>=' if least else '<='} {bound:.0%}"
        found.append({"text": text, "figure": figures[name], "required": required, "met": met})
    return found


# ---- the page --------------------------------------------------------------------------------------


def _percent(figure: dict) -> str:
    if not figure["n"]:
        return "-"
    return f"{figure['share']:.1%} ({figure['low']:.1%} to {figure['high']:.1%}), n {figure['n']}"


def _short(figure: dict) -> str:
    return f"{figure['share']:.0%}" if figure["n"] else "-"


def _table(head: list[str], lines: Iterable[Iterable[object]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(str(cell) for cell in row) + " |" for row in rows)


def _power(row: dict) -> list:
    low, high = row["drop"]
    drop = f"{low:g} to {high:g}" if high else f"from {low:g}"
    columns = ("detected", "in_first_group", "alone_in_it", "wrong")
    return [drop, row["n"], *(_short(row[column]) for column in columns)]


def _calibration(row: dict) -> list[str]:
    stated = "-" if row["stated"] is None else f"{row['stated']:.3f}"
    return [f"{row['from']:g} to {row['to']:g}", stated, _percent(row["right"])]


def page(figures: dict, command: str) -> str:
    """The results as Markdown. Brackets are 95 % intervals."""
    words = {True: "met", False: "**missed**", None: "not tested"}
    alarms = figures["false_alarms"]
    others = [
        ("alone in the first group, drop >= 64", figures["alone"]),
        ("wrong name, of one or two hidden effects", figures["wrong"]),
        ("an effect named in a null file", alarms["effect_named"]),
        ("two hidden: one named, the other named or nearest beside it", figures["both_in_answer"]),
        ("two hidden: both found and nothing else added", figures["nothing_else_added"]),
        ("presliding as LuGre: presliding in the first group", figures["other_form_named"]),
        ("an unlisted effect at -50 dB beside: effect in the first group", figures["dirty_named"]),
        ("foreign flagged, of which no catalogue effect explains 90 %", figures["very_foreign_flagged"]),
        ("fan alone: named", figures["fan_named"]),
        ("fan alone: model rejected", figures["fan_rejected"]),
        *((f"null rejected, {name}", part) for name, part in alarms["parts"].items()),
        *((f"flagged: {name}", part) for name, part in figures["foreign_by_effect"].items()),
    ]
    parts = [
        f"{figures['n_trials']} trials, made by `{command}`. Brackets are 95 % intervals.",
        _table(
            ["figure", "measured", "required", ""],
            ([v["text"], _percent(v["figure"]), v["required"], words[v["met"]]] for v in verdicts(figures)),
        ),
        _table(["also", "measured"], ([text, _percent(figure)] for text, figure in others)),
        "### Power: one hidden effect by the predicted drop of the cost",
        _table(
            ["drop", "n", "model rejected", "in the first group", "alone in it", "wrong name"],
            (_power(row) for row in figures["power"]),
        ),
        f"### Confusion: effect named first, drop >= {CLEAR_DROP:g}",
        _table(
            ["hidden", "named"],
            (
                [effect, ", ".join(f"{name} {count}" for name, count in said.items())]
                for effect, said in figures["confusion"].items()
            ),
        ),
        "### Calibration of the stated probability of the first group",
        _table(["stated", "mean stated", "right"], (_calibration(row) for row in figures["reliability"])),
    ]
    for name, text in (
        ("error_over_floor", "Held-out error over noise floor"),
        ("seconds", "Seconds a diagnose"),
    ):
        if figures[name]:
            parts.append(f"{text}: " + ", ".join(f"{n} {v:.3g}" for n, v in figures[name].items()) + ".")
    if alarms["uniformity_p"] is not None:
        parts.append(
            f"P-values of null files are uniform: Kolmogorov-Smirnov p {alarms['uniformity_p']:.2g}."
        )
    if figures["broken"]:
        parts.append(
            "Broke off: " + "; ".join(f"{text} ({n})" for text, n in figures["broken"].items()) + "."
        )
    return "\n\n".join(parts) + "\n"


@click.command(help="Run blind trials of diagnose and add, and score them.")
@click.option("--trials", "n_trials", default=100, show_default=True, help="Number of trials.")
@click.option(
    "--seed", required=True, type=int, help="1 to 999 while developing, others for published figures."
)
@click.option("--kinds", help=f"Only these, comma-separated: {', '.join(trials.KINDS)}.")
@click.option(
    "--output", type=click.Path(path_type=Path), required=True, help="Folder; a broken run goes on there."
)
@click.option("--check", is_flag=True, help="Exit 1 when a required figure is missed.")
def main(n_trials: int, seed: int, kinds: str | None, output: Path, check: bool) -> None:
    chosen = {name: trials.KINDS[name] for name in kinds.split(",")} if kinds else None
    rows = run(output, n_trials, seed, chosen)
    figures = summary(rows)
    # Called through make: the command that anyone can repeat.
    command = f"make blind N={n_trials} SEED={seed}" + (f" KINDS={kinds}" if kinds else "")
    (output / "blind.json").write_text(json.dumps({"command": command, **figures}, indent=1))
    text = page(figures, command)
    (output / "blind.md").write_text(text)
    print(text)
    table = output.parent / "trials.parquet"
    print(f"{table}: {add_to_table(table, rows, seed)} trials of all seeds", file=sys.stderr)
    missed = [v["text"] for v in verdicts(figures) if v["met"] is False]
    if check and missed:
        print("error: missed: " + "; ".join(missed), file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
