"""Chapter 7: estimators, model order and validation."""

from __future__ import annotations

import numpy as np
from chapter3 import MODEL
from chapter4 import measure
from chapter8 import measure_high
from thesis_study import HIGHEST_HZ, Row, Study, rows_of

from gsid import RationalModel, frf, read_record
from gsid.fitting.rational import initial_delay
from gsid.models.load import load_model
from gsid.plots.responses import model_errors
from gsid.rig.axis import SimulatedAxis

TITLE = "Chapter 7: estimators, order and validation"
PICTURES = {
    "ls": "Figs. 7.2 and 7.3: linear least squares.",
    "iwls": "Figs. 7.4 and 7.5: iteratively weighted linear least squares.",
    "ga": "Figs. 7.6 and 7.7: genetic algorithm.",
    "nls": "Figs. 7.8 and 7.9: nonlinear least squares.",
    "ml": "Figs. 7.10 and 7.11: maximum likelihood.",
    "all": "Figs. 7.12, 7.13 and 7.14: all methods, and their errors in amplitude and phase.",
    "high": "Fig. 7.15: the model of order 9/8.",
    "orders": "Fig. 7.16: errors of the orders.",
    "auto": "Section 7.11: the order that gsid chooses.",
}
BAND = "--band 1:120"
#: Equations and models of the thesis.
THESIS = {
    "ls": ("7.13", RationalModel([5.719, -3326, 1.43e6], [1, 486.3, 1.898e5, 8.547e5], 0.00641)),
    "iwls": ("7.17", RationalModel([-0.47, 886.3, 1685], [1, 95.46, 919.7, 7326], 0.00641)),
    "ga": ("7.19", RationalModel([7.526, -11.87, 6.735], [1, 4.929, 20.84, -5.463], 0.00641)),
    "nls": ("7.22", RationalModel([7.358, 186.2, 9.218], [1, 22.43, 244, 956.1], 0.00624)),
    "ml": ("7.30", MODEL),
}
ERROR = "error, rms over the lines [dB re the gain]"
ORDERS = ("1/0", "3/2", "6/5", "9/8")
QUICK_ORDERS = ORDERS[:2]


def rows(study: Study) -> list[Row]:
    """Figures of chapter 7."""
    measure(study, "schroeder")
    return [*_delay(study), *_methods(study), *_orders(study), *_validation(study)]


def _delay(study: Study) -> list[Row]:
    measured = frf(read_record(study.folder / "schroeder.csv"), band=(1, 120))
    true = SimulatedAxis().parameters
    lags = (
        f"{true['delay_s']:g} s delay, {true['gyro_lag_s']:g} s lag and half a refresh are 0.00765 s."
        " Below 20 Hz the spring of the axis turns the phase too."
    )
    delay_s = initial_delay(measured, (20, 120))
    how = "gsid.fitting.rational.initial_delay"
    return rows_of("7.3, eq. 7.8", how, ("initial delay, 20 to 120 Hz [s]", "0.0064", delay_s, lags))


def _methods(study: Study) -> list[Row]:
    command = f"fit schroeder.csv --order 3/2 --method all {BAND}"
    found = {one["method"]: one for one in study.gsid(command, "all")["estimators"]}
    rows, axis, own = [], ["Another axis."], ["Another axis; gsid fits the delay of every method."]
    for method, (equation, thesis) in THESIS.items():
        fit = f"fit schroeder.csv --order 3/2 --method {method} {BAND}"
        if not study.quick:
            study.gsid(fit, method)
        model = RationalModel(*(found[method]["model"][key] for key in ("num", "den", "delay_s")))
        rows += rows_of(
            *(f"eq. {equation}", fit),
            (f"{method}: delay [s]", f"{thesis.delay_s:g}", model.delay_s, *own),
            (f"{method}: gain at 10 Hz [deg/s per command]", f"{_gain(thesis):.3g}", _gain(model), *axis),
        )
        own = axis = [] if method == "ls" else own
    costs = {method: found[method]["cost"] for method in THESIS}
    delays = "The search starts at a delay of its own, which the phase of a logarithm needs."
    errors = [
        (f"{name}: {ERROR}", "not printed", one["error_db"]) for name, one in found.items() if name in THESIS
    ]
    return [
        *rows,
        *rows_of("Fig. 7.14", command, *errors),
        *rows_of("7.8", command, (f"log: {ERROR}", "no successful result", found["log"]["error_db"], delays)),
        *rows_of(
            "7.10",
            command,
            ("least cost weighted by the noise", "ml", min(costs, key=lambda name: costs[name])),
        ),
    ]


def _gain(model: RationalModel) -> float:
    return float(abs(model.response(np.array([10.0]))[0]))


def _orders(study: Study) -> list[Row]:
    rows, models = [], {}
    measured = frf(read_record(study.folder / "schroeder.csv"), band=(1, HIGHEST_HZ))
    for order in QUICK_ORDERS if study.quick else ORDERS:
        file = f"order_{order.replace('/', '_')}.json"
        command = f"fit schroeder.csv --order {order} --band 1:{HIGHEST_HZ} -o {file}"
        study.gsid(command, "high" if order == ORDERS[-1] else "")
        models[order] = load_model(study.folder / file)
        error = np.abs(models[order].response(measured.f_hz) - measured.g) / np.abs(measured.g)
        share = float(20 * np.log10(np.median(error)))
        what = f"order {order}: error, median over the lines [dB re the gain]"
        rows += rows_of("7.11, Fig. 7.16", command, (what, "falls with the order", share))
    study.draw(lambda: model_errors(measured, list(models.items())), "orders")
    return rows


def _validation(study: Study) -> list[Row]:
    for test in (1, 2):
        measure_high(study, test)
    wanted = "4/3" if study.quick else "auto"
    command = f"fit high1.csv high2.csv --order {wanted} --held-out schroeder.csv -o auto.json"
    found = study.gsid(command, "auto")
    order = f"{len(found['den']) - 1}/{len(found['num']) - 1}"
    truth = SimulatedAxis().truth()
    near = min(found["poles"], key=lambda pole: abs(pole[1] - 2 * np.pi * 179))
    check = "compare --model auto.json schroeder.csv --band 2:149.5"
    held = study.gsid(check)
    true = f"{len(truth['den']) - 1}/{len(truth['num']) - 1}"
    axis = f"The axis has {true} and a delay; the hold of its gyro is not rational."
    left = "The order chosen has a narrow pair of poles between two lines, at 2.8 Hz, besides the distortion."
    return [
        *rows_of(
            *("7.11", command),
            ("order chosen", "9/8 is the highest tried", order, axis),
            ("resonance of the chosen model [Hz]", "179", float(np.hypot(*near) / (2 * np.pi))),
        ),
        *rows_of(
            *("7.11", check),
            ("rms error on the multisine, not fitted [deg/s]", "not printed", float(held["rms_error"]), left),
            ("its noise alone [deg/s]", "not printed", float(held["noise_floor_rms"])),
        ),
    ]
