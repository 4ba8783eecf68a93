"""gsid predict"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsid.cli.files_in_use import INPUT
from gsid.cli.options import (
    json_option,
    options_as_arguments,
    picture_option,
    record_options,
    reference_option,
)
from gsid.cli.output import answered, draw, note_assumed_hold, print_table, working

if TYPE_CHECKING:
    from gsid.records.record import Record


@click.command(short_help="Show a model's output beside the measured output.")
@record_options
@reference_option
@click.option(
    "--model",
    "model_path",
    metavar="M.json",
    type=INPUT,
    required=True,
    help="Model to simulate: a fitted transfer function or a stack of effects.",
)
@picture_option
@json_option
def predict(
    *,
    records: list[Record],
    reference: str | None,
    model_path: str,
    picture: str | None,
    as_json: bool,
) -> None:
    """Simulate a model with the input of each record and compare its steady-state output over time.

    FIT is 100 % (1 - rms of the error / rms of the output without its mean). The noise of the record bounds
    it; this bound is printed beside it. The simulated output is given the mean of the measured one, except in
    a position loop. `gsid compare` tests whether the error is more than noise.
    """
    from gsid.models.load import load_single
    from gsid.prediction import predict as predict_output
    from gsid.prediction import table_of

    model, measured = load_single(model_path), records
    with working("simulating"), options_as_arguments():
        if reference is not None:
            from gsid.diagnosis.closed_loop import in_closed_loop

            model, measured = in_closed_loop(model, records, reference)
        predicted = predict_output(model, measured)
    for hold in {one.hold for one in predicted if one.hold_assumed}:  # one for all records
        note_assumed_hold(True, hold)
    draw(lambda: _figure(predicted), picture)
    if answered(as_json, lambda: {"records": [one.to_dict() for one in predicted]}):
        return
    print_table(table_of(predicted))


def _figure(predicted: list) -> object:
    from gsid.plots import predicted_output

    return predicted_output(predicted)
