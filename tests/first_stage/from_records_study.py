"""How often the diagnosis is right from three starts, on hard trials of the blind study's simulator.

The starts: a model without the effect whose values are 5 % or 30 % off, and the records alone. Each single
effect is diagnosed as it is, and once more with its whole family taken out of the catalogue: whatever is
named then is wrong. From the records alone a linear effect (spring, lag, mode, a held sensor) is a part of
the structure: nothing is missing then. A null is diagnosed from one of the starts in turn.

Results stay in a file; a study that was broken off goes on where it stopped. Delete the file after a change
of the diagnosis.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # each process has one core

import argparse
import time
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import hard
import numpy as np
import reliability
import study_pool
from first_stage_study import put_into
from hidden import BASE, FS_HZ
from nulls import N
from scipy import stats
from study_pool import Row

import gsid
from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.missing_torque.catalogue import family
from gsid.effects.types import catalogue, find
from gsid.plant.model import PlantModel

TARGET = "from-records-study"
SEEDS = (21610,)
STARTS = {"5": "model 5 % off", "30": "model 30 % off", "records": "records alone"}
CLEAR = 64.0  # predicted drop from which an effect has to be found, and which an equal law may leave
EQUAL_SHARE = 0.5  # of the drop, which an equal law may leave as well: the drop may be near 64
INDISTINCT = 4.0  # left of a drop below 64 by an equal law: a 5 % test of one number finds half of such
COLUMNS = (
    "named right",
    "nearest right",
    "in the structure",
    "equal law",
    "none",
    "unknown",
    "nearest wrong",
    "WRONG NAME",
    "no result",
)
RIGHT = COLUMNS[:3]
WORD = {
    "missing_effect": "named",
    "nearest_effect": "nearest",
    "unknown_effect": "unknown",
    "adequate": "none",
}
BUDGET_S = 600.0  # the answer shall not depend on what else runs; the processor time is in the table
BOUND_S = 900.0  # of one diagnosis, with its trial
ALPHA = 0.05
LEVELS = {"95 %": 0.95, "99.9 %": 0.999}  # of the intervals
JUDGED = ("required", "verdict")
KINDS = ("single", "removed", "null", "foreign")
Interval = tuple[float, float]


# ---- running ---------------------------------------------------------------------------------------


def work(task: study_pool.Task, n_done: int) -> Iterator[tuple[str, Row]]:
    """Rows of one trial: of each start as it is, and with the family of its effect taken out.

    Parameters
    ----------
    task : tuple
        Seed, kind, index, and the starts in one text.
    n_done : int
        Rows that are known.
    """
    seed, kind, index, starts = task
    trial = hard.make_hard(seed, index, kind)
    records = [record_of(u, y) for u, y in trial.records]
    hidden = [effect["id"] for effect in trial.key["effects"]]
    for start, is_removed in _parts(kind, hidden, starts.split())[n_done:]:
        row = {"seed": seed, "index": index, "kind": "removed" if is_removed else kind, "start": start}
        row |= {"hidden": hidden, "drop": sum(trial.key["predicted_drop"])}
        yield "begin", row
        out = family_of(hidden[0]) if is_removed else ()
        yield "row", row | _answer(trial, records, start, out)


def record_of(u: np.ndarray, y: np.ndarray) -> gsid.Record:
    return gsid.Record(u, y, FS_HZ, N, 0, u_unit="command", y_unit="deg/s", hold="zoh")


def _parts(kind: str, hidden: Sequence[str], starts: Sequence[str]) -> list[tuple[str, bool]]:
    """(start, whether the family is taken out); from the records, the structure cannot be taken out."""
    parts = [(start, False) for start in starts]
    if kind == "single":
        parts += [(start, True) for start in starts if start != "records" or not is_linear(hidden[0])]
    return parts


def family_of(effect: str) -> set[str]:
    return {one.id for one in catalogue().values() if family(one) == family(find(effect))}


def _answer(trial: hard.HardTrial, records: list[gsid.Record], start: str, without: Collection[str]) -> Row:
    """The verdict with its numbers, and its time."""
    model = None if start == "records" else PlantModel.from_dict(trial.models[int(start) / 100], "null")
    begin = time.perf_counter(), time.process_time()
    try:
        found = gsid.diagnose_records(records, model, without=without, time_s=BUDGET_S)
    except Exception as error:  # a fault of the diagnosis is a result of the study
        return {"verdict": "error", "reasons": [f"{type(error).__name__}: {error}"], "wall_s": 0.0}
    row = {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "structure": [label for label, _ in found.model.labels()] if found.model else [],
        "found": [list(effects) for effects in found.found],
        "basis": vars(found.basis) | {"effects": list(found.basis.effects)} if found.basis else None,
        "probability": vars(found.probabilities) if found.probabilities else None,
        "ranking": [_ranked(one) for one in found.ranking[:6]],
        "reasons": list(found.reasons),
        "cost": [found.cost_per_dof, found.cost_per_dof_after],
        "n_numbers": int(sum(2 * np.count_nonzero(one.excited) for one in found.measured)),
        "p_value": found.p_value,
        "seconds": found.seconds,
        "wall_s": time.perf_counter() - begin[0],
        "processor_s": time.process_time() - begin[1],
    }
    hidden = [effect["id"] for effect in trial.key["effects"]]
    if found.verdict in ("missing_effect", "nearest_effect") and hidden and not _is_among(row, hidden):
        row["left"] = _left(trial, found)
    return row


def _ranked(one: gsid.diagnosis.from_records.result.RankedLaw) -> list:
    numbers = (one.cost_per_dof_after, one.share_kept_out, one.margin, one.scatter)
    return [" or ".join(one.effects), *(None if np.isnan(x) else round(float(x), 5) for x in numbers), one.by]


def _left(trial: hard.HardTrial, found: gsid.Diagnosis) -> float | None:
    """What the law that was named leaves of the drop, by the simulator of the trial."""
    effect = found.effects[0]
    params = next((one.params for one in found.ranking if one.effects[:1] == (effect,)), None)
    own = set(hard.CATALOGUE.get(effect, {}).values())
    if params is None or not own or own & trial.nulls.base.keys():  # the simulator has one of each
        return None
    beside = {one.id: {n: p.value for n, p in one.params.items()} for one in found.model.effects}
    left = hard.left_by(trial, effect, params, beside)
    return left if np.isfinite(left) else None


def tasks(
    seeds: Sequence[int], n: int, n_nulls: int, n_foreign: int, starts: Sequence[str]
) -> list[study_pool.Task]:
    """Trials in an order in which a part of the study is like the whole.

    Parameters
    ----------
    seeds : sequence of int
    n, n_nulls, n_foreign : int
        Trials of each seed.
    starts : sequence of str
    """
    all_starts = " ".join(starts)
    made = []
    for seed in seeds:
        made += [((i + 0.5) / n, (seed, "single", i, all_starts)) for i in range(n)]
        made += [((i + 0.5) / n_nulls, (seed, "null", i, starts[i % len(starts)])) for i in range(n_nulls)]
        made += [((i + 0.5) / n_foreign, (seed, "foreign", i, all_starts)) for i in range(n_foreign)]
    return [task for _, task in sorted(made, key=lambda one: one[0])]


# ---- what came out ---------------------------------------------------------------------------------


def _is_among(row: Row, hidden: Sequence[str]) -> bool:
    """Whether the verdict has the hidden effect, and nothing else was found."""
    known = reliability.known_as(hidden)
    return all(known & set(effects) for effects in [row["effects"], *row["found"]])


def outcome(row: Row) -> str:
    """One of `COLUMNS`.

    Parameters
    ----------
    row : dict
    """
    if row["verdict"] not in WORD:
        return "no result"
    word, hidden = WORD[row["verdict"]], row["hidden"]
    if word in ("named", "nearest"):
        if row["kind"] != "removed" and _is_among(row, hidden):
            return f"{word} right"
        if _is_equal(row):
            return "equal law"
        return "nearest wrong" if word == "nearest" else "WRONG NAME"
    if word == "none" and row["start"] == "records" and hidden and _in_structure(hidden[0], row):
        return "in the structure"
    return word


def _is_equal(row: Row) -> bool:
    """Whether the law that was found explains the hidden effect: little of its drop is left."""
    left, drop = row.get("left"), row["drop"]
    if left is None or left >= min(CLEAR, EQUAL_SHARE * drop):
        return False
    return drop >= CLEAR or left < INDISTINCT


def _in_structure(effect: str, row: Row) -> bool:
    """Whether the structure has one more element of the effect's kind than the axis without it."""
    if not (effect in catalogue() and is_linear(effect)):
        return False
    present = [label.partition("#")[0] for label in row["structure"]]
    return _n_alike(present, effect) > _n_alike([one for one in BASE if one != effect], effect)


