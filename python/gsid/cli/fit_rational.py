"""gsid fit --order: one transfer function with delay, for one input and one output."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gsid.base.tables import Table
from gsid.cli.fit_order import choose_order, orders_as_json, print_orders
from gsid.cli.options import options_as_arguments
from gsid.cli.output import describe, draw, note_assumed_hold, print_json, print_message, print_table, working

if TYPE_CHECKING:
    import numpy as np

    from gsid.cli.fit_request import FitRequest
    from gsid.fitting.validation import Validation
    from gsid.models.fit_warning import FitWarning
    from gsid.models.rational import RationalModel
    from gsid.records.record import Record
    from gsid.response.frf import Frf


def fit_transfer_function(records: Sequence[Record], request: FitRequest) -> None:
    """Fit, judge on the records held out, and write and print the model."""
    from gsid.fitting.rational import fit
    from gsid.fitting.validation import validate

    measured, held_out = measure(records, request)
    name, order, choice = describe(records), request.order, None
    if order == "auto":
        choice = choose_order(measured, name, held_out=held_out, **request.model_options)
        order = choice.chosen.order
    with working(f"fitting {order} to {name}"), options_as_arguments():
        model = fit(measured, order, method=request.method, **request.model_options)
        judged = validate(model, held_out) if held_out else None
    note_assumed_hold(model.hold_assumed, model.hold, model.other_delay_s)
    _note_ill_determined(model, "" if choice else ": try --order auto")
    if request.output:
        save_model(model, request.output)
        print_message(f"wrote {request.output}")
    draw(lambda: model.plot(measured), request.picture)
    if request.as_json:
        validation = {} if judged is None else {"held_out": vars(judged)}
        print_json(model_as_json(model) | orders_as_json(choice) | validation)
        return
    print_orders(choice)
    _print(model)
    if judged is not None:
        _print_held_out(judged)


def measure(records: Sequence[Record], request: FitRequest) -> tuple[Frf, Frf | None]:
    """Response to fit, and response to judge on if records are held out."""
    from gsid.response.estimate import frf

    held_out = request.read_held_out(records)
    measured = frf(records, reference=request.reference)
    return measured, frf(held_out, reference=request.reference) if held_out else None


def save_model(model: RationalModel, output: str) -> None:
    """Write a model file, or a MATLAB file by its extension."""
    if output.lower().endswith(".mat"):
        from gsid.models.convert import save_mat

        save_mat(model, output)
    else:
        model.save(output)


# fmt: off
JSON_KEYS = (
    "method", "num", "den", "delay_s", "cost", "cost_expected", "poles", "zeros", "converged", "stable",
    "domain", "hold", "hold_assumed", "delay_hold_uncertainty_s", "other_delay_s",
    "fs_hz", "n_lines", "n_parameters", "band_hz", "u_unit", "y_unit",
)
# fmt: on


def model_as_json(model: RationalModel) -> dict:
    """The JSON object of a model."""
    std = {"num": model.std_num, "den": model.std_den, "delay_s": model.std_delay_s}
    warnings = [warning.to_dict() for warning in model.warnings]
    return {name: getattr(model, name) for name in JSON_KEYS} | {"std": std, "warnings": warnings}


def _note_ill_determined(model: RationalModel, advice: str) -> None:
    import numpy as np

    from gsid.fitting.order import far_out, near_cancelled

    trade = "; the delay may trade against {}" if model.free_delay else ""
    f_hz = (
        abs(np.log(pole) * model.fs_hz if model.domain == "z" else pole) / (2 * np.pi)
        for pole, _ in near_cancelled(model)
    )
    for f in dict.fromkeys(f"{f:.4g}" for f in f_hz):  # of a pair once
        print_message(
            f"note: a pole and a zero near {f} Hz cannot be distinguished{trade.format('them')}{advice}"
        )
    for kind, f in far_out(model):
        where = f"the {kind} at {f:.4g} Hz, above the band,"
        print_message(f"note: {where} may be anywhere{trade.format('it')}: try one {kind} fewer")


def _print(model: RationalModel) -> None:
    converged = "converged" if model.converged else "not converged"
    stable = "stable" if model.stable else "NOT STABLE"
    numbers = f"{model.n_parameters} parameters, {model.n_lines} lines"
    print(f"{model.method} fit, {numbers}, {converged}, {stable}")
    print(f"cost {model.cost:.5g}{_expected(model)}")
    print(_delay(model))
    for warning in model.warnings:
        print(_beside_intervals(warning))
    print()
    print_table(Table(["power", "num", "sigma", "den", "sigma "], _coefficients(model)))
    print()
    poles = _roots("pole", model.poles, model.pole_cov, model)
    zeros = _roots("zero", model.zeros, model.zero_cov, model)
    print_table(Table(["", "re", "im", "f [Hz]", "95 %", "damping", "95 % "], [*poles, *zeros], left=[""]))


def _beside_intervals(warning: FitWarning) -> str:
    if warning.bias_over_std is None:
        return f"intervals include noise only: {warning.short}"
    return f"intervals leave out a bias of up to {warning.bias_over_std:.2g} sigma: use {warning.use}"


def _expected(model: RationalModel) -> str:
    """Cost expected of noise alone; known for maximum likelihood with enough periods only."""
    return "" if model.cost_expected is None else f", expected of noise alone {model.cost_expected:.5g}"


def _print_held_out(v: Validation) -> None:
    low, high = v.interval
    print()
    print(f"on data kept out: cost {v.cost:.5g}, 95 % interval for a correct model {low:.0f} to {high:.0f}")
    verdict = "adequate" if v.adequate else "not adequate"
    uncertainty = "with the uncertainty of the model included"
    print(f"the model is {verdict} on these data: p = {v.p_value:.3g}, {uncertainty}")
    print(f"error {v.error_db:.1f} dB relative to the response, of which {v.noise_db:.1f} dB is noise")


def _delay(model: RationalModel) -> str:
    sigma = f" +- {model.std_delay_s * 1e3:.2g} (sigma)" if model.free_delay else " (given)"
    return f"delay {model.delay_s * 1e3:.5g}{sigma} ms = {model.delay_s * model.fs_hz:.4g} samples"


def _coefficients(model: RationalModel) -> list[list[str]]:
    """A row per power: of s down to 0, of z from 0 down."""
    n = max(len(model.num), len(model.den))
    descends_to_zero = model.domain == "s"
    columns = []
    for values in (model.num, model.std_num, model.den, model.std_den):
        texts, blank = [f"{value:.6g}" for value in values], [""] * (n - len(values))
        columns.append(blank + texts if descends_to_zero else texts + blank)
    powers = [f"{model.domain}^{n - 1 - i if descends_to_zero else -i}" for i in range(n)]
    return [list(row) for row in zip(powers, *columns, strict=True)]


def _roots(kind: str, roots: np.ndarray, covariances: np.ndarray, model: RationalModel) -> list[list[str]]:
    """One row per real root or conjugate pair, in the continuous plane's frequency and damping."""
    from gsid.models.confidence import NORMAL_95, root_quantities

    rows = []
    for root, covariance in zip(roots, covariances, strict=True):
        if root.imag < 0:
            continue
        f, damping, std_f, std_damping = root_quantities(
            root, covariance, domain=model.domain, fs_hz=model.fs_hz
        )
        imaginary = f"+-{root.imag:.5g}" if root.imag else "0"
        numbers = [f"{root.real:.5g}", imaginary, f"{f:.5g}", f"+-{NORMAL_95 * std_f:.2g}"]
        dampings = [f"{damping:.4g}", f"+-{NORMAL_95 * std_damping:.2g}"] if root.imag else ["", ""]
        rows.append([kind, *numbers, *dampings])
    return rows
