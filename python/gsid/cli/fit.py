"""gsid fit"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import click

from gsid.cli.fit_matrix import fit_matrix
from gsid.cli.fit_order import choose_order, orders_as_json, print_orders
from gsid.cli.options import (
    INPUT,
    OUTPUT,
    RECORD,
    Order,
    band_option,
    check_picture,
    is_given,
    json_option,
    options_as_arguments,
    picture_option,
    reading_options,
    records_argument,
    reference_option,
)
from gsid.cli.output import (
    describe,
    draw,
    print_json,
    print_parameters,
    print_table,
    say,
    say_assumed_hold,
    working,
)

if TYPE_CHECKING:
    import numpy as np

    from gsid.fitting.order import OrderChoice
    from gsid.fitting.validation import Validation
    from gsid.models.fit_warning import FitWarning
    from gsid.models.rational import RationalModel
    from gsid.plant.model import PlantModel
    from gsid.records.mimo import MimoRecord
    from gsid.records.record import Record
    from gsid.response.frf import Frf


class Pieces(click.ParamType):
    """A number of pieces, or auto."""

    name = "N|auto"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> str | int:
        if value == "auto" or isinstance(value, int):
            return value
        if not str(value).isdecimal() or int(value) < 1:
            self.fail(f"{value} is not auto or a number of pieces", param, ctx)
        return int(value)


class Delay(click.ParamType):
    """free, common, none or seconds."""

    name = "free|common|none|SECONDS"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> str | float:
        if value in ("free", "common", "none") or isinstance(value, float):
            return value
        try:
            seconds = float(value)
        except ValueError:
            seconds = -1.0
        if not 0 <= seconds < float("inf"):
            self.fail(f"{value} is not free, common, none or a number of seconds", param, ctx)
        return seconds


@click.command(short_help="Fit a rational model, or a stack of effects, to records.")
@records_argument
@reading_options
@reference_option
@click.option(
    "--order",
    type=Order(may_be_auto=True),
    help="Numbers of poles and zeros, for example 4/3. auto chooses the order of least MDL.",
)
@click.option(
    "--piecewise",
    metavar="N|auto",
    type=Pieces(),
    help="Split the band into N pieces and fit a model of this order in each. auto chooses the number of"
    " least MDL.",
)
@click.option(
    "--held-out",
    metavar="REC",
    multiple=True,
    type=RECORD,
    help="Judge the model on this record. It must not be one of REC... May be repeated.",
)
@click.option(
    "--model",
    "model_path",
    metavar="M.json",
    type=INPUT,
    help="Stack of effects (model file): fit its free parameters instead.",
)
@click.option(
    "--delay",
    metavar="free|common|none|SECONDS",
    type=Delay(),
    default="free",
    show_default=True,
    help="Delay: fitted (common: one for all responses), none, or a known value.",
)
@click.option(
    "--method",
    type=click.Choice(["ls", "iwls", "ga", "nls-output", "nls", "log", "ml-io", "ml", "all"]),
    default="ml",
    show_default=True,
    help="ls: least squares. iwls: iteratively reweighted. ga: evolutionary start. nls-output, nls: "
    "nonlinear, on the "
    "output or the response. log: logarithmic. ml: maximum likelihood. ml-io: with errors in the input too. "
    "all: a table of all.",
)
@band_option("Lines from LO to HI [Hz] only.")
@click.option(
    "--domain",
    type=click.Choice(["s", "z"]),
    default="s",
    show_default=True,
    help="Continuous (s) or discrete (z) model.",
)
@click.option(
    "-o",
    "--output",
    metavar="M.json|M.mat",
    type=OUTPUT,
    help="Write the model with its covariance; .mat is for MATLAB.",
)
@picture_option
@json_option
@click.pass_context
def fit(
    ctx: click.Context,
    *,
    records: Sequence[str],
    read: Callable[..., list[Record] | list[MimoRecord]],
    reference: str | None,
    order: str | None,
    piecewise: str | int | None,
    held_out: Sequence[str],
    model_path: str | None,
    delay: str | float,
    method: str,
    band: tuple[float, float] | None,
    domain: str,
    output: str | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Fit a rational transfer function with delay to the measured frequency response.

    The cost is the sum of squared errors over their variance. The expected cost is that of noise alone.
    Intervals are 95 %, from the covariance of the parameters.

    With --piecewise the band is split where models of a low order follow the response best. The models may
    differ at the breaks.

    With several inputs or outputs (--u u1,u2 --y y1,y2,y3) each file is one experiment. At least as many
    experiments as inputs are needed. All responses share their poles, and have as many zeros or one fewer.
    Methods are iwls, nls and ml. --delay free fits one delay per response. --order auto chooses the number of
    common poles of least MDL.

    With --model the free parameters of a stack of effects are fitted by simulation. The fit starts from the
    values in the file. Method ml weights each line by its noise. Method nls-output minimises the rms error of
    the output; use it for a model that is not adequate.
    """
    from gsid.models.load import load_plant

    check_picture(picture)
    if (order is None) == (model_path is None):
        raise click.UsageError("give --order for a rational model, or --model for a stack of effects", ctx)
    if model_path is not None:
        _check_options_of_plants(ctx, method)
        _fit_plant(load_plant(model_path), read(records), band, method, output, as_json)
        return
    from gsid.fitting.rational import fit as fit_model
    from gsid.fitting.validation import validate
    from gsid.records.record import Record
    from gsid.response.estimate import frf
    from gsid.spectrum.spectra import require_not_fitted

    fitted = read(records, matrix=True)
    options: dict[str, Any] = {"delay": delay, "band": band, "domain": domain}
    if not isinstance(fitted[0], Record):
        if reference is not None or piecewise is not None:
            raise click.UsageError("--r and --piecewise are for one input and one output", ctx)
        new = read(held_out, matrix=True)
        require_not_fitted(fitted, new)
        fit_matrix(fitted, new, output, picture, as_json, order=order, method=method, **options)
        return
    if delay == "common":
        raise click.UsageError("--delay common is for several inputs or outputs", ctx)
    if picture and (piecewise is not None or method == "all"):
        raise click.UsageError("--plot draws one model", ctx)
    kept_out = read(held_out)
    require_not_fitted(fitted, kept_out)
    measured, name = frf(fitted, reference=reference), describe(fitted)
    if piecewise is not None:
        if order == "auto" or method != "ml" or held_out:
            raise click.UsageError("--piecewise needs a given order and method ml, and no --held-out", ctx)
        n = None if piecewise == "auto" else piecewise
        _fit_pieces(measured, name, output, as_json, order, n, **options)
        return
    new = frf(kept_out, reference=reference) if kept_out else None
    choice = None
    if order == "auto":
        choice = choose_order(measured, name, held_out=new, **options)
        order = choice.chosen.order
    if method == "all":
        _fit_all(measured, name, output, as_json, order, held_out=new, **options)
        return
    with working(f"fitting {order} to {name}"), options_as_arguments():
        model = fit_model(measured, order, method=method, **options)
        judged = validate(model, new) if new else None
    say_assumed_hold(model.hold_assumed, model.hold, model.other_delay_s)
    _say_what_is_ill_determined(model, "" if choice else ": try --order auto")
    _tell(model, measured, choice, judged, output, picture, as_json)