def _n_alike(effects: Sequence[str], effect: str) -> int:
    return sum(find(one).linear_part == find(effect).linear_part for one in effects)


def described(row: Row) -> str:
    """One row in words.

    Parameters
    ----------
    row : dict
    """
    hidden = ", ".join(row["hidden"]) or "nothing"
    text = f"{row['seed']} {row['kind']} {row['index']}, {STARTS[row['start']]}: {hidden}, "
    text += f"drop {row['drop']:.0f}; "
    if row["verdict"] not in WORD:
        return text + row["verdict"] + " ".join(row.get("reasons", []))
    verdict = f"{WORD[row['verdict']]} {' or '.join(row['effects'])}".strip()
    left = f"; leaves {row['left']:.0f} of the drop" if row.get("left") is not None else ""
    costs = f"cost {row['cost'][0]:.3g} -> {row['cost'][1]:.3g}"
    return f"{text}{verdict}{left}; {costs}; {row['wall_s']:.1f} s; {outcome(row)}"


# ---- the table -------------------------------------------------------------------------------------


def markdown(head: Sequence[str], lines: Iterable[Sequence[object]]) -> list[str]:
    return [
        "| " + " | ".join(head) + " |",
        "|---" * len(head) + "|",
        *("| " + " | ".join(map(str, line)) + " |" for line in lines),
        "",
    ]


