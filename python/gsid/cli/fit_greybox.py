"""gsid fit --model: the free parameters of a stack of effects, by simulation."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from gsid.cli.options import is_given, options_as_arguments
from gsid.cli.output import (
    answered,
    describe,
    draw,
    note_assumed_hold,
    print_message,
    print_parameters,
    working,
)

if TYPE_CHECKING:
    from gsid.cli.fit_request import FitRequest
    from gsid.greybox.fit import PlantFit

METHODS = ("ml", "nls-output")
OF_RATIONAL_MODELS = {
    "delay": "--delay",
    "domain": "--domain",
    "piecewise": "--piecewise",
    "held_out": "--held-out",
}


def fit_stack(request: FitRequest) -> None:
    """Fit the stack of effects of a model file, and write and print the result."""
    from gsid.greybox.better_start import fit_from_better_start
    from gsid.models.load import load_plant
    from gsid.spectrum.realisation import spectra

    _check_options(request)
    start = load_plant(str(request.model_path))
    if request.inertia_kg_m2 is not None:
        start = replace(start, inertia_kg_m2=request.inertia_kg_m2)
    records = request.read(request.records)
    with (
        working(f"fitting {len(start.free_names)} parameters to {describe(records)}"),
        options_as_arguments(),
    ):
        if request.reference is not None:
            from gsid.diagnosis.closed_loop import in_closed_loop

            start, measured = in_closed_loop(start, records, request.reference)
        else:
            measured = [spectra(record) for record in records]
        found = fit_from_better_start(start, measured, band=request.band, method=request.method)
    if request.output:
        found.model.save(request.output)
        print_message(f"wrote {request.output}")
    note_assumed_hold(found.hold_assumed, found.hold, found.other_delay_s)
    draw(found.plot, request.picture)
    if not answered(request.as_json, lambda: found.summary() | {"effects": found.model.to_dict()["effects"]}):
        _print(found)


def _check_options(request: FitRequest) -> None:
    context = click.get_current_context()
    if request.method not in METHODS:
        raise click.UsageError(f"methods of a stack of effects are {' and '.join(METHODS)}", context)
    for name, option in OF_RATIONAL_MODELS.items():
        if is_given(context, name):
            raise click.UsageError(f"{option} belongs to a rational model: leave it out", context)


def _print(found: PlantFit) -> None:
    from gsid.greybox.fit import COST_MEANS

    n_free, state = len(found.model.free_names), "converged" if found.converged else "NOT converged"
    print(f"{n_free} parameters, {found.n_dof} degrees of freedom, {state}")
    print(f"cost per degree of freedom {found.cost_per_dof:.4g} ({COST_MEANS[found.method]})")
    for words, names in (("at a bound", found.at_bound), ("no steady state found", found.unsettled)):
        if names:
            print(f"{words}: {', '.join(names)}")
    print()
    print_parameters(found.model, found.cost_per_dof if found.method == "ml" else 1.0)
