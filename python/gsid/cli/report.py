"""gsid report"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsid.cli.common import with_ladder
from gsid.cli.files_in_use import INPUT, OUTPUT
from gsid.cli.options import (
    band_option,
    json_option,
    limit_command_option,
    limit_travel_option,
    options_as_arguments,
    order_option,
    record_options,
)
from gsid.cli.output import answered, describe, print_message, print_step, working

if TYPE_CHECKING:
    from gsid.diagnosis.from_records.result import Diagnosis
    from gsid.diagnosis.ladder import Ladder
    from gsid.fitting.estimators import Estimators
    from gsid.models.rational import RationalModel
    from gsid.plant.model import PlantModel
    from gsid.records.record import Record
    from gsid.response.distortion import Distortion
    from gsid.spectrum.spectra import Spectra


@click.command(short_help="Write a report as one HTML page.")
@record_options
@click.option("--model", "model_path", metavar="M.json", type=INPUT, help="Model to show and compare.")
@click.option(
    "--diagnose",
    is_flag=True,
    help="Find the effects missing from the model, and show how the error falls with them.",
)
@order_option
@click.option("--estimators", is_flag=True, help="With --order: compare every estimator.")
@band_option("Lines from LO to HI [Hz] only.")
@limit_command_option
@limit_travel_option
@click.option(
    "--interactive", is_flag=True, help="Pictures to zoom and read with the pointer; needs plotly, adds 5 MB."
)
@click.option("--title", help="Heading of the page. [default: the records' names]")
@click.option(
    "-o",
    "--output",
    metavar="FILE.html",
    type=OUTPUT,
    default="report.html",
    show_default=True,
    help="Page to write.",
)
@json_option
def report(
    *,
    records: list[Record],
    model_path: str | None,
    diagnose: bool,
    order: str | None,
    estimators: bool,
    band: tuple[float, float] | None,
    limit_command: float | None,
    limit_travel_deg: float | None,
    interactive: bool,
    title: str | None,
    output: str,
    as_json: bool,
) -> None:
    """Measure, fit and compare, and write the results as one HTML page that opens offline.

    The page begins with the answer: whether the model is adequate, what is missing, how sure this is and what
    to do next. The measured and simulated signals, the response and the ladder follow; everything else is
    folded, and opened in print.

    --order fits a transfer function with free delay. Without --model and --order the page shows the
    measurement only. The limits are drawn with the excitation and the travel that the model predicts. The
    name of the page is printed.
    """
    from gsid.base.files import is_stdout
    from gsid.comparison import compare
    from gsid.excitation.periodic import Limits
    from gsid.models.load import load_plant, load_single
    from gsid.report import Report
    from gsid.response.estimate import frf
    from gsid.spectrum.noise import noise
    from gsid.spectrum.realisation import spectra

    context = click.get_current_context()
    if model_path and order:
        raise click.UsageError("give --model or --order, not both", context)
    if diagnose and not model_path:
        raise click.UsageError("--diagnose needs --model, a stack of effects", context)
    if estimators and not order:
        raise click.UsageError("--estimators needs --order", context)
    title = title or f"Report on {describe(records)}"
    page = Report(title, interactive=interactive)  # without plotly, the error comes before the work
    with working(f"writing a report on {describe(records)}"), options_as_arguments():
        measured = [spectra(record) for record in records]
        response = frf(records, band=band)
        model, by_all = None, None
        if model_path:
            model = load_plant(model_path) if diagnose else load_single(model_path)
        elif order:
            model, by_all = fitted(measured, order, band, estimators)
        comparison = compare(model, measured, band=band, fitted=order is not None) if model else None
        found, steps = _diagnosed(model, measured, band) if diagnose else (None, None)
        page.add_experiment(
            describe(records),
            records,
            measured,
            response,
            model,
            comparison,
            distortion=_distortion_or_none(measured, band),
            noise=noise(records[0]),
            limits=Limits(limit_command, limit_travel_deg),
            diagnosis=found,
            ladder=steps,
            estimators=by_all,
        )
        path = page.write(output)
    judged = found or comparison
    adequate = judged.adequate if judged else None
    is_printed = answered(as_json, lambda: {"report": str(path), "adequate": adequate})
    if not is_printed and not is_stdout(output):
        print(path)


def fitted(
    measured: list[Spectra], order: str, band: tuple[float, float] | None, estimators: bool
) -> tuple[RationalModel, Estimators | None]:
    """The model of `gsid fit` with the same options, and those of all estimators if requested.

    Parameters
    ----------
    measured : list of Spectra
    order : str
        "POLES/ZEROS", or "auto".
    band : (lo, hi) or None
        Lines to use [Hz].
    estimators : bool

    Returns
    -------
    model : RationalModel
    by_all : Estimators or None
    """
    from gsid.fitting.estimators import fit_all
    from gsid.fitting.order import select_order
    from gsid.fitting.rational import fit
    from gsid.response.with_distortion import frf_with_distortion

    response, allowed = frf_with_distortion(measured), None
    if order == "auto":
        choice = select_order(response, band=band)
        order, allowed = choice.chosen.order, choice.relative_error
        print_step(f"order {order} chosen")
    model = fit(response, order, band=band, relative_error=allowed)
    if not estimators:
        return model, None
    print_step(f"fitting {order} by every estimator")
    return model, fit_all(response, order, band=band, relative_error=allowed)


def _distortion_or_none(measured: list[Spectra], band: tuple[float, float] | None) -> Distortion | None:
    """Records of several levels are compared with a plant, but have no one best linear approximation."""
    from gsid.base.errors import InputError
    from gsid.response.estimate_distortion import distortion

    try:
        return distortion(measured, band=band)
    except InputError as error:
        print_message(f"note: distortion left out: {error.what}")
        return None


def _diagnosed(
    model: PlantModel, measured: list[Spectra], band: tuple[float, float] | None
) -> tuple[Diagnosis, Ladder | None]:
    """The diagnosis, and the ladder of the model that it found."""
    from gsid.diagnosis.from_records.diagnose import diagnose
    from gsid.diagnosis.ladder import ladder

    found = diagnose(model, measured, band=band, on_step=print_step)
    final = with_ladder(model, found)
    return found, None if final is None else ladder(final)