def _tell(
    model: RationalModel,
    measured: Frf,
    choice: OrderChoice | None,
    judged: Validation | None,
    output: str | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Write and print a fitted transfer function, how its order was chosen, and how it does on new data."""
    if output:
        _save(model, output)
        say(f"wrote {output}")
    draw(lambda: model.plot(measured), picture)
    if as_json:
        print_json(
            _as_json(model) | orders_as_json(choice) | ({} if judged is None else {"held_out": vars(judged)})
        )
        return
    print_orders(choice)
    _print(model)
    if judged is not None:
        _print_held_out(judged)


OF_PLANTS = ("ml", "nls-output")
OF_RATIONAL_MODELS = ("delay", "domain", "reference", "piecewise", "held_out", "picture")


def _check_options_of_plants(ctx: click.Context, method: str) -> None:
    if method not in OF_PLANTS:
        raise click.UsageError(f"methods of a stack of effects are {' and '.join(OF_PLANTS)}", ctx)
    given = [name for name in OF_RATIONAL_MODELS if is_given(ctx, name)]
    if given:
        option = {"reference": "r", "picture": "plot"}.get(given[0], given[0].replace("_", "-"))
        instead = "name the reference with --u" if option == "r" else "leave it out"
        raise click.UsageError(f"--{option} belongs to a rational model: {instead}", ctx)


def _say_what_is_ill_determined(model: RationalModel, advice: str) -> None:
    import numpy as np

    from gsid.fitting.order import far_out, near_cancelled

    trade = "; the delay may trade against {}" if model.free_delay else ""
    f_hz = (
        abs(np.log(pole) * model.fs_hz if model.domain == "z" else pole) / (2 * np.pi)
        for pole, _ in near_cancelled(model)
    )
    for f in dict.fromkeys(f"{f:.4g}" for f in f_hz):  # of a pair once
        say(f"note: a pole and a zero near {f} Hz cannot be distinguished{trade.format('them')}{advice}")
    for kind, f in far_out(model):
        where = f"the {kind} at {f:.4g} Hz, above the band,"
        say(f"note: {where} may be anywhere{trade.format('it')}: try one {kind} fewer")


def _save(model: RationalModel, output: str) -> None:
    if output.lower().endswith(".mat"):
        from gsid.models.convert import save_mat

        save_mat(model, output)
    else:
        model.save(output)


def _fit_plant(
    start: PlantModel,
    records: list[Record],
    band: tuple[float, float] | None,
    method: str,
    output: str | None,
    as_json: bool,
) -> None:
    from gsid.greybox.fit import COST_MEANS, fit_plant
    from gsid.greybox.linear_start import linear_start
    from gsid.spectrum.realisation import spectra

    n_free = len(start.free_names)
    with working(f"fitting {n_free} parameters to {describe(records)}"), options_as_arguments():
        measured = [spectra(record) for record in records]
        found = fit_plant(linear_start(start, measured), measured, band=band, method=method)
    if output:
        found.model.save(output)
        say(f"wrote {output}")
    say_assumed_hold(found.hold_assumed, found.hold, found.other_delay_s)
    if as_json:
        print_json(found.summary() | {"effects": found.model.to_dict()["effects"]})
        return
    state = "converged" if found.converged else "NOT converged"
    print(f"{n_free} parameters, {found.n_dof} degrees of freedom, {state}")
    print(f"cost per degree of freedom {found.cost_per_dof:.4g} ({COST_MEANS[method]})")
    for words, names in (("at a bound", found.at_bound), ("no steady state found", found.unsettled)):
        if names:
            print(f"{words}: {', '.join(names)}")
    print()
    print_parameters(found.model)


def _fit_pieces(
    frf: Frf,
    records: str,
    output: str | None,
    as_json: bool,
    order: str,
    n_pieces: int | None,
    **options: object,
) -> None:
    """A model of low order in each of several adjoining bands."""
    from gsid.fitting.piecewise import fit_piecewise

    with working(f"fitting pieces of {order} to {records}"), options_as_arguments():
        found = fit_piecewise(frf, order, n_pieces, **options)
    say_assumed_hold(found.pieces[0].hold_assumed, found.pieces[0].hold)
    if output:
        found.save(output)
        say(f"wrote {output}")
    if as_json:
        names = ("breaks_hz", "cost", "cost_expected", "stable", "converged", "n_lines", "n_parameters")
        values = {name: getattr(found, name) for name in names}
        values |= {"pieces": [_as_json(piece) for piece in found.pieces]}
        values |= {"jumps": [vars(j) for j in found.jumps()], "tried": [vars(cut) for cut in found.tried]}
        print_json(values)
        return
    if n_pieces is None:
        rows = (
            [f"{c.n_pieces}", f"{c.cost:.5g}", f"{c.cost_expected:.5g}", f"{c.mdl:.5g}"] for c in found.tried
        )
        print_table(["pieces", "cost", "noise alone", "MDL"], rows)
        print()
    state = "converged" if found.converged else "not converged"
    n = len(found.pieces)
    print(f"{n} piece{'s' * (n != 1)} of {order}, {found.n_parameters} parameters, {state}")
    print(f"cost {found.cost:.5g}, expected of noise alone {found.cost_expected:.5g}")
    print()
    print_table(*found.table(), left=["jump"])


def _fit_all(
    frf: Frf, records: str, output: str | None, as_json: bool, order: str, **options: object
) -> None:
    """Every estimator; the model written is the best."""
    from gsid.fitting.estimators import fit_all

    with working(f"fitting {order} to {records} by every estimator"), options_as_arguments():
        found = fit_all(frf, order, **options)
        if output:
            best = found.best()
            _save(best.model, output)
            say(f"wrote {output}, the model of {best.method}")
    if as_json:
        rows = [
            vars(row)
            | {"model": row.model and _as_json(row.model), "held_out": row.held_out and vars(row.held_out)}
            for row in found.rows
        ]
        print_json(
            {
                "order": found.order,
                "initial_delay_s": found.initial_delay_s,
                "cost_expected": found.cost_expected,
                "estimators": rows,
            }
        )
        return
    print(
        f"order {found.order}, {found.n_lines} lines, delay by the slope of the phase "
        f"{1e3 * found.initial_delay_s:.4g} ms"
    )
    if found.cost_expected is not None:
        print(f"cost expected of noise alone {found.cost_expected:.5g}")
    print()
    print_table(*found.table(), left=["method", ""])


# fmt: off
JSON_KEYS = (
    "method", "num", "den", "delay_s", "cost", "cost_expected", "poles", "zeros", "converged", "stable",
    "domain", "hold", "hold_assumed", "delay_hold_uncertainty_s", "other_delay_s",
    "fs_hz", "n_lines", "n_parameters", "band_hz", "u_unit", "y_unit",
)
# fmt: on


def _as_json(model: RationalModel) -> dict:
    std = {"num": model.std_num, "den": model.std_den, "delay_s": model.std_delay_s}
    warnings = [warning.to_dict() for warning in model.warnings]
    return {name: getattr(model, name) for name in JSON_KEYS} | {"std": std, "warnings": warnings}


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
    print_table(["power", "num", "sigma", "den", "sigma "], _coefficients(model))
    print()
    poles = _roots("pole", model.poles, model.pole_cov, model)
    zeros = _roots("zero", model.zeros, model.zero_cov, model)
    print_table(["", "re", "im", "f [Hz]", "95 %", "damping", "95 % "], [*poles, *zeros], left=[""])


def _beside_intervals(warning: FitWarning) -> str:
    if warning.bias_over_std is None:
        return f"intervals count the noise alone: {warning.short}"
    return f"intervals leave out a bias of up to {warning.bias_over_std:.2g} sigma: use {warning.use}"


def _expected(model: RationalModel) -> str:
    """Cost expected of noise alone; known for maximum likelihood with enough periods only."""
    return "" if model.cost_expected is None else f", expected of noise alone {model.cost_expected:.5g}"


def _print_held_out(v: Validation) -> None:
    low, high = v.interval
    print()
    print(f"on data kept out: cost {v.cost:.5g}, {low:.0f} to {high:.0f} (95 %) of a right model")
    verdict = "adequate" if v.adequate else "not adequate"
    print(f"the model is {verdict} there: p = {v.p_value:.3g}, its own uncertainty allowed for")
    print(f"error {v.error_db:.1f} dB of the response, {v.noise_db:.1f} dB of it noise of these data")


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
