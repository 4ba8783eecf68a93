"""gsid fit with several inputs or outputs: a matrix of transfer functions with common poles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.fit_order import choose_order, orders_as_json, print_orders
from gsid.cli.options import options_as_arguments
from gsid.cli.output import answered, describe, draw, note_assumed_hold, print_message, print_table, working

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from gsid.cli.fit_request import FitRequest
    from gsid.models.mimo import MimoModel
    from gsid.records.mimo import MimoRecord


def fit_matrix(records: Sequence[MimoRecord], request: FitRequest) -> None:
    """Fit one model with common poles to the experiments, and write and print it."""
    from gsid.fitting.mimo import fit_mimo
    from gsid.fitting.validation import nrmse
    from gsid.response.mimo import frf_mimo

    _check_options(request)
    held_out = request.read_held_out(records, matrix=True)
    with options_as_arguments():
        measured = frf_mimo(records, band=request.band)
    print_message(f"note: intervals are those of the scatter over {measured.source}")
    name, order, choice = describe(records), request.order, None
    options = {"delay": request.delay, "domain": request.domain}
    options |= {"allow_unstable": True} if request.allow_unstable else {}
    if order == "auto":
        choice = choose_order(measured, name, **options)
        order = choice.chosen.order
    with working(f"fitting {order} to {name}"), options_as_arguments():
        model = fit_mimo(measured, order, method=request.method, **options)
    note_assumed_hold(model.hold_assumed, model.hold)
    note_ill_determined(model)
    judged = {"fitted": records, "held_out": held_out}
    errors = {key: nrmse(model, each, band=request.band) for key, each in judged.items() if each}
    if request.output:
        model.save(request.output)
        print_message(f"wrote {request.output}")
    draw(lambda: model.plot(measured), request.picture)
    masked = {"n_masked": measured.n_masked, "masked_hz": measured.masked_hz}
    more = orders_as_json(choice) | {"nrmse": errors} | masked
    if not answered(request.as_json, lambda: _as_json(model) | more):
        print_orders(choice)
        _print(model)
        _print_errors(model, errors, request.band)


def _check_options(request: FitRequest) -> None:
    context = click.get_current_context()
    if request.reference is not None or request.piecewise is not None:
        raise click.UsageError("--r and --piecewise are for one input and one output", context)
    if request.output and request.output.lower().endswith(".mat"):
        raise click.UsageError("a matrix of responses is written as .json", context)


# fmt: off
JSON_KEYS = (
    "method", "inputs", "outputs", "sections", "num", "delay_s", "delay_range_s", "cost", "cost_expected",
    "poles", "converged", "stable", "domain", "hold", "hold_assumed", "delay_hold_uncertainty_s",
    "fs_hz", "n_lines", "n_poles", "n_zeros",
    "n_parameters", "band_hz", "u_units", "y_units",
)
# fmt: on


def _as_json(model: MimoModel) -> dict:
    std = {"sections": model.std_sections, "num": model.std_num, "delay_s": model.std_delay_s}
    names = ("f_hz", "damping", "std_f_hz", "std_damping")
    modes = [dict(zip(names, mode, strict=True)) for mode in model.modes]
    return {name: getattr(model, name) for name in JSON_KEYS} | {"std": std, "modes": modes}


def note_ill_determined(model: MimoModel) -> None:
    import numpy as np

    if not model.ill_determined_delays.any():
        return
    _, first = np.unique(model.delay_of, return_index=True)
    for i, j in zip(*np.unravel_index(first, model.delay_of.shape), strict=True):
        if not model.ill_determined_delays[i, j]:
            continue
        low, high = 1e3 * model.delay_range_s[i, j]
        which, hint = "common delay", "give it"
        if len(first) > 1:
            which = f"delay from {model.inputs[j]} to {model.outputs[i]}"
            hint += ", or use --delay common if the delays are equal"
        print_message(
            f"note: the {which} is ill-determined: {low:.4g} ms and {high:.4g} ms fit equally well; {hint}"
        )


def _delay_cell(model: MimoModel, i: int, j: int) -> str:
    if model.ill_determined_delays[i, j]:
        low, high = 1e3 * model.delay_interval_s[i, j]
        return f"{low:.3g} .. {high:.3g}"
    std = model.std_delay_s[i, j]
    return f"{1e3 * model.delay_s[i, j]:.5g}" + (f" +- {1e3 * std:.2g}" if std > 0 else "")


def _print(model: MimoModel) -> None:
    from gsid.models.confidence import NORMAL_95

    converged = "converged" if model.converged else "not converged"
    stable = "stable" if model.stable else "NOT STABLE"
    print(
        f"{model.method} fit, {model.n_y} x {model.n_u} responses, {model.n_poles} common poles, "
        f"{model.n_parameters} parameters, {model.n_lines} lines, {converged}, {stable}"
    )
    if model.hold == "zoh":
        print("inputs held over each sample; the model does not include the hold")
    expected = "" if model.cost_expected is None else f", expected of noise alone {model.cost_expected:.5g}"
    print(f"cost {model.cost:.5g}{expected}")
    print()
    rows = [
        [f"{f:.5g}", f"+-{NORMAL_95 * std_f:.2g}", f"{damping:.4g}", f"+-{NORMAL_95 * std_damping:.2g}"]
        for f, damping, std_f, std_damping in model.modes
    ]
    print_table(Table(["f [Hz]", "95 %", "damping", "95 % "], rows))
    print()
    rows = []
    for i, name in enumerate(model.outputs):
        rows.append([name, *(_delay_cell(model, i, j) for j in range(model.n_u))])
    print_table(Table(["delay [ms], sigma", *model.inputs], rows, left=["delay [ms], sigma"]))


def _print_errors(model: MimoModel, errors: dict[str, np.ndarray], band: tuple[float, float] | None) -> None:
    """Error of each output on the fitted and the held-out records."""
    print()
    rows = [
        [name, *(f"{100 * values[i]:.3g}" for values in errors.values())]
        for i, name in enumerate(model.outputs)
    ]
    where = "" if band is None else f", {band[0]:g} .. {band[1]:g} Hz"
    header = [f"error of the output's rms [%]{where}", *(name.replace("_", " ") for name in errors)]
    print_table(Table(header, rows, left=header[:1]))