def _counts(title: str, start: str, rows: Sequence[Row]) -> list[object]:
    counts = Counter(map(outcome, rows))
    return [title, start, len(rows), *(counts[column] or "" for column in COLUMNS)]


GROUPS = {
    f"one effect, drop >= {CLEAR:g}": lambda row: row["kind"] == "single" and row["drop"] >= CLEAR,
    f"one effect, drop < {CLEAR:g}": lambda row: row["kind"] == "single" and row["drop"] < CLEAR,
    "true family taken out": lambda row: row["kind"] == "removed",
    "nothing hidden": lambda row: row["kind"] == "null",
    "a law outside the catalogue": lambda row: row["kind"] == "foreign",
}


def _verdicts(rows: Sequence[Row]) -> list[str]:
    """Counts of each group of trials and start, with their sums."""
    lines = []
    for title, belongs in GROUPS.items():
        some = [row for row in rows if belongs(row)]
        of_start = {start: [row for row in some if row["start"] == start] for start in STARTS}
        used = {start: part for start, part in of_start.items() if part}
        lines += [_counts(title, STARTS[start], part) for start, part in used.items()]
        if len(used) > 1:
            lines.append(_counts(title, "all", some))
    return markdown(["trials", "start", "n", *COLUMNS], lines)


@dataclass(frozen=True)
class Limit:
    """What is required of a share: at least, at most, or that its 95 % interval contains it."""

    text: str
    share: float
    side: int  # 1 at least, -1 at most, 0 contained

    def is_met(self, share: float, interval: Interval) -> bool:
        return self.side * (share - self.share) >= 0 if self.side else _contains(interval, self.share)

    def judged(self, share: float, intervals: Sequence[Interval]) -> str:
        """Whether it is met, and whether the intervals agree: one that contains the limit shows neither."""
        word = "met" if self.is_met(share, intervals[0]) else "MISSED"
        if not self.side:
            return word
        shown = [name for name, one in zip(LEVELS, intervals, strict=True) if not _contains(one, self.share)]
        return f"{word}, outside {shown[-1]}" if shown else f"{word}, within 95 %"


def _contains(interval: Interval, share: float) -> bool:
    return interval[0] <= share <= interval[1]


def _figure(text: str, hits: Iterable[bool], limit: Limit | None = None) -> list[str]:
    hits = list(hits)
    n, k = len(hits), sum(hits)
    if not n:
        return [text, "none", "", "", "", limit.text if limit else "", ""]
    test = stats.binomtest(k, n)
    intervals = [(float(one.low), float(one.high)) for one in map(test.proportion_ci, LEVELS.values())]
    shown = [f"{low:.2%} to {high:.2%}" for low, high in intervals]
    verdict = [limit.text, limit.judged(k / n, intervals)] if limit else ["", ""]
    return [text, f"{k} of {n}", f"{k / n:.2%}", *shown, *verdict]


