"""Stated probabilities of a diagnosis against how often they came true: tables and a picture."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from score import share
from study_pool import Row

from gsid.diagnosis.from_records.basis import Basis
from gsid.diagnosis.from_records.probability import probabilities

EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 1.0)
LAGS = {"motor_lag", "sensor_lag"}  # a linear axis does not show the order of its lags
FIRST, NONE = "the first group", "none of the catalogue"

Pair = tuple[float, bool]  # a stated probability, and whether it came true


def basis_of(row: Row) -> Basis:
    """What the diagnosis knew of its best law.

    Parameters
    ----------
    row : dict
        With a basis.
    """
    return Basis(**row["basis"] | {"effects": tuple(row["basis"]["effects"])})


def by_present_coefficients(row: Row) -> Row:
    """A row with the probabilities that the present coefficients give, where it states any.

    Parameters
    ----------
    row : dict
    """
    if row.get("probability") is None:
        return row
    return row | {"probability": vars(probabilities(basis_of(row)))}


def is_first_right(row: Row) -> bool:
    """Whether the hidden effect is in the best group; never where its family was taken out.

    Parameters
    ----------
    row : dict
        With a basis.
    """
    return row["kind"] == "single" and bool(known_as(row["hidden"]) & set(row["basis"]["effects"]))


def known_as(hidden: Iterable[str]) -> set[str]:
    """Names of hidden effects that are right: either lag for one of them.

    Parameters
    ----------
    hidden : iterable of str
    """
    names = set(hidden)
    return names | LAGS if LAGS & names else names


def has_none(row: Row) -> bool:
    """Whether none of the catalogue that was tried is hidden.

    Parameters
    ----------
    row : dict
    """
    return row["kind"] != "single"


def pairs(rows: Iterable[Row], of: str = FIRST) -> list[Pair]:
    """Stated probabilities, and whether they came true.

    Parameters
    ----------
    rows : iterable of dict
        Of the study; those without a probability are left out.
    of : str
        `FIRST` or `NONE`.
    """
    stated = [row for row in rows if row.get("probability") is not None]
    if of == NONE:
        return [(row["probability"]["none"], has_none(row)) for row in stated]
    return [(row["probability"]["best"], is_first_right(row)) for row in stated]


def brier(some: Sequence[Pair]) -> float:
    """Mean square of the difference of the probability from 0 or 1; NaN without any.

    Parameters
    ----------
    some : sequence of (float, bool)
    """
    return float(np.mean([(p - hit) ** 2 for p, hit in some])) if some else float("nan")


def bins(some: Sequence[Pair]) -> list[dict]:
    """For each bin of the stated probability: its mean, and how often it came true with a 95 % interval.

    Parameters
    ----------
    some : sequence of (float, bool)
    """
    found = []
    for low, high in pairwise(EDGES):
        inside = [(p, hit) for p, hit in some if low <= p < high or p == high == EDGES[-1]]
        stated = float(np.mean([p for p, _ in inside])) if inside else float("nan")
        found.append({"from": low, "to": high, "stated": stated} | share(hit for _, hit in inside))
    return found


def lines(some: Sequence[Pair]) -> list[list[object]]:
    """The bins and their sum as rows of a table.

    Parameters
    ----------
    some : sequence of (float, bool)
    """
    made = [
        [f"{one['from']:g} to {one['to']:g}", *_cells(one["stated"], one)] for one in bins(some) if one["n"]
    ]
    if not some:
        return made
    mean = float(np.mean([p for p, _ in some]))
    return [*made, ["all", *_cells(mean, share(hit for _, hit in some))]]


HEAD = ("stated", "mean stated", "right", "n", "share", "95 % interval")


def _cells(stated: float, found: dict) -> list[object]:
    interval = f"{found['low']:.3f} to {found['high']:.3f}"
    return [f"{stated:.3f}", found["hits"], found["n"], f"{found['share']:.3f}", interval]


def draw(some: dict[str, Sequence[Pair]], path: Path) -> None:
    """Draw the reliability diagrams.

    Parameters
    ----------
    some : dict of sequence of (float, bool)
        Title of each diagram, and its pairs.
    path : Path
        PNG file.
    """
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(some), figsize=(4.2 * len(some), 4.9), layout="constrained")
    for ax, (title, each) in zip(np.atleast_1d(axes), some.items(), strict=True):
        ax.plot([0, 1], [0, 1], color="0.7", linewidth=1)
        used = [one for one in bins(each) if one["n"]]
        x, y = (np.array([one[key] for one in used]) for key in ("stated", "share"))
        low, high = (np.array([one[key] for one in used]) for key in ("low", "high"))
        ax.errorbar(x, y, [y - low, high - y], fmt="o", capsize=3)
        how = {"textcoords": "offset points", "fontsize": 8, "ha": "center"}
        for i, one in enumerate(used):  # in turn above and below: the last ones are near each other
            end, offset = ("high", 4) if i % 2 else ("low", -11)
            ax.annotate(str(one["n"]), (one["stated"], one[end]), (0, offset), **how)
        ax.set(title=title, xlabel="stated probability", ylabel="share that was right", aspect="equal")
        ax.set(xlim=(-0.03, 1.03), ylim=(-0.07, 1.07))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
