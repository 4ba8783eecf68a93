"""gsid export-c"""

from __future__ import annotations

from pathlib import Path

import click

from gsid.cli.files_in_use import FILE_OUTPUT, INPUT, FilesInUse
from gsid.cli.options import json_option, options_as_arguments, rate_option
from gsid.cli.output import answered, note_assumed_hold, print_message


@click.command("export-c", short_help="Write a model as C for firmware.")
@click.argument("model_path", metavar="MODEL.json", type=INPUT)
@rate_option("the model's")
@click.option("-o", "--output", metavar="NAME.c", type=FILE_OUTPUT,
              help="Source to write, with NAME.h beside it. [default: MODEL.c]")  # fmt: skip
@json_option
@click.pass_context
def export_c(
    ctx: click.Context, model_path: str, fs_hz: float | None, output: str | None, as_json: bool
) -> None:
    """Write a fitted transfer function or a stack of effects as C99, in single precision.

    NAME_step takes the command of one sample and returns the output. Call it at the rate --fs. It leaves out
    friction and other nonlinear torques of a plant. NAME_feedforward returns the command that compensates
    them.
    """
    from gsid.base.files import write_atomically
    from gsid.models.export_c import export_c as export
    from gsid.models.hold import facts_of
    from gsid.models.load import load_single

    source = Path(output) if output else Path(model_path).with_suffix(".c")
    header = source.with_suffix(".h")
    if header == source:
        raise click.UsageError("-o names the C file, NAME.c; NAME.h is written beside it", ctx)
    FilesInUse.of(ctx).write(*((header,) if output else (header, source)))
    with options_as_arguments():
        model = load_single(model_path)
        made = export(model, source.stem, fs_hz=fs_hz, where=model_path)
    facts = facts_of(model)
    note_assumed_hold(facts["hold_assumed"], facts["hold"], facts["other_delay_s"])
    for path, text in ((header, made.header), (source, made.source)):
        write_atomically(path, lambda part, text=text: part.write_text(text, encoding="utf-8"))
        print_message(f"wrote {path}")
    answered(
        as_json,
        lambda: (
            {
                "files": [str(header), str(source)],
                "fs_hz": made.fs_hz,
                "n_states": made.n_states,
                "delay_samples": made.delay_samples,
                "feedforward": made.feedforward,
            }
            | facts
        ),
    )
