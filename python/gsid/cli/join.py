"""gsid join"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.files_in_use import OUTPUT
from gsid.cli.frf import write
from gsid.cli.options import (
    alpha_option,
    json_option,
    options_as_arguments,
    picture_option,
    reading_options,
    records_argument,
)
from gsid.cli.output import answered, draw, print_message, print_table

if TYPE_CHECKING:
    from gsid.records.record import Record
    from gsid.response.frf import Frf
    from gsid.response.join import Joined


@click.command(short_help="Join bands measured apart to one response.")
@records_argument
@reading_options
@alpha_option(0.05)
@click.option(
    "-o", "--output", metavar="FILE", type=OUTPUT, help="Write .csv, .npz or .mat instead of a table."
)
@picture_option
@json_option
def join(
    *,
    records: Sequence[str],
    read: Callable[[Sequence[str]], list[Record]],
    alpha: float,
    output: str | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Join responses of different bands to one, for example of a stepped sine and of a multisine.

    Each REC is a record, or a response that `gsid frf -o FILE.csv` wrote, for example from several
    realisations. Common lines are averaged with weights inverse to their variances. A test compares their
    difference with the noise. If they differ, the ratios of level and travel are reported, and the standard
    deviations of the common lines are increased accordingly.

    `gsid fit --order 4/3 FILE.csv` fits the joined response.
    """
    from gsid.response.join import join as join_responses

    with options_as_arguments():
        found = join_responses([_response(path, read) for path in records], alpha=alpha)
    for overlap in found.overlaps:
        print_message(overlap.sentence if overlap.agree else f"warning: {overlap.sentence}")
    if output:
        write(output, found.response)
    draw(found.plot, picture)
    if not answered(as_json, lambda: _values(found)) and not output:
        _print(found)


def _response(path: str, read: Callable[[Sequence[str]], list[Record]]) -> Frf:
    from gsid.response.files import is_response, read_response
    from gsid.response.with_distortion import frf_with_distortion

    return read_response(path) if is_response(path) else frf_with_distortion(read([path]))


def _values(found: Joined) -> dict:
    from gsid.response.files import columns_of, keys_of

    overlaps = [
        {
            "names": one.names,
            "f_hz": one.f_hz,
            "difference_re": one.difference.real,
            "difference_im": one.difference.imag,
            "sigma": one.sigma,
            "p_value": one.p_value,
            "agree": one.agree,
            "scale": one.scale,
            "relative": one.relative,
            "where_hz": one.where_hz,
            "level_ratio": one.level_ratio,
            "travel_ratio": one.travel_ratio,
            "sentence": one.sentence,
        }
        for one in found.overlaps
    ]
    response = columns_of(found.response) | keys_of(found.response)
    return response | {"agree": found.agree, "overlaps": overlaps, "sentence": found.sentence}


def _print(found: Joined) -> None:
    import numpy as np

    response = found.response
    sources = [
        ", ".join(str(i) for i, part in enumerate(found.parts, 1) if np.min(np.abs(part.f_hz / f - 1)) < 1e-6)
        for f in response.f_hz
    ]
    with np.errstate(divide="ignore"):
        gain, sigma = 20 * np.log10(np.abs(response.g)), 10 * np.log10(response.var_g)
    phase = np.degrees(np.angle(response.g))
    rows = [
        [f"{f:.4f}", f"{g:.3f}", f"{p:.2f}", f"{s:.2f}", source]
        for f, g, p, s, source in zip(response.f_hz, gain, phase, sigma, sources, strict=True)
    ]
    head = ["f [Hz]", "|G| [dB]", "phase [deg]", "sigma [dB]", "measured in"]
    print_table(Table(head, rows, left=["measured in"]))
