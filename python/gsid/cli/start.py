"""gsid start"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import click

from gsid.cli.options import (
    band_option,
    found_model_option,
    inertia_option,
    json_option,
    options_as_arguments,
    output_is_option,
    picture_option,
    reading_options,
    records_argument,
    reference_option,
)
from gsid.cli.output import (
    answered,
    command_line,
    describe,
    draw,
    print_message,
    print_table,
    suggest,
    working,
)

if TYPE_CHECKING:
    from gsid.records.record import Record
    from gsid.structure.start import Start


@click.command(short_help="Find the linear structure of an axis from its records.")
@records_argument
@reading_options
@reference_option
@band_option("Lines from LO to HI [Hz] only.")
@output_is_option
@inertia_option
@found_model_option
@picture_option
@json_option
def start(
    *,
    records: Sequence[str],
    read: Callable[[Sequence[str]], list[Record]],
    reference: str | None,
    band: tuple[float, float] | None,
    y_is: str | None,
    inertia_kg_m2: float | None,
    path: str | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Find the linear structure of an axis: rigid body, damping, spring, modes, lags and delay.

    No starting values are needed. The model is fitted to the best linear approximation of the axis, weighted
    with its total variance: noise and nonlinear distortion. One record is enough; two or more realisations
    with random phases measure the distortion.

    What the data do not decide is printed as ambiguous. If no stack of effects represents the data, the
    rational model is written instead.
    """
    from gsid.structure.start import start as find_structure

    measured = read(records)
    with working(f"fitting structures to {describe(measured)}"), options_as_arguments():
        found = find_structure(measured, output=y_is, band=band, reference=reference)
    found.inertia_kg_m2 = inertia_kg_m2
    if path:
        found.save(path)
        print_message(f"wrote {path}" if found.has_model else f"wrote {path}, the rational model")
    draw(found.plot, picture)
    if answered(as_json, found.to_dict):
        return
    _print(found)
    if path and found.has_model and reference is None:
        suggest(
            f"`{command_line('diagnose', '--model', path, records=records)}` searches for a missing effect"
        )


def _print(found: Start) -> None:
    print(found.summary())
    if found.effects:
        print()
        print_table(found.table())
    print()
    for text in found.notes():
        print(text)
