"""gsid look"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from gsid.base.tables import Table
from gsid.cli.common import EXIT_CRITERION, EXIT_GOOD
from gsid.cli.option_types import Ends
from gsid.cli.options import json_option, picture_option, record_options
from gsid.cli.output import answered, draw, print_message, print_table

if TYPE_CHECKING:
    from gsid.records.record import Record
    from gsid.spectrum.spectra import Spectra

POSITION = ("position", "position_unit", "offset", "offset_std")
CONDITION = ("drift", "drift_error", "drifts", "spikes_s")
MOST_IN_TABLE = 8  # columns or times in a cell
MOST_SPIKES = 3  # whose times are in the sentence


@click.command(short_help="Show what is in a record.")
@record_options
@click.option(
    "--limit-travel-deg",
    "travel",
    type=Ends(may_be_one=True),
    help="Limit of the position from the start [deg]: D to both sides, or LO:HI. Exit 1 if a record exceeds"
    " it.",
)
@picture_option
@json_option
def look(
    *, records: list[Record], travel: tuple[float, float] | None, picture: str | None, as_json: bool
) -> int:
    """Show what is in each record: samples, rate, period, settling, lost samples, lines, drift and spikes.

    The position is the integral of an output in deg/s (or another unit per second), less the offset of the
    gyro: the mean output over the periods, in which the axis returns to where it was.

    The drift is the change of the mean output from the first period to the last. A spike differs from the
    same sample of the other periods by more than 8 times their scatter. refresh_hz is the rate at which y
    takes a new value, if its samples repeat because the sensor has a lower rate than the record. clipped
    lists the ends of the range of y that have at least five times as many samples as any of the next values:
    the sensor is clipped, or the axis is at a stop or at rest.

    The picture shows input and output over the whole record, the part that is discarded as settling, and, if
    the input repeats, the position and the spectrum of the periods.
    """
    from gsid.plots.record import records as figure

    seen = [(record, _spectra(record)) for record in records]
    draw(lambda: figure(seen, travel=travel), picture)
    facts = [_facts(record, found, travel) for record, found in seen]
    exceeded = any(one.get("within_travel") is False for one in facts)
    code = EXIT_CRITERION if exceeded else EXIT_GOOD
    if answered(as_json, lambda: {"records": facts, "sentences": [_sentence(one) for one in facts]}):
        return code
    names = list(facts[0])
    print_table(
        Table(
            ["", *(str(one["name"]) for one in facts)],
            [[name, *(_text(one[name]) for one in facts)] for name in names if name != "name"],
            left=[""],
        )
    )
    return code


def _spectra(record: Record) -> Spectra | None:
    """Its periods; None, with a note, if it has none."""
    from gsid.base.errors import InputError
    from gsid.spectrum.realisation import spectra

    try:
        return spectra(record)
    except InputError as error:
        print_message(f"note: {record.name}: {error}")
        return None


def _facts(record: Record, found: Spectra | None, travel: tuple[float, float] | None) -> dict[str, object]:
    from gsid.records.clipping import clipped_ends
    from gsid.records.refresh import refresh_rate_hz

    n = len(record.u)
    facts: dict[str, object] = {
        "name": record.name,
        "samples": n,
        "fs_hz": record.fs_hz,
        "time_s": n / record.fs_hz,
        "lost_samples": int(n - record.valid.sum()),
        "u_unit": record.u_unit,
        "y_unit": record.y_unit,
        "hold": record.hold or "not stated",
        "refresh_hz": refresh_rate_hz(record),
        "clipped": [{"value": end.value, "share": end.share} for end in clipped_ends(record)],
        "other_columns": list(record.columns),
    }
    if found is None:
        return facts | dict.fromkeys(
            (
                *("period_samples", "periods", "settle_samples", "excited_lines", "band_hz"),
                *CONDITION,
                *POSITION,
            )
        )
    f_hz = found.f_hz[found.excited]
    return facts | {
        "period_samples": found.period_samples,
        "periods": found.n_periods,
        "settle_samples": found.settle_samples,
        "excited_lines": len(f_hz),
        "band_hz": (float(f_hz[0]), float(f_hz[-1])),
        **_condition(record, found),
        **_position(record, found, travel),
    }


def _position(record: Record, found: Spectra, travel: tuple[float, float] | None) -> dict[str, object]:
    from gsid.base.errors import InputError
    from gsid.records.position import position

    try:
        if not record.y_unit:
            raise InputError("the unit of y is not known", record.name)
        place = position(record, period=found.period_samples, settle=found.settle_samples)
        limits = None if travel is None else place.from_deg(travel)
    except InputError as error:
        if travel is not None:
            hint = "the record needs an output in deg/s: `# y_unit: deg/s` in its file"
            raise InputError("the position is not known", record.name, error.what, hint) from error
        return dict.fromkeys(POSITION)
    values = ((place.lo, place.hi), place.unit, place.offset, place.std_offset)
    known: dict[str, object] = dict(zip(POSITION, values, strict=True))
    return known if limits is None else known | {"within_travel": place.within(*limits)}


def _condition(record: Record, found: Spectra) -> dict[str, object]:
    from gsid.records.condition import condition_of
    from gsid.records.periods import split_periods

    seen = condition_of(split_periods(record, period=found.period_samples, settle=found.settle_samples))
    error = None if math.isnan(seen.drift_error) else seen.drift_error
    spikes = [float(sample / record.fs_hz) for sample in seen.spikes]
    return dict(zip(CONDITION, (seen.drift, error, seen.drifts, spikes), strict=True))


def _sentence(facts: dict[str, object]) -> str:
    settling = facts["settle_samples"]
    begin = (
        f"{facts['name']}: {facts['samples']} samples at {facts['fs_hz']:g} Hz, {facts['lost_samples']} lost"
    )
    if facts["period_samples"] is None:
        return f"{begin}; no period was found."
    return (
        f"{begin}; {facts['periods']} periods of {facts['period_samples']} samples after {settling} "
        f"of settling; {facts['excited_lines']} excited lines from {_text(facts['band_hz'])} Hz."
        + _refresh_in_words(facts)
        + _condition_in_words(facts)
        + _position_in_words(facts)
    )


def _refresh_in_words(facts: dict[str, Any]) -> str:
    rate_hz = facts["refresh_hz"]
    return "" if rate_hz is None else f" The sensor of y is refreshed at {rate_hz:.5g} Hz."


def _condition_in_words(facts: dict[str, Any]) -> str:
    words = ""
    if facts["drifts"]:
        size = f"{facts['drift']:.2g} {facts['y_unit']}".strip()
        words += f" The mean output drifts by {size} over the periods."
    for end in facts["clipped"]:
        words += f" The output stays at an end of its range, {_text(end)} of the samples."
    if times := facts["spikes_s"]:
        where = ", ".join(f"{time:.4g}" for time in times[:MOST_SPIKES])
        more = ", ..." if len(times) > MOST_SPIKES else ""
        noun = "spike" if len(times) == 1 else "spikes"
        words += f" {len(times)} {noun} in the output, at {where}{more} s."
    return words


def _position_in_words(facts: dict[str, Any]) -> str:
    if "within_travel" not in facts:
        return ""
    low, high = facts["position"]
    words = f" The position goes from {low:.3g} to {high:.3g} {facts['position_unit']}"
    return f"{words}, {'within' if facts['within_travel'] else 'beyond'} its limits."


def _text(value: object) -> str:
    if value is None:
        return "not found"
    if isinstance(value, tuple):
        return f"{value[0]:.4g} to {value[1]:.4g}"
    if isinstance(value, list):
        more = f", ... ({len(value)})" if len(value) > MOST_IN_TABLE else ""
        return (", ".join(_text(one) for one in value[:MOST_IN_TABLE]) or "none") + more
    if isinstance(value, dict):
        return f"{value['value']:.4g} in {value['share']:.2%}"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)
