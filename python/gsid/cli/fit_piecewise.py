"""gsid fit --piecewise: a model of low order in each of several adjoining bands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.fit_rational import model_as_json
from gsid.cli.options import options_as_arguments
from gsid.cli.output import answered, describe, draw, note_assumed_hold, print_message, print_table, working

if TYPE_CHECKING:
    from gsid.cli.fit_request import FitRequest
    from gsid.models.piecewise import PiecewiseModel
    from gsid.records.record import Record

JSON_KEYS = ("breaks_hz", "cost", "cost_expected", "stable", "converged", "n_lines", "n_parameters")


def fit_pieces(records: Sequence[Record], request: FitRequest) -> None:
    """Fit the pieces, and write and print them."""
    from gsid.fitting.piecewise import fit_piecewise
    from gsid.response.with_distortion import frf_with_distortion

    if request.order == "auto" or request.method != "ml" or request.held_out:
        raise click.UsageError(
            "--piecewise needs a given order and method ml, and no --held-out", click.get_current_context()
        )
    measured = frf_with_distortion(records, reference=request.reference)
    n_pieces = None if request.piecewise == "auto" else request.piecewise
    with working(f"fitting pieces of {request.order} to {describe(records)}"), options_as_arguments():
        found = fit_piecewise(measured, request.order, n_pieces, **request.model_options)
    note_assumed_hold(found.pieces[0].hold_assumed, found.pieces[0].hold)
    if request.output:
        found.save(request.output)
        print_message(f"wrote {request.output}")
    draw(lambda: found.plot(measured), request.picture)
    if not answered(request.as_json, lambda: _as_json(found)):
        _print(found, request)


def _as_json(found: PiecewiseModel) -> dict:
    return {name: getattr(found, name) for name in JSON_KEYS} | {
        "pieces": [model_as_json(piece) for piece in found.pieces],
        "jumps": [vars(jump) for jump in found.jumps()],
        "tried": [vars(cut) for cut in found.tried],
    }


def _print(found: PiecewiseModel, request: FitRequest) -> None:
    total = found.pieces[0].weights == "total"
    cause = "noise and distortion" if total else "noise alone"
    if request.piecewise == "auto":
        rows = [
            [f"{c.n_pieces}", f"{c.cost:.5g}", f"{c.cost_expected:.5g}", f"{c.mdl:.5g}"] for c in found.tried
        ]
        print_table(Table(["pieces", "cost", "expected" if total else cause, "MDL"], rows))
        print()
    state = "converged" if found.converged else "not converged"
    n = len(found.pieces)
    print(f"{n} piece{'s' * (n != 1)} of {request.order}, {found.n_parameters} parameters, {state}")
    print(f"cost {found.cost:.5g}, expected of {cause} {found.cost_expected:.5g}")
    print()
    print_table(found.table())
