"""The page of a fleet: one HTML file with its pictures, without scripts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from gsid import plots
from gsid.base.files import write_atomically
from gsid.base.tables import Table, templates
from gsid.fleet import pictures
from gsid.fleet.findings import Findings, Flag, Parameter
from gsid.fleet.table import Merged
from gsid.models.confidence import NORMAL_95
from gsid.report.pictures import inline_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = "fleet.html"
FLAGS_MOST = 100  # units in a table of the page; all of them are in units.csv


@dataclass(frozen=True)
class Picture:
    """A picture of the page, for wide and narrow screens."""

    title: str
    caption: str
    wide: Markup
    narrow: Markup


def write_page(folder: str | Path, found: Findings, merged: Merged) -> Path:
    """Write the page of a fleet into its folder."""
    path = Path(folder) / PAGE
    page = templates().get_template("fleet.html")
    text = page.render(
        title=f"Fleet of {len(found.units)} units",
        sentences=sentences(found),
        pictures=list(map(_painted, *zip(*_drawings(found), strict=True))) if _drawings(found) else [],
        tables=_tables(found, merged),
    )
    write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))
    return path


def sentences(found: Findings) -> list[str]:
    """The answers, the first lines of the page and of the command."""
    status = ", ".join(f"{n} {name}" for name, n in found.n_status.items())
    return [
        f"Measurements: {status}.",
        _flagged(
            "drifted", found.drifted, found.fdr, any(_is_tested(one, "drift") for one in found.parameters)
        ),
        _flagged(
            "deviate from the fleet",
            found.outliers,
            found.fdr,
            any(_is_tested(one, "outlier") for one in found.parameters),
        ),
    ]


def _is_tested(parameter: Parameter, name: str) -> bool:
    return any(p == p for p in getattr(parameter.population, name).p)


def _flagged(what: str, flags: Sequence[Flag], fdr: float, is_tested: bool) -> str:
    if not is_tested:
        return f"Units that {what}: not tested; too few units were measured, or none at two times."
    named = "; ".join(map(str, flags[:5])) or "none"
    more = f"; and {len(flags) - 5} more" if len(flags) > 5 else ""
    return f"Units that {what}, at a false discovery rate of {fdr:g}: {named}{more}."


# ---- tables ---------------------------------------------------------------------------------------------


def _tables(found: Findings, merged: Merged) -> list[Table]:
    failed = [[unit, why] for unit, why in merged.failed]
    tables = [
        Table(["failed unit", "reason"], failed, title="Failed units"),
        _flag_table("Drifted units", "change from first to last", found.drifted),
        _flag_table("Outliers", "deviation from the fleet", found.outliers),
        _parameter_table(found.parameters),
    ]
    return [table for table in tables if table.rows]


def _flag_table(title: str, what: str, flags: Sequence[Flag]) -> Table:
    rows = [[flag.unit, flag.parameter, flag.amount, f"{flag.q:.2g}"] for flag in flags[:FLAGS_MOST]]
    note = f"The first {FLAGS_MOST} of {len(flags)}; all are in units.csv." if len(flags) > FLAGS_MOST else ""
    return Table(["unit", "parameter", what, "q-value"], rows, title=title, note=note)


def _parameter_table(parameters: Sequence[Parameter]) -> Table:
    head = ["parameter", "units", "mean, 95 % interval", "std between units", "std within units"]
    head += ["change of the median unit", "p of equal groups"]
    return Table(
        head,
        [_parameter_row(one) for one in parameters],
        title="Parameters over the fleet",
        note="Within units: scatter of repeated measurements beyond the standard deviations of their fits.",
    )


def _parameter_row(one: Parameter) -> list[str]:
    whole = one.population
    half = NORMAL_95 * whole.mean_std
    ends = [whole.mean, whole.mean - half, whole.mean + half]
    mean, low, high = map(math.exp, ends) if whole.is_log else ends
    spread = "{:.2%}" if whole.is_log else "{:.3g}"
    p = "" if one.group_p != one.group_p else f"{one.group_p:.2g}"
    figures = [spread.format(value) for value in (whole.between, whole.within, whole.common_drift)]
    return [one.label, str(one.n_units), f"{mean:.4g} ({low:.4g} to {high:.4g})", *figures, p]


# ---- pictures -------------------------------------------------------------------------------------------


def _drawings(found: Findings) -> list[tuple[str, str, Callable[[], Figure]]]:
    drawings = []
    if found.n_missing:
        text = (
            "Measurements by the effect that is missing from the model, or by the verdict if none is named."
        )
        drawings.append(("Missing effects", text, lambda: pictures.missing_effects(found)))
    if any(_is_tested(one, "outlier") for one in found.parameters):
        text = (
            "One point for each unit: its distance from the fleet, in standard deviations of units. Units in "
            f"colour deviate at a false discovery rate of {found.fdr:g}."
        )
        drawings.append(("Units against the fleet", text, lambda: pictures.deviations(found)))
    if any(_is_tested(one, "drift") for one in found.parameters):
        text = (
            "One point for each unit: its change from the first to the last measurement, less that of the "
            "median unit, in standard deviations of repeated measurements. Units in colour have drifted."
        )
        drawings.append(("Drift", text, lambda: pictures.drifts(found)))
    return drawings


def _painted(title: str, caption: str, draw: Callable[[], Figure]) -> Picture:
    prefix, label = title.split()[0].lower(), f"{title}. {caption}"
    wide = inline_svg(draw(), f"{prefix}w-", label, "wide")
    with plots.narrow():
        return Picture(title, caption, wide, inline_svg(draw(), f"{prefix}n-", label, "narrow"))
