"""Whether the diagnosis of a measured record depends on which part of it is used.

Each record is diagnosed whole and from random subsets: other periods, another first sample, another band.
The same answer, or unknown, is right; another name is wrong. Results stay in a file; a broken run goes on
where it stopped. Delete the file after a change of the diagnosis.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # times are those of one core

import argparse
import json
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from first_stage_study import put_into

import gsid
from gsid.records.files import read_record
from gsid.records.record import Record
from measured import DATA

SEED = 16
TARGET = "measured-subsets"
WHOLE = -1  # number of the diagnosis of the whole record
BUDGET_S = 600.0  # the answer shall not depend on what else runs
WORD = {
    "missing_effect": "named",
    "nearest_effect": "nearest",
    "unknown_effect": "unknown",
    "adequate": "none",
}
Row = dict


def silverbox() -> Record:
    """The first Schroeder section, with its settling."""
    whole, part = np.load(DATA / "silverbox/Schroeder80mV.npz"), slice(10587, 10587 + 11 * 1024)
    return Record(whole["u"][part].astype(float), whole["y"][part].astype(float), 610.3515625, 1024, 1024)


def bouc_wen() -> Record:
    """The part to identify; it begins in the steady state."""
    whole = np.load(DATA / "bouc_wen_synthetic/bw.npz")
    return Record(whole["u_train"].astype(float), whole["y_train"].astype(float), 750.0, 8192, 0)


def bench(name: str) -> Record:
    """Current and angle of the motor."""
    return read_record(DATA / f"twomass_motor_bench/multisine_{name}.npz", u="iq_ref", y="theta_motor")


def crane() -> Record:
    """Velocity of the cart and angle of the cable."""
    return read_record(DATA / "crane_multisine/exp1.npz", u="u", y="cable_angle")


def emps() -> Record:
    """Drive voltage and position."""
    return read_record(DATA / "emps/estimation.npz", u="v", y="q")


RECORDS: dict[str, Callable[[], Record]] = {
    "silverbox": silverbox,
    "motor bench A": lambda: bench("A"),
    "motor bench B": lambda: bench("B"),
    "crane": crane,
    "EMPS": emps,
    "Bouc-Wen": bouc_wen,
}
REFERENCE = {"EMPS": "q_ref"}


def drawn(record: Record, rng: np.random.Generator) -> tuple[Record, tuple[float, float]]:
    """A random number of periods from a random sample on, and a random band.

    At least half of the periods, and two, stay. The lowest line is multiplied by 1 to 3, the highest by 0.5
    to 1.
    """
    one = gsid.spectra(record)
    n, settle = one.period_samples, one.settle_samples
    most = (len(record.u) - settle) // n
    periods = int(rng.integers(max(2, (most + 1) // 2), most + 1))
    first = settle + int(rng.integers(0, len(record.u) - settle - periods * n + 1))
    part = slice(first, first + periods * n)
    columns = {name: column[part] for name, column in record.columns.items()}
    smaller = Record(record.u[part], record.y[part], record.fs_hz, n, 0, u_unit=record.u_unit)
    smaller.y_unit, smaller.hold, smaller.columns = record.y_unit, record.hold, columns
    excited = one.f_hz[one.excited]
    return smaller, (float(excited[0] * rng.uniform(1, 3)), float(excited[-1] * rng.uniform(0.5, 1)))


def diagnosed(name: str, number: int, seed: int) -> Row:
    """The verdict of one subset, or of the whole record."""
    record, band = RECORDS[name](), None
    if number != WHOLE:
        rng = np.random.default_rng([seed, number, *name.encode()])
        record, band = drawn(record, rng)
    begin = time.perf_counter(), time.process_time()
    found = gsid.diagnose_records(record, reference=REFERENCE.get(name), band=band, time_s=BUDGET_S)
    return {
        "seed": seed,
        "record": name,
        "number": number,
        "band": band,
        "samples": len(record.u),
        "verdict": found.verdict,
        "effects": list(found.effects),
        "reasons": list(found.reasons),
        "left": found.unexplained_share,
        "ripple": vars(found.ripple) if found.ripple else None,
        "seconds": time.perf_counter() - begin[0],
        "processor_s": time.process_time() - begin[1],
    }


def run(results: Path, seed: int, n: int, names: Iterable[str]) -> list[Row]:
    """All rows; those that are there already are not made again."""
    results.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
    done = {(row["seed"], row["record"], row["number"]) for row in rows}
    for number in range(WHOLE, n):
        for name in names:
            if (seed, name, number) not in done:
                row = diagnosed(name, number, seed)
                with results.open("a") as out:
                    out.write(json.dumps(row, default=float) + "\n")
                rows.append(row)
                print(name, number, answer(row), f"{row['processor_s']:.0f} s", *row["reasons"], flush=True)
    return [row for row in rows if row["seed"] == seed and row["number"] < n]


def answer(row: Row) -> str:
    """The verdict in a word, with its law."""
    return " ".join([WORD[row["verdict"]], " or ".join(f"`{effect}`" for effect in row["effects"])]).strip()


def table(rows: list[Row], command: str) -> str:
    """The results as Markdown."""
    lines = [
        f"Made by `{command}`.",
        "",
        "| record | whole | subsets | another name | processor time, median (worst) |",
        "|---|---|---|---|---|",
    ]
    for name in RECORDS:
        own = [row for row in rows if row["record"] == name]
        whole = [row for row in own if row["number"] == WHOLE]
        parts = [row for row in own if row["number"] != WHOLE]
        if not whole:
            continue
        answers = [answer(row) for row in parts]
        counts = ", ".join(
            f"{answers.count(each)} {each}" for each in sorted(set(answers), key=answers.count)[::-1]
        )
        right = set(whole[0]["effects"])
        others = sum(r["verdict"] == "missing_effect" and not right & set(r["effects"]) for r in parts)
        times = [row["processor_s"] for row in own]
        spent = f"{np.median(times):.0f} s ({max(times):.0f} s)"
        lines.append(f"| {name} | {answer(whole[0])} | {counts} | {others} of {len(parts)} | {spent} |")
    return "\n".join(lines)


def main(arguments: Iterable[str] | None = None) -> None:
    """Run the study and write its table."""
    parser = argparse.ArgumentParser(description="Diagnose random subsets of the measured records.")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--n", type=int, default=10, help="subsets of each record")
    parser.add_argument("--records", nargs="*", choices=list(RECORDS), default=list(RECORDS))
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--page", type=Path, help="page to put the table into")
    args = parser.parse_args(arguments)
    rows = run(args.results, args.seed, args.n, args.records)
    text = table(rows, f"make {TARGET} SEED={args.seed} N={args.n}")
    print(text)
    if args.page:
        put_into(args.page, text, TARGET)


if __name__ == "__main__":
    main()
