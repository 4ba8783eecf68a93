"""Coverage of the intervals of `gsid fit` for the best linear approximation of an axis with Coulomb friction.

The axis is like that of the tutorial, with a body that stays underdamped, run by the blind trials' own
simulator. The reference of each parameter is the mean over all realisations: what a fit of many records would
give. Run by `make fit-coverage`.
"""

from __future__ import annotations

import argparse

import axes
import numpy as np

from gsid.fitting.rational import fit
from gsid.models.rational import RationalModel
from gsid.records.record import Record
from gsid.response.with_distortion import frf_with_distortion

AXIS = {
    "gain": 7.4,
    "rate": 5.0,
    "stiffness": 400.0,
    "modes": [(179.0, 0.015, 0.15)],
    "lag_s": 1e-3,
    "delay_s": 5.4e-3,
}
ORDER = "5/3"
GROUPS = {"denominator": slice(0, 5), "numerator": slice(5, 9), "delay": slice(9, 10)}
NORMAL_95 = 1.959964


def record(coulomb: float, rng: np.random.Generator) -> Record:
    """One realisation of 6 periods."""
    u, y = axes.measured(axes.Axis(**AXIS, coulomb=coulomb), rng)
    return Record(u, y, axes.FS_HZ, axes.N, 0, hold="zoh")


def quantities(model: RationalModel) -> np.ndarray:
    """Values of (den[1:], num, delay), standard deviations, and those of the noise only, (3, p)."""
    values = np.array([*model.den[1:], *model.num, model.delay_s])
    stds = [np.array([*m.std_den[1:], *m.std_num, m.std_delay_s]) for m in (model, model.noise_only())]
    return np.array([values, *stds])


def study(coulomb: float, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Shares of the intervals that hold, with all errors and with the noise only, (p,) each."""
    found, start = [], None
    for k in range(n):
        rng = np.random.default_rng([seed, k])
        model = fit(frf_with_distortion(record(coulomb, rng)), ORDER, start=start, quiet=True)
        start = start or model
        found.append(quantities(model))
    values, std, noise = np.moveaxis(np.array(found), 1, 0)
    away = np.abs(values - values.mean(axis=0)) / np.sqrt(1 - 1 / n)  # the reference contains each value
    return np.mean(away < NORMAL_95 * std, axis=0), np.mean(away < NORMAL_95 * noise, axis=0)


def table(levels: tuple[float, ...], n: int, seed: int) -> str:
    """Table of the study in Markdown."""
    lines = [
        f"Seed {seed}, {n} realisations for each level.",
        "",
        f"| Coulomb friction | {' | '.join(GROUPS)} | all | least of all | noise only, all |",
        "|---" * (len(GROUPS) + 4) + "|",
    ]
    for level in levels:
        held, noise = study(level, n, seed)
        shares = [held[group].mean() for group in GROUPS.values()]
        shares += [held.mean(), held.min(), noise.mean()]
        row = f"| {100 * level:g} % | {' | '.join(f'{100 * share:.0f} %' for share in shares)} |"
        print(row, flush=True)
        lines.append(row)
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--page", help="page with the table between its marks")
    arguments = parser.parse_args()
    text = table((0.0, 0.05, 0.2), arguments.trials, arguments.seed)
    if arguments.page:
        with open(arguments.page, encoding="utf-8") as file:
            page = file.read()
        before, rest = page.split("<!-- coverage: begin -->")
        after = rest.split("<!-- coverage: end -->")[1]
        page = f"{before}<!-- coverage: begin -->\n{text}\n<!-- coverage: end -->{after}"
        with open(arguments.page, "w", encoding="utf-8") as file:
            file.write(page)


if __name__ == "__main__":
    main()
