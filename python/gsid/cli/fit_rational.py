"""gsid fit --order: one transfer function with delay, for one input and one output."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.fit_order import choose_order, orders_as_json, print_orders
from gsid.cli.options import options_as_arguments
from gsid.cli.output import answered, describe, draw, note_assumed_hold, print_message, print_table, working

if TYPE_CHECKING:
    from gsid.cli.fit_request import FitRequest
    from gsid.fitting.roots import Doubtful
    from gsid.fitting.validation import Validation
    from gsid.models.fit_warning import FitWarning
    from gsid.models.rational import RationalModel
    from gsid.records.record import Record
    from gsid.response.frf import Frf


def given_response(request: FitRequest) -> list[Frf]:
    """The response that the request names instead of records, alone; empty if it names records.

    Raises
    ------
    UsageError
        Options or other files do not go with a response.
    """
    from gsid.response.files import is_response, read_response

    if not any(map(is_response, request.records)):
        return []
    context = click.get_current_context()
    if len(request.records) > 1:
        raise click.UsageError("a response is fitted alone: `gsid join` makes one of several", context)
    if request.piecewise is not None or request.method == "all" or request.held_out or request.reference:
        raise click.UsageError(
            "--piecewise, --method all, --held-out and --r need records, not a response", context
        )
    return [read_response(request.records[0])]


def fit_transfer_function(records: Sequence[Record] | Sequence[Frf], request: FitRequest) -> None:
    """Fit, judge on the records held out, and write and print the model."""
    from gsid.fitting.rational import fit
    from gsid.fitting.validation import validate

    measured, held_out = measure(records, request)
    name, order, choice = describe(records), request.order, None
    if order == "auto":
        choice = choose_order(measured, name, held_out=held_out, **request.model_options)
        order = choice.chosen.order
    with working(f"fitting {order} to {name}"), options_as_arguments():
        allowed = choice.relative_error if choice else None
        model = fit(measured, order, method=request.method, relative_error=allowed, **request.model_options)
        judged = validate(model, held_out) if held_out else None
    note_assumed_hold(model.hold_assumed, model.hold, model.other_delay_s)
    _note_allowed(measured, model, allowed)
    doubts = _doubts(model, measured)
    _note_doubts(doubts, model, "" if choice else ": try --order auto")
    if request.output:
        save_model(model, request.output)
        print_message(f"wrote {request.output}")
    draw(lambda: model.plot(measured), request.picture)
    validation = {} if judged is None else {"held_out": vars(judged)}
    more = {"doubtful": [vars(each) for each in doubts]} | orders_as_json(choice) | validation
    if answered(request.as_json, lambda: model_as_json(model) | more):
        return
    print_orders(choice)
    _print(model)
    if judged is not None:
        _print_held_out(judged)


def measure(records: Sequence[Record] | Sequence[Frf], request: FitRequest) -> tuple[Frf, Frf | None]:
    """Response to fit, and response to judge on if records are held out."""
    from gsid.response.estimate import frf
    from gsid.response.frf import Frf
    from gsid.response.with_distortion import frf_with_distortion

    if isinstance(records[0], Frf):
        return records[0], None
    held_out = request.read_held_out(records)
    measured = frf_with_distortion(records, reference=request.reference)
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
    "fs_hz", "n_lines", "n_parameters", "band_hz", "weights", "u_unit", "y_unit",
)
# fmt: on


def model_as_json(model: RationalModel) -> dict:
    """The JSON object of a model."""
    std = _std(model)
    noise_only = None if model.cov_noise is None else _std(model.noise_only())
    warnings = [warning.to_dict() for warning in model.warnings]
    facts = {name: getattr(model, name) for name in JSON_KEYS}
    return facts | {"std": std, "std_noise_only": noise_only, "warnings": warnings}


def _std(model: RationalModel) -> dict:
    return {"num": model.std_num, "den": model.std_den, "delay_s": model.std_delay_s}


def _note_allowed(measured: Frf, model: RationalModel, allowed: float | None) -> None:
    """Note the error that the linear model was allowed, and an excitation that hides its distortion."""
    if allowed:
        print_message(
            f"note: the weights allow the linear model an error of {100 * allowed:.2g} % of the response"
        )
    if measured.smooth_phases and model.weights == "total":
        print_message(
            "note: one realisation with smooth phases hides its distortion: the intervals do not include it; "
            "record a second realisation with random phases"
        )


def _doubts(model: RationalModel, measured: Frf) -> list[Doubtful]:
    from gsid.base.bands import in_band
    from gsid.fitting.roots import doubtful

    exceeds = any(warning.what == "excess_cost" for warning in model.warnings)
    f_hz = measured.f_hz[in_band(measured.f_hz, model.band_hz)]
    return doubtful(model, f_hz, small_pairs=exceeds)


def _note_doubts(doubts: list[Doubtful], model: RationalModel, advice: str) -> None:
    trade = "; the delay may trade against {}" if model.free_delay else ""
    noted = set()
    for each in doubts:
        f, where = f"{each.f_hz:.4g} Hz", f"the {each.kind} at {each.f_hz:.4g} Hz"
        text = {
            "indistinct": f"a pole and a zero near {f} cannot be distinguished{trade.format('them')}{advice}",
            "cancels": f"a pole and a zero near {f} nearly cancel, and distortion may cause them{advice}",
            "undetermined": f"{where}, above the band, may be anywhere{trade.format('it')}: "
            f"try one {each.kind} fewer",
            "far": f"{where} is far above the band{trade.format('it')}: try one {each.kind} fewer",
            "unresolved": f"the resonance at {f} is narrower than the lines resolve: its damping is not "
            f"determined{advice}",
            "negative": f"the delay of {1e3 * each.f_hz:.4g} ms is negative: the order is too low or too "
            f"high{advice}",
        }[each.why]
        if text not in noted:  # of a pair once
            noted.add(text)
            print_message(f"note: {text}")


def _print(model: RationalModel) -> None:
    converged = "converged" if model.converged else "not converged"
    stable = "stable" if model.stable else "NOT STABLE"
    numbers = f"{model.n_parameters} parameters, {model.n_lines} lines"
    print(f"{model.method} fit, {numbers}, {converged}, {stable}")
    print(f"cost {model.cost:.5g}{_expected(model)}")
    print(_delay(model))
    for warning in model.warnings:
        print(_beside_intervals(warning, model))
    print()
    head = ["power", "num", "sigma", "noise only", "den", "sigma ", "noise only "]
    print_table(Table(head, _coefficients(model)).without_empty(head[3::3]))
    print()
    head = ["", "re", "im", "f [Hz]", "95 %", "noise only", "damping", "95 % ", "noise only "]
    rows = [*_roots("pole", model), *_roots("zero", model)]
    print_table(Table(head, rows, left=[""]).without_empty(["noise only", "noise only "]))


def _beside_intervals(warning: FitWarning, model: RationalModel) -> str:
    if warning.bias_over_std is None and model.cov_noise is not None:
        return f"intervals include the errors left, beside those of noise only: {warning.short}"
    if warning.bias_over_std is None:
        return f"intervals include noise only: {warning.short}"
    return f"intervals leave out a bias of up to {warning.bias_over_std:.2g} sigma: use {warning.use}"


def _expected(model: RationalModel) -> str:
    """Cost expected of a correct model; known for maximum likelihood with enough periods only."""
    if model.cost_expected is None:
        return ""
    cause = "noise alone" if model.weights == "noise" else "noise and distortion"
    return f", expected of {cause} {model.cost_expected:.5g}"


def _print_held_out(v: Validation) -> None:
    low, high = v.interval
    print()
    print(f"on data kept out: cost {v.cost:.5g}, 95 % interval for a correct model {low:.0f} to {high:.0f}")
    verdict = "adequate" if v.adequate else "not adequate"
    uncertainty = "with the uncertainty of the model included"
    print(f"the model is {verdict} on these data: p = {v.p_value:.3g}, {uncertainty}")
    print(f"error {v.error_db:.1f} dB relative to the response, of which {v.noise_db:.1f} dB is noise")


def _delay(model: RationalModel) -> str:
    sigma = " (given)"
    if model.free_delay:
        sigma = f" +- {_sigma(1e3 * model.std_delay_s)} (sigma)"
        if model.cov_noise is not None:
            sigma += f", noise only +- {_sigma(1e3 * model.noise_only().std_delay_s)},"
    return f"delay {model.delay_s * 1e3:.5g}{sigma} ms = {model.delay_s * model.fs_hz:.4g} samples"


def _sigma(std: float, digits: int = 2) -> str:
    return "undetermined" if std == float("inf") else f"{std:.{digits}g}"


def _coefficients(model: RationalModel) -> list[list[str]]:
    """A row per power: of s down to 0, of z from 0 down."""
    n = max(len(model.num), len(model.den))
    descends_to_zero = model.domain == "s"
    has_both, noise = model.cov_noise is not None, model.noise_only()
    columns = []
    for name in ("num", "den"):
        stds = [_sigma(std, 6) for std in getattr(model, f"std_{name}")]
        others = [_sigma(std, 6) if has_both else "" for std in getattr(noise, f"std_{name}")]
        for texts in ([f"{value:.6g}" for value in getattr(model, name)], stds, others):
            blank = [""] * (n - len(texts))
            columns.append(blank + texts if descends_to_zero else texts + blank)
    powers = [f"{model.domain}^{n - 1 - i if descends_to_zero else -i}" for i in range(n)]
    return [list(row) for row in zip(powers, *columns, strict=True)]


def _roots(kind: str, model: RationalModel) -> list[list[str]]:
    """One row per real root or conjugate pair, in the continuous plane's frequency and damping."""
    from gsid.fitting.roots import far_out
    from gsid.models.confidence import NORMAL_95, root_quantities

    roots, noise = getattr(model, f"{kind}s"), model.noise_only()
    anywhere = {f for each, f in far_out(model) if each == kind}
    covariances = [getattr(each, f"{kind}_cov") for each in (model, noise)]
    rows = []
    for root, *both in zip(roots, *covariances, strict=True):
        if root.imag < 0:
            continue
        (f, damping, *stds), (_, _, *others) = (
            root_quantities(root, cov, domain=model.domain, fs_hz=model.fs_hz) for cov in both
        )
        intervals = [
            "undetermined" if f in anywhere or std == 0 else f"+-{NORMAL_95 * std:.2g}"
            for std in (*stds, *others)
        ]
        if model.cov_noise is None:
            intervals[2:] = ["", ""]
        imaginary = f"+-{root.imag:.5g}" if root.imag else "0"
        numbers = [f"{root.real:.5g}", imaginary, f"{f:.5g}", intervals[0], intervals[2]]
        dampings = [f"{damping:.4g}", intervals[1], intervals[3]] if root.imag else ["", "", ""]
        rows.append([kind, *numbers, *dampings])
    return rows