def _figures(rows: Sequence[Row]) -> list[str]:
    """The figures that have a limit, with their Clopper-Pearson intervals."""
    single, removed, null = (
        [row for row in rows if row["kind"] == kind] for kind in ("single", "removed", "null")
    )
    clear = [row for row in single if row["drop"] >= CLEAR]
    few = Limit("<= 5 of 600", 5 / 600, -1)

    def wrong(some: Sequence[Row]) -> list[bool]:
        return [outcome(row) == "WRONG NAME" for row in some]

    lines = [
        _figure(f"singles whose effect costs >= {CLEAR:g}", (row["drop"] >= CLEAR for row in single)),
        _figure(
            "of these, in the first group",
            (outcome(row) in RIGHT for row in clear),
            Limit(">= 99 %", 0.99, 1),
        ),
        _figure("of these, first in it or in the structure", map(_is_first, clear)),
        _figure("of these, alone in it or in the structure", map(_is_alone, clear)),
        _figure("singles confidently wrong", wrong(single), few),
        _figure("true family taken out, confidently wrong", wrong(removed), few),
        _figure("nulls named", wrong(null), Limit("<= 10 of 1000", 0.01, -1)),
        _figure(
            f"nulls rejected (p < {ALPHA:g})",
            map(_is_rejected, null),
            Limit("5 % in the 95 % interval", ALPHA, 0),
        ),
        _figure("of the nulls, without a p-value", (row.get("p_value") is None for row in null)),
    ]
    return markdown(["figure", "count", "share", *(f"{level} interval" for level in LEVELS), *JUDGED], lines)


def _is_rejected(row: Row) -> bool:
    """Whether noise does not explain what the linear part leaves; no linear part is one that does not."""
    return row.get("p_value") is None or row["p_value"] < ALPHA


def _is_first(row: Row) -> bool:
    """Whether the first law of a right answer is the hidden one: others of the group are not excluded."""
    return outcome(row) in RIGHT and reliability.known_as(row["hidden"]) >= set(row["effects"][:1])


def _is_alone(row: Row) -> bool:
    return _is_first(row) and len(row["effects"]) < 2


def _by_start(rows: Sequence[Row]) -> list[str]:
    """The figures of each start."""
    parts = []
    for start, title in STARTS.items():
        some = [row for row in rows if row["start"] == start]
        parts += [f"From {title}:", "", *_figures(some)] if some else []
    return parts


def _reliability(rows: Sequence[Row]) -> list[str]:
    """Stated probabilities against how often they came true: of all, and of each start."""
    text = []
    for of in (reliability.FIRST, reliability.NONE):
        some = reliability.pairs(rows, of)
        text += [f"Stated probability of {of}: {len(some)} of {len(rows)} diagnoses state one."]
        text += [f"Brier score {reliability.brier(some):.3f}.", ""]
        text += markdown(reliability.HEAD, reliability.lines(some))
    counts = Counter((row["kind"], row["start"]) for row in rows if row.get("probability"))
    lines = []
    for start, title in STARTS.items():
        some = reliability.pairs([row for row in rows if row["start"] == start])
        of_kind = [counts[kind, start] for kind in KINDS]
        lines.append([title, *of_kind, len(some), sum(hit for _, hit in some), _mean(some)])
    sums = [sum(line[i] for line in lines) for i in range(1, len(KINDS) + 3)]
    lines.append(["all", *sums, _mean(reliability.pairs(rows))])
    head = ["with a probability", *KINDS, "sum", "first group right", "mean stated"]
    return text + markdown(head, lines)


def _mean(some: Sequence[reliability.Pair]) -> str:
    return f"{np.mean([p for p, _ in some]) * len(some):.1f} of {len(some)}" if some else "none"


def _by_seed(rows: Sequence[Row]) -> list[str]:
    """The wrong and the right of each seed, and their sums."""

    def line(title: object, some: Sequence[Row]) -> list[object]:
        clear = [row for row in some if row["kind"] == "single" and row["drop"] >= CLEAR]
        kinds = [[row for row in some if row["kind"] == kind] for kind in ("single", "removed", "null")]
        wrong = [sum(outcome(row) == "WRONG NAME" for row in part) for part in kinds]
        counts = [f"{bad} of {len(part)}" for bad, part in zip(wrong, kinds, strict=True)]
        return [title, f"{sum(outcome(row) in RIGHT for row in clear)} of {len(clear)}", *counts]

    seeds = sorted({row["seed"] for row in rows})
    lines = [line(seed, [row for row in rows if row["seed"] == seed]) for seed in seeds]
    head = ["seed", f"right, drop >= {CLEAR:g}", "singles wrong", "taken out wrong", "nulls named"]
    return markdown(head, [*lines, line("all", rows)])


def _by_effect(rows: Sequence[Row]) -> list[str]:
    clear = [row for row in rows if row["kind"] == "single" and row["drop"] >= CLEAR]
    effects = sorted({row["hidden"][0] for row in clear})
    lines = [
        _counts(f"`{effect}`", "all", [r for r in clear if r["hidden"][0] == effect]) for effect in effects
    ]
    return markdown(["effect", "n", *COLUMNS], [[line[0], *line[2:]] for line in lines])


