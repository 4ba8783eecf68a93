"""Fit the coefficients of the stated probabilities to trials of the study of the diagnosis from records.

Each single effect is diagnosed from one of the three starts in turn, as it is and with its family taken out
of the catalogue; nulls and laws outside the catalogue likewise. Seeds are development seeds (1 to 999).
Results stay in a file; the same command goes on where it stopped.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
from collections.abc import Sequence
from pathlib import Path

import from_records_study as study
import numpy as np
import reliability
import study_pool
from first_stage_study import put_into
from scipy.optimize import minimize
from scipy.special import expit
from study_pool import Row

from gsid.diagnosis.from_records.probability import Calibration, features, probabilities

TARGET = "diagnosis-probability-study"
SEED = 501
PRIOR = 2.0  # standard deviation of each slope: without it trials that a line separates make it infinite
SIGNS = (1, 1, 1, -1)  # of the slopes of `features`
N_FOLDS = 10
CATALOGUED = 0.5  # share of cases in which a law of the catalogue is missing


def tasks(seed: int, n: int, n_nulls: int, n_foreign: int) -> list[study_pool.Task]:
    """Trials with one start each, in an order in which a part is like the whole.

    Parameters
    ----------
    seed, n, n_nulls, n_foreign : int
    """
    starts, made = list(study.STARTS), []
    for kind, number in (("single", n), ("null", n_nulls), ("foreign", n_foreign)):
        made += [((i + 0.5) / number, (seed, kind, i, starts[i % len(starts)])) for i in range(number)]
    return [task for _, task in sorted(made, key=lambda one: one[0])]


def usable(rows: Sequence[Row]) -> list[Row]:
    """Rows for which a probability is stated: something is missing, and one effect at most is named."""
    return [row for row in rows if row.get("basis") and row["verdict"] != "adequate"]


def trial_of(row: Row) -> tuple:
    """A trial, with or without the family of its effect."""
    kind = "single" if row["kind"] == "removed" else row["kind"]
    return row["seed"], kind, row["index"]


def weights(rows: Sequence[Row]) -> np.ndarray:
    """So that a law of the catalogue is missing in the given share of the cases."""
    single = np.array([row["kind"] == "single" for row in rows])
    n = np.count_nonzero(single)
    return len(rows) * np.where(single, CATALOGUED / max(n, 1), (1 - CATALOGUED) / max(len(rows) - n, 1))


def fit(rows: Sequence[Row], source: str) -> Calibration:
    """Logistic regression whose slopes keep their signs, with a normal prior on the slopes.

    Parameters
    ----------
    rows : sequence of dict
        As `usable` gives them.
    source : str
    """
    x = np.array([features(reliability.basis_of(row)) for row in rows]) * SIGNS
    hit, weight = np.array([reliability.is_first_right(row) for row in rows]), weights(rows)

    def cost(values: np.ndarray) -> tuple[float, np.ndarray]:
        odds = values[0] + x @ values[1:]
        slope = weight * (expit(odds) - hit)
        loss = weight @ np.logaddexp(0, np.where(hit, -odds, odds)) + np.sum((values[1:] / PRIOR) ** 2) / 2
        return loss, np.array([slope.sum(), *(slope @ x + values[1:] / PRIOR**2)])

    bounds = [(None, None)] + [(0, None)] * len(SIGNS)
    found = minimize(cost, np.zeros(1 + len(SIGNS)), jac=True, bounds=bounds, method="L-BFGS-B").x
    slopes = [round(float(value), 3) for value in found[1:] * SIGNS]
    wrong = weight * ~hit
    single = np.array([row["kind"] == "single" for row in rows])
    other = float(np.sum(wrong * single) / np.sum(wrong))
    named = {trial_of(row) for row in rows if row["verdict"] == "missing_effect"}
    return Calibration(round(float(found[0]), 3), *slopes, round(other, 3), len(named), source)


def cross_validated(rows: Sequence[Row]) -> list[Row]:
    """Rows with the probability that a fit without their trials gives."""
    trials = sorted({trial_of(row) for row in rows})
    fold_of = {trial: i % N_FOLDS for i, trial in enumerate(trials)}
    made = []
    for fold in range(N_FOLDS):
        inside = [row for row in rows if fold_of[trial_of(row)] == fold]
        known = fit([row for row in rows if fold_of[trial_of(row)] != fold], "") if inside else None
        made += [
            row | {"probability": vars(probabilities(reliability.basis_of(row), known))} for row in inside
        ]
    return made


def table(rows: Sequence[Row], command: str) -> str:
    """Coefficients and cross-validated reliability as Markdown.

    Parameters
    ----------
    rows : sequence of dict
    command : str
    """
    some, trials = usable(rows), {trial_of(row) for row in rows}
    seeds = ", ".join(map(str, sorted({row["seed"] for row in rows})))
    source = f"{TARGET}, seed {seeds}: {len(some)} diagnoses of {len({trial_of(row) for row in some})} trials"
    found = fit(some, source)
    kinds = [[kind, *_counts(rows, some, kind)] for kind in ("single", "removed", "null", "foreign")]
    checked = cross_validated(some)
    first, none = (reliability.pairs(checked, of) for of in (reliability.FIRST, reliability.NONE))
    limit = 1 / (found.n_trials + 2)
    base = float(np.mean([hit for _, hit in first]))
    text = [f"Made by `{command}`, {len(trials)} trials.", ""]
    head = ["diagnoses", "all", "with a probability", "best group right"]
    text += study.markdown(head, [*kinds, ["sum", *np.sum([line[1:] for line in kinds], axis=0)]])
    names = ("intercept", "lead", "margin", "share", "outside", "other", "n_trials")
    text += study.markdown(["coefficient", "value"], [[f"`{name}`", getattr(found, name)] for name in names])
    text += [f"`source`: {source}. The probability of the best group is between {limit:.3f} and "]
    text[-1] += f"{1 - limit:.3f}."
    text.append("")
    text += [f"Cross-validated in {N_FOLDS} parts, no trial in two of them. First group: Brier score"]
    text += [
        f"{reliability.brier(first):.3f} (of the share of right ones, {base:.2f}: {base * (1 - base):.3f})."
    ]
    text += ["", *study.markdown(reliability.HEAD, reliability.lines(first))]
    text += [f"None of the catalogue: Brier score {reliability.brier(none):.3f}.", ""]
    text += study.markdown(reliability.HEAD, reliability.lines(none))
    return "\n".join(text)


def _counts(rows: Sequence[Row], some: Sequence[Row], kind: str) -> list[int]:
    of_kind = [row for row in some if row["kind"] == kind]
    right = sum(reliability.is_first_right(row) for row in of_kind)
    return [sum(row["kind"] == kind for row in rows), len(of_kind), right]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the trials, fit the coefficients and write the table."""
    parser = argparse.ArgumentParser(description="Fit the coefficients of the stated probabilities.")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--n", type=int, default=80, help="single effects")
    parser.add_argument("--nulls", type=int, default=12)
    parser.add_argument("--foreign", type=int, default=20, help="laws outside the catalogue")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--page", type=Path, help="page to put the table into")
    parser.add_argument("--known", action="store_true", help="only the trials that are in the file")
    args = parser.parse_args(arguments)
    wanted = tasks(args.seed, args.n, args.nulls, args.foreign)

    def on_done(task: study_pool.Task, rows: list[Row], left_s: float) -> None:
        print(*map(study.described, rows), f"  {left_s / 60:.0f} min left", sep="\n", flush=True)

    if not args.known:
        try:
            how = {"bound_s": study.BOUND_S, "n_processes": args.processes, "on_done": on_done}
            study_pool.run(study.work, wanted, args.results, **how)
        except KeyboardInterrupt:
            print("interrupted; the same command goes on here")
            raise SystemExit(130) from None
    known = {tuple(entry["task"]): entry["rows"] for entry in study_pool.read_lines(args.results)}
    rows = [row for task in wanted for row in known.get(task, [])]
    command = f"make {TARGET} SEED={args.seed} N={args.n} NULLS={args.nulls} FOREIGN={args.foreign}"
    text = table(rows, command)
    print(text)
    if args.page:
        put_into(args.page, text, TARGET)


if __name__ == "__main__":
    main()
