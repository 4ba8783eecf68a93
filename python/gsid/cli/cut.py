"""gsid cut"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsid.cli.files_in_use import OUTPUT
from gsid.cli.options import json_option, options_as_arguments, record_options, scale_option
from gsid.cli.output import answered, print_message

if TYPE_CHECKING:
    from gsid.records.record import Record


@click.command(short_help="Keep a part of a record.")
@record_options
@click.option("--from", "from_s", metavar="S", type=float, default=0.0, show_default=True,
              help="Time of the first sample [s].")  # fmt: skip
@click.option("--to", "to_s", metavar="S", type=float,
              help="Time of the first sample that is left out [s]. [default: the end]")  # fmt: skip
@scale_option
@click.option("-o", "--output", metavar="FILE", type=OUTPUT, required=True,
              help="Record to write: .csv, .npz, .mat or .h5.")  # fmt: skip
@json_option
def cut(
    *,
    records: list[Record],
    from_s: float,
    to_s: float | None,
    scale: tuple[float, str] | None,
    output: str,
    as_json: bool,
) -> None:
    """Write a part of one record as a record.

    Times are from the begin of the record. Units, hold and rate stay; a stated period stays if the part has
    more than one. Settling is found anew. --scale writes the command in another unit.
    """
    from gsid.base.files import is_stdout
    from gsid.records.files import write_record
    from gsid.records.part import cut as part_of
    from gsid.records.part import in_unit

    if len(records) != 1:
        raise click.UsageError("give one record", click.get_current_context())
    with options_as_arguments():
        part = part_of(records[0], from_s, to_s)
        part = in_unit(part, *scale) if scale else part
    write_record(output, part)
    if not is_stdout(output):
        print_message(f"wrote {output}: {len(part)} samples, {len(part) / part.fs_hz:.6g} s")
        facts = {"record": output, "samples": len(part), "time_s": len(part) / part.fs_hz}
        answered(as_json, lambda: facts)
