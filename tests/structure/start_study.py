"""How often `gsid start` finds the structure of simulated axes, with Coulomb friction of several sizes.

A second study runs several realisations on each of a few axes: the intervals have to hold the parameters of
the best linear approximation, which are the mean of the estimates over the realisations.

Each trial is drawn from (seed, friction, index) alone and leaves one file, so that a study that was broken
off goes on where it stopped. Each table is written between two marks of the page.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # two processes share the machine

import axes
import click
import numpy as np

from gsid.structure.elements import Structure

MARKS = "<!-- {}: begin -->", "<!-- {}: end -->"
LEAST_RIGHT = 5  # realisations of an axis with the right stack, for a mean
RESONANCE = 5e-3  # relative error of a resonance that counts as found
NORMAL_95 = 1.96


def trial(seed: int, percent: int, index: int) -> dict:
    """Draw an axis, simulate one realisation, and compare what is found with the truth."""
    import gsid

    rng = np.random.default_rng([seed, percent, index])
    axis = axes.drawn(rng, percent / 100)
    u, y = axes.measured(axis, rng)
    record = gsid.Record(u, y, axes.FS_HZ, axes.N, 0, hold="zoh")
    began = time.process_time()
    found = gsid.start(record)
    seconds = time.process_time() - began
    in_band = [label for label in found.effects if _is_mode(label, found)]
    return {
        "axis": vars(axis) | {"body": axis.body},
        "effects": found.effects,
        "represented": found.represented,
        "right": _is_right(axis, found),
        "listed": _is_right(axis, found) or _is_listed(axis, found),
        "body_right": ("cable_spring" in found.effects) == (axis.stiffness > 0) and found.output == "rate",
        "n_modes_right": len(in_band) == len(axis.modes),
        "error": _worst_resonance(axis, found, in_band),
        "inside": _inside(axis, found, in_band, found.std),
        "inside_noise_only": _inside(axis, found, in_band, found.std_noise_only),
        "seconds": seconds,
    }


def _is_mode(label: str, found) -> bool:
    return label.startswith("flexible_mode") and "f_hz" in found.std.get(label, {})


def _is_right(axis: axes.Axis, found) -> bool:
    """The same elements, no more and no fewer."""
    expected = {"rigid_body", "viscous_friction", "transport_delay"}
    expected |= {"cable_spring"} if axis.stiffness else set()
    expected |= {"sensor_lag"} if axis.lag_s else set()
    expected |= {"flexible_mode" if i == 0 else f"flexible_mode#{i + 1}" for i in range(len(axis.modes))}
    return found.output == "rate" and set(found.effects) == expected


def _is_listed(axis: axes.Axis, found) -> bool:
    """Whether the right structure is printed as ambiguous."""
    structure = Structure("rate", axis.body, len(axis.modes), int(axis.lag_s > 0), False)
    return structure.text() in [one["other"] for one in found.ambiguous if one["what"] == "structure"]


def _worst_resonance(axis: axes.Axis, found, labels: list[str]) -> float:
    f_hz = np.array([found.effects[label]["f_hz"] for label in labels])
    return max(float(np.min(np.abs(f_hz / f - 1), initial=1.0)) for f, _, _ in axis.modes)


def _inside(axis: axes.Axis, found, labels: list[str], std: dict) -> list[bool]:
    """Whether the intervals of frequency, damping and delay hold the truth: friction does not move them."""
    if not _is_right(axis, found):
        return []
    held = []
    for label, (f_hz, zeta, _) in zip(labels, axis.modes, strict=True):
        for name, true in (("f_hz", f_hz), ("zeta", zeta)):
            held.append(abs(found.effects[label][name] - true) < NORMAL_95 * std[label][name])
    delay = abs(found.effects["transport_delay"]["delay_s"] - axis.delay_s)
    return [*map(bool, held), bool(delay < NORMAL_95 * std["transport_delay"]["delay_s"])]


def repetition(seed: int, percent: int, index: int, number: int) -> dict:
    """Estimates and standard deviations of one of several realisations of an axis."""
    import gsid

    axis = axes.drawn(np.random.default_rng([seed, percent, index, 1]), percent / 100)
    u, y = axes.measured(axis, np.random.default_rng([seed, percent, index, 2, number]))
    found = gsid.start(gsid.Record(u, y, axes.FS_HZ, axes.N, 0, hold="zoh"))
    if not _is_right(axis, found):
        return {"right": False}
    flat = [
        [f"{effect.partition('#')[0]}.{name}", value, found.std[effect][name]]
        for effect, params in found.effects.items()
        for name, value in params.items()
    ]
    return {"right": True, "flat": flat}


def run(path: Path, what: Callable[..., dict], *arguments: int) -> None:
    """One trial, unless it has its file."""
    if path.exists():
        return
    try:
        result = what(*arguments)
    except axes.truth.TruthError as error:
        result = {"not_simulated": str(error)}
    part = path.with_suffix(".part")
    part.write_text(json.dumps(result))
    part.replace(path)


def table(folder: Path, seed: int, n: int, levels: tuple[int, ...]) -> str:
    """The study's table in Markdown."""
    rows = [
        "| Coulomb friction | right stack | right, or printed as ambiguous | output and body right "
        "| number of modes right | all resonances within 0.5 % | worst (median) resonance error "
        "| 95 % intervals that hold the truth | noise only | median s |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for percent in levels:
        paths = [folder / f"{seed}_{percent:02d}_{i:04d}.json" for i in range(n)]
        results = [json.loads(path.read_text()) for path in paths if path.exists()]
        some = [one for one in results if "not_simulated" not in one]
        if some:
            rows.append(_row(percent, some))
    return "\n".join(rows)


def _row(percent: int, some: list[dict]) -> str:
    def of(name: str) -> str:
        return f"{sum(one[name] for one in some)} of {len(some)}"

    def share(name: str) -> str:
        return _share([inside for one in some for inside in one[name]])

    error = [one["error"] for one in some]
    near = sum(e < RESONANCE for e in error)
    seconds = np.median([one["seconds"] for one in some])
    worst = f"{100 * max(error):.2f} % ({100 * np.median(error):.3f} %)"
    cells = [
        f"{percent} %",
        of("right"),
        of("listed"),
        of("body_right"),
        of("n_modes_right"),
        f"{near} of {len(some)}",
        worst,
    ]
    cells += [share("inside"), share("inside_noise_only"), f"{seconds:.1f}"]
    return "| " + " | ".join(cells) + " |"


def coverage_table(folder: Path, seed: int, n_axes: int, n_times: int, levels: tuple[int, ...]) -> str:
    """How often the intervals hold the mean over the realisations."""
    held: dict[str, dict[int, list[bool]]] = {}
    for percent in levels:
        for index in range(n_axes):
            paths = [
                folder / f"repeated_{seed}_{percent:02d}_{index:04d}_{r:04d}.json" for r in range(n_times)
            ]
            results = [json.loads(path.read_text()) for path in paths if path.exists()]
            for name, inside in _around_mean([one["flat"] for one in results if one.get("right")]):
                held.setdefault(name, {}).setdefault(percent, []).extend(inside)
    head = [f"{percent} %" for percent in levels]
    rows = ["| parameter | " + " | ".join(head) + " |", "|---|" + "---|" * len(levels)]
    for name, by_level in held.items():
        rows.append(f"| `{name}` | " + " | ".join(_share(by_level.get(p, [])) for p in levels) + " |")
    total = [[one for by_level in held.values() for one in by_level.get(p, [])] for p in levels]
    return "\n".join([*rows, "| all | " + " | ".join(map(_share, total)) + " |"])


def _around_mean(estimates: list[list]) -> Iterator[tuple[str, list[bool]]]:
    """For each parameter whether each realisation's interval holds the mean of all."""
    n = len(estimates)
    if n < LEAST_RIGHT:
        return
    for each in zip(*estimates, strict=True):
        value, std = (np.array([one[i] for one in each]) for i in (1, 2))
        own = np.sqrt(1 - 1 / n)  # each estimate is part of the mean
        yield each[0][0], [bool(one) for one in np.abs(value - value.mean()) < NORMAL_95 * own * std]


def _share(held: list[bool]) -> str:
    return f"{100 * np.mean(held):.0f} % of {len(held)}" if held else "-"


def write_table(page: Path, name: str, text: str) -> None:
    """Put a table between its marks."""
    begin, end = (mark.format(name) for mark in MARKS)
    before, _, rest = page.read_text().partition(begin)
    _, mark, after = rest.partition(end)
    if not mark:
        raise click.UsageError(f"{page} has no marks for the table {name}")
    page.write_text(f"{before}{begin}\n{text}\n{end}{after}")


@click.command()
@click.option("--trials", "n", default=100, show_default=True)
@click.option("--seed", default=1, show_default=True)
@click.option("--level", "levels", type=int, multiple=True, default=(0, 5, 20), show_default=True)
@click.option("--results", type=click.Path(path_type=Path), required=True)
@click.option("--page", type=click.Path(path_type=Path), help="Page that receives the table.")
@click.option("--axes", "n_axes", default=8, show_default=True, help="Axes with several realisations.")
@click.option("--times", "n_times", default=12, show_default=True, help="Realisations of each.")
@click.option("--processes", default=1, show_default=True)
def main(
    *,
    n: int,
    seed: int,
    levels: tuple[int, ...],
    results: Path,
    page: Path | None,
    n_axes: int,
    n_times: int,
    processes: int,
) -> None:
    """Run the trials that have no result yet, and print the table."""
    results.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(processes) as pool:
        jobs = [
            pool.submit(run, results / f"{seed}_{percent:02d}_{i:04d}.json", trial, seed, percent, i)
            for i in range(n)
            for percent in levels
        ]
        jobs += [
            pool.submit(
                run,
                results / f"repeated_{seed}_{percent:02d}_{i:04d}_{r:04d}.json",
                repetition,
                *(seed, percent, i, r),
            )
            for i in range(n_axes)
            for r in range(n_times)
            for percent in levels
        ]
        for done, job in enumerate(as_completed(jobs), 1):
            job.result()
            if sys.stderr.isatty():
                print(f"\r{done} of {len(jobs)}", end="", file=sys.stderr)
    text = table(results, seed, n, levels)
    coverage = coverage_table(results, seed, n_axes, n_times, levels)
    print(text, coverage, sep="\n\n")
    if page is not None:
        write_table(page, "study", f"Seed {seed}.\n\n{text}")
        write_table(
            page, "coverage", f"Seed {seed}, {n_axes} axes, {n_times} realisations of each.\n\n{coverage}"
        )


if __name__ == "__main__":
    main()