def _times(rows: Sequence[Row]) -> list[str]:
    """Median, 95 % and worst of each step."""
    steps: dict[str, list[float]] = {}
    for row in rows:
        for step, seconds in row.get("seconds", {}).items():
            steps.setdefault(step, []).append(seconds)
    steps["all, clock"] = [row["wall_s"] for row in rows if row["verdict"] != "error"]
    steps["all, processor"] = [row["processor_s"] for row in rows if "processor_s" in row]
    lines = [
        [step, len(times), f"{np.median(times):.2f}", f"{np.quantile(times, 0.95):.1f}", f"{max(times):.1f}"]
        for step, times in steps.items()
        if times
    ]
    return markdown(["step", "n", "median s", "95 % s", "worst s"], lines)


def table(rows: Sequence[Row], command: str, picture: str = "") -> str:
    """The results as Markdown.

    Parameters
    ----------
    rows : sequence of dict
    command : str
        That made them.
    picture : str
        Path of the reliability diagram from the page.
    """
    clear = [row for row in rows if row["kind"] == "single" and row["drop"] >= CLEAR]
    bad = [row for row in rows if outcome(row) in ("WRONG NAME", "no result")]
    bad += [row for row in clear if outcome(row) in COLUMNS[3:] and row not in bad]
    parts = [
        [f"Made by `{command}`.", ""],
        _verdicts(rows),
        _figures(rows),
        _by_start(rows),
        _by_seed(rows),
        [f"![Stated probability against the share that was right]({picture})", ""] if picture else [],
        _reliability(rows),
        _by_effect(rows),
        _times(rows),
        [f"Wrong names, and effects with a drop >= {CLEAR:g} without a right answer:", ""],
        [f"- {described(row)}" for row in bad] or ["- none"],
    ]
    return "\n".join(line for part in parts for line in part)


# ---- the command -----------------------------------------------------------------------------------


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Run the study and write its table.")
    parser.add_argument("--seed", type=int, nargs="+", default=list(SEEDS))
    parser.add_argument("--n", type=int, default=20, help="single effects of each seed")
    parser.add_argument(
        "--nulls", type=int, help="of each seed; default: 5 for each 3 single effects and start"
    )
    parser.add_argument("--foreign", type=int, default=0, help="laws outside the catalogue of each seed")
    parser.add_argument("--starts", nargs="+", choices=list(STARTS), default=list(STARTS))
    parser.add_argument("--trial", nargs=3, metavar=("SEED", "KIND", "INDEX"), help="only one trial, printed")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--page", type=Path, help="page to put the table into")
    parser.add_argument("--picture", type=Path, help="reliability diagram")
    options = parser.parse_args(arguments)
    if options.nulls is None:
        options.nulls = 5 * options.n * len(options.starts) // 3
    return options


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study of the diagnosis from records."""
    args = _options(arguments)
    if args.trial:
        seed, kind, index = args.trial
        for what, row in work((int(seed), kind, int(index), " ".join(args.starts)), 0):
            if what == "row":
                print(described(row), row, sep="\n", flush=True)
        return
    wanted = tasks(args.seed, args.n, args.nulls, args.foreign, args.starts)

    def on_done(task: study_pool.Task, rows: list[Row], left_s: float) -> None:
        print(*map(described, rows), f"  {left_s / 60:.0f} min left", sep="\n", flush=True)

    try:
        study_pool.run(
            work, wanted, args.results, bound_s=BOUND_S, n_processes=args.processes, on_done=on_done
        )
    except KeyboardInterrupt:
        print("interrupted; the same command goes on here")
        raise SystemExit(130) from None
    known = {tuple(entry["task"]): entry["rows"] for entry in study_pool.read_lines(args.results)}
    rows = [reliability.by_present_coefficients(row) for task in wanted for row in known[task]]
    seeds = " ".join(map(str, args.seed))
    starts = " ".join(args.starts)
    command = (
        f'make {TARGET} SEED="{seeds}" N={args.n} NULLS={args.nulls} FOREIGN={args.foreign} STARTS="{starts}"'
    )
    picture = os.path.relpath(args.picture, args.page.parent) if args.picture and args.page else ""
    text = table(rows, command, picture)
    print(text)
    if args.picture:
        parts = (reliability.FIRST, reliability.NONE)
        reliability.draw({f"probability of {of}": reliability.pairs(rows, of) for of in parts}, args.picture)
    if args.page:
        put_into(args.page, text, TARGET)


if __name__ == "__main__":
    main()
