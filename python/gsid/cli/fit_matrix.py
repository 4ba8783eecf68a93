"""gsid fit with several inputs or outputs"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsid.cli.fit_order import choose_order, orders_as_json, print_orders
from gsid.cli.options import options_as_arguments
from gsid.cli.output import describe, draw, print_json, print_table, say, say_assumed_hold, working

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from gsid.models.mimo import MimoModel
    from gsid.records.mimo import MimoRecord


def fit_matrix(
    records: Sequence[MimoRecord],
    held_out: Sequence[MimoRecord],
    output: str | None,
    picture: str | None,
    as_json: bool,
    *,
    order: str,
    method: str,
    band: tuple[float, float] | None,
    **options: object,
) -> None:
    """Fit one model with common poles to the experiments, and print it."""
    from gsid.fitting.mimo import fit_mimo
    from gsid.fitting.validation import nrmse
    from gsid.response.mimo import frf_mimo

    if output and output.lower().endswith(".mat"):
        raise click.UsageError("a matrix of responses is written as .json", click.get_current_context())
    with options_as_arguments():
        measured = frf_mimo(records, band=band)
    say(f"note: intervals are those of the scatter over {measured.source}")
    choice = None
    if order == "auto":
        choice = choose_order(measured, describe(records), **options)
        order = choice.chosen.order
    with working(f"fitting {order} to {describe(records)}"), options_as_arguments():
        model = fit_mimo(measured, order, method=method, **options)
    say_assumed_hold(model.hold_assumed, model.hold)
    say_what_is_ill_determined(model)
    judged = {"fitted": records, "held_out": held_out}
    errors = {name: nrmse(model, each, band=band) for name, each in judged.items() if each}
    if output:
        model.save(output)
        say(f"wrote {output}")
    draw(lambda: model.plot(measured), picture)
    if as_json:
        print_json(_as_json(model) | orders_as_json(choice) | {"nrmse": errors})
    else:
        print_orders(choice)
        _print(model, errors, band)


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


def say_what_is_ill_determined(model: MimoModel) -> None:
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
        say(f"note: the {which} is ill-determined: {low:.4g} ms and {high:.4g} ms fit equally well; {hint}")


def _delay_cell(model: MimoModel, i: int, j: int) -> str:
    if model.ill_determined_delays[i, j]:
        low, high = 1e3 * model.delay_interval_s[i, j]
        return f"{low:.3g} .. {high:.3g}"
    std = model.std_delay_s[i, j]
    return f"{1e3 * model.delay_s[i, j]:.5g}" + (f" +- {1e3 * std:.2g}" if std > 0 else "")


def _print(model: MimoModel, errors: dict[str, np.ndarray], band: tuple[float, float] | None) -> None:
    from gsid.models.confidence import NORMAL_95

    converged = "converged" if model.converged else "not converged"
    stable = "stable" if model.stable else "NOT STABLE"
    print(
        f"{model.method} fit, {model.n_y} x {model.n_u} responses, {model.n_poles} common poles, "
        f"{model.n_parameters} parameters, {model.n_lines} lines, {converged}, {stable}"
    )
    if model.hold == "zoh":
        print("inputs held over each sample; the model is of what follows")
    expected = "" if model.cost_expected is None else f", expected of noise alone {model.cost_expected:.5g}"
    print(f"cost {model.cost:.5g}{expected}")
    print()
    rows = [
        [f"{f:.5g}", f"+-{NORMAL_95 * std_f:.2g}", f"{damping:.4g}", f"+-{NORMAL_95 * std_damping:.2g}"]
        for f, damping, std_f, std_damping in model.modes
    ]
    print_table(["f [Hz]", "95 %", "damping", "95 % "], rows)
    print()
    rows = []
    for i, name in enumerate(model.outputs):
        rows.append([name, *(_delay_cell(model, i, j) for j in range(model.n_u))])
    print_table(["delay [ms], sigma", *model.inputs], rows, left=["delay [ms], sigma"])
    print()
    rows = [
        [name, *(f"{100 * values[i]:.3g}" for values in errors.values())]
        for i, name in enumerate(model.outputs)
    ]
    where = "" if band is None else f", {band[0]:g} .. {band[1]:g} Hz"
    header = [f"error of the output's rms [%]{where}", *(name.replace("_", " ") for name in errors)]
    print_table(header, rows, left=header[:1])
