"""gsid fit --method all: a table of every estimator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gsid.cli.fit_order import choose_order
from gsid.cli.fit_rational import measure, model_as_json, save_model
from gsid.cli.options import options_as_arguments
from gsid.cli.output import answered, describe, draw, print_message, print_table, working

if TYPE_CHECKING:
    from gsid.cli.fit_request import FitRequest
    from gsid.fitting.estimators import Estimators
    from gsid.records.record import Record


def fit_by_all_methods(records: Sequence[Record], request: FitRequest) -> None:
    """Fit by every method, write the best model, and print the table."""
    from gsid.fitting.estimators import fit_all

    measured, held_out = measure(records, request)
    name, order, allowed = describe(records), request.order, None
    if order == "auto":
        choice = choose_order(measured, name, held_out=held_out, **request.model_options)
        order, allowed = choice.chosen.order, choice.relative_error
    with working(f"fitting {order} to {name} by every estimator"), options_as_arguments():
        found = fit_all(measured, order, held_out=held_out, relative_error=allowed, **request.model_options)
        if request.output:
            best = found.best()
            save_model(best.model, request.output)
            print_message(f"wrote {request.output}, the model of {best.method}")
    draw(lambda: found.plot(measured), request.picture)
    if not answered(request.as_json, lambda: _as_json(found)):
        _print(found)


def _as_json(found: Estimators) -> dict:
    rows = [
        vars(row)
        | {"model": row.model and model_as_json(row.model), "held_out": row.held_out and vars(row.held_out)}
        for row in found.rows
    ]
    keys = ("order", "initial_delay_s", "cost_expected")
    return {key: getattr(found, key) for key in keys} | {"estimators": rows}


def _print(found: Estimators) -> None:
    delay = f"delay by the slope of the phase {1e3 * found.initial_delay_s:.4g} ms"
    print(f"order {found.order}, {found.n_lines} lines, {delay}")
    if found.cost_expected is not None:
        cause = "noise alone" if found["ml"].model.weights == "noise" else "noise and distortion"
        print(f"cost expected of {cause} {found.cost_expected:.5g}")
    print()
    print_table(found.table())
