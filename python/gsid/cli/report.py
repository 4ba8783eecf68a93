"""gsid report"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsid.cli.common import (
    band_option,
    describe,
    json_option,
    options_as_arguments,
    print_json,
    record_options,
    working,
)
from gsid.cli.fit import Order

if TYPE_CHECKING:
    from gsid.record import Record


@click.command(short_help="Write a report as one HTML page.")
@record_options
@click.option("--model", "model_path", metavar="M.json", type=click.Path(), help="Model to show and compare.")
@click.option("--order", type=Order(), help="Fit a model of this order, with free delay, instead.")
@band_option("Measure, fit and compare from LO to HI [Hz] only.")
@click.option("--title", help="Heading of the page. [default: the records' names]")
@click.option(
    "-o",
    "--output",
    metavar="FILE.html",
    type=click.Path(dir_okay=False),
    default="report.html",
    show_default=True,
    help="Page to write.",
)
@json_option
def report(
    records: list[Record],
    model_path: str | None,
    order: str | None,
    band: tuple[float, float] | None,
    title: str | None,
    output: str,
    as_json: bool,
) -> None:
    """Write what was measured, fitted and compared as one HTML page that opens offline.

    Without --model and --order the page shows the measurement only. The name of the page is printed.
    """
    from gsid.compare import compare
    from gsid.fit import fit
    from gsid.frf import frf, spectra
    from gsid.model import RationalModel
    from gsid.report import Report

    if model_path and order:
        raise click.UsageError("give --model or --order, not both", click.get_current_context())
    with working(f"writing a report on {describe(records)}"), options_as_arguments():
        measured = frf(records, band=band)
        model = None
        if model_path:
            model = RationalModel.load(model_path)
        elif order:
            model = fit(measured, order)
        comparison = compare(model, records, band=band) if model else None
        page = Report(title or f"Report on {describe(records)}")
        page.add_experiment(
            describe(records), records, [spectra(r) for r in records], measured, model, comparison
        )
        path = page.write(output)
    if as_json:
        print_json({"report": str(path), "adequate": comparison.adequate if comparison else None})
    else:
        print(path)
