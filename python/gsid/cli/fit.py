"""gsid fit: each kind of fit is a file of its own, fit_KIND.py."""

from __future__ import annotations

from typing import Any

import click

from gsid.cli.fit_estimators import fit_by_all_methods
from gsid.cli.fit_greybox import fit_stack
from gsid.cli.fit_matrix import fit_matrix
from gsid.cli.fit_piecewise import fit_pieces
from gsid.cli.fit_rational import fit_transfer_function, given_response
from gsid.cli.fit_request import FitRequest, fit_options
from gsid.cli.options import json_option, picture_option, reading_options, records_argument, reference_option


@click.command(short_help="Fit a rational model, or a stack of effects, to records.")
@records_argument
@reading_options
@reference_option
@fit_options
@picture_option
@json_option
@click.pass_context
def fit(ctx: click.Context, **values: Any) -> None:
    """Fit a rational transfer function with delay to the measured frequency response.

    The cost is the sum of squared errors over their variance. The expected cost is that of noise alone.
    Intervals are 95 %, from the covariance of the parameters.

    REC may be one response that `gsid frf` or `gsid join` wrote as CSV.

    With --piecewise the band is split where models of a low order follow the response best. The models may
    differ at the breaks.

    With several inputs or outputs (--u u1,u2 --y y1,y2,y3) each file is one experiment. At least as many
    experiments as inputs are needed. All responses share their poles, and have as many zeros or one fewer.
    Methods are iwls, nls and ml. --delay free fits one delay per response. --order auto chooses the number of
    common poles of least MDL.

    With --model the free parameters of a stack of effects are fitted by simulation. The fit starts from the
    values in the file. Method ml weights each line by its noise. Method nls-output minimises the rms error of
    the output; use it for a model that is not adequate. With --r the stack is simulated with the reference as
    its input. If it has no controller, the one that reference, output and command show is put around it and
    stays in the model.
    """
    from gsid.records.record import Record
    from gsid.response.frf import Frf

    request = FitRequest(**values)
    if (request.order is None) == (request.model_path is None):
        raise click.UsageError("give --order for a rational model, or --model for a stack of effects", ctx)
    if request.model_path is not None:
        fit_stack(request)
        return
    if request.inertia_kg_m2 is not None:
        raise click.UsageError("--inertia is for a stack of effects: give --model, or leave it out", ctx)
    records = given_response(request) or request.read(request.records, matrix=True)
    if isinstance(records[0], Frf):
        fit_transfer_function(records, request)
    elif not isinstance(records[0], Record):
        fit_matrix(records, request)
    elif request.delay == "common":
        raise click.UsageError("--delay common is for several inputs or outputs", ctx)
    elif request.piecewise is not None:
        fit_pieces(records, request)
    elif request.method == "all":
        fit_by_all_methods(records, request)
    else:
        fit_transfer_function(records, request)
