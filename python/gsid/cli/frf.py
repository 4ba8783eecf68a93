"""gsid frf"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.files_in_use import INPUT, OUTPUT
from gsid.cli.frf_matrix import frf_matrix
from gsid.cli.options import (
    band_option,
    experiment_options,
    json_option,
    options_as_arguments,
    picture_option,
    reference_option,
)
from gsid.cli.output import answered, draw, print_message, print_table

if TYPE_CHECKING:
    from gsid.records.mimo import MimoRecord
    from gsid.records.record import Record
    from gsid.response.frf import Frf


@click.command(short_help="Frequency response and its variance from records.")
@experiment_options
@reference_option
@band_option("Lines from LO to HI [Hz] only.")
@click.option(
    "-o", "--output", metavar="FILE", type=OUTPUT, help="Write .csv, .npz or .mat instead of a table."
)
@click.option(
    "--remove-periodic",
    is_flag=True,
    help="Subtract periodic disturbances (see `gsid noise`) from the output first.",
)
@click.option(
    "--lpm",
    is_flag=True,
    help="Estimate and remove the transient (local polynomial method) instead of discarding it. One "
    "period is enough.",
)
@click.option(
    "--window",
    metavar="N",
    type=click.IntRange(4),
    help="Length of the Hann windows, for an input that is not periodic. [default: chosen from the data]",
)
@click.option(
    "--controller",
    metavar="C.json",
    type=INPUT,
    help="Rational model of the controller of a closed loop whose reference is u (--u NAME): gives the "
    "response of the plant behind it, T/(C (1 - T)).",
)
@click.option("--merge", is_flag=True, help="Join the records: they are parts of one realisation.")
@click.option(
    "--min-input",
    metavar="A",
    type=click.FloatRange(0),
    default=0.0,
    help="Leave out lines whose input amplitude is below A. [default: 0]",
)
@picture_option
@json_option
def frf(
    *,
    records: list[Record] | list[MimoRecord],
    reference: str | None,
    band: tuple[float, float] | None,
    output: str | None,
    remove_periodic: bool,
    lpm: bool,
    window: int | None,
    controller: str | None,
    merge: bool,
    min_input: float,
    picture: str | None,
    as_json: bool,
) -> None:
    """Measure the frequency response at the excited lines, and its variance.

    One REC is one realisation; all have the same period and rate. var_g is the variance of the mean over the
    periods (and the realisations), sigma its square root.

    In a closed loop the feedback puts noise on u, which biases an estimate from u and y alone. Name the
    reference with --r. The lines are then those that the reference excites.

    If the input is not periodic, or with --window, the response is the H1 estimate with Hann windows.
    Leakage biases it, as a warning reports.

    With several inputs or outputs (--u u1,u2 --y y1,y2,y3) each file is one experiment. At least as many
    experiments as inputs are needed; the result is a matrix of responses.
    """
    from gsid.records.mimo import MimoRecord
    from gsid.response.estimate import frf as measure

    if isinstance(records[0], MimoRecord):
        frf_matrix(records, band=band, as_json=as_json)
        return
    with options_as_arguments():
        result = measure(
            records,
            band=band,
            reference=reference,
            remove_periodic=remove_periodic,
            lpm=lpm,
            window=window,
            merge=merge,
            min_input=min_input,
        )
        if controller is not None:
            result = _behind(controller, result, reference)
    if output:
        write(output, result)
    draw(result.plot, picture)
    if not answered(as_json, lambda: _values(result)) and not output:
        _print(result)


def _behind(path: str, loop: Frf, reference: str | None) -> Frf:
    """Response of the plant in a loop with this controller."""
    from gsid.models.load import load_single
    from gsid.models.rational import RationalModel
    from gsid.response.closed_loop import plant_of_loop

    controller = load_single(path)
    if reference is not None or not isinstance(controller, RationalModel):
        raise ValueError("--controller takes a rational model, without --r: name the reference with --u")
    return plant_of_loop(loop, controller.response(loop.f_hz))


def write(path: str, response: Frf) -> None:
    """Write a response to the file of -o."""
    from gsid.response.files import write_response

    with options_as_arguments():
        write_response(path, response)
    print_message(f"wrote {path}")


def _values(frf: Frf) -> dict:
    from gsid.response.files import columns_of, keys_of

    removed = [{"f_hz": tone.f_hz, "amplitude": tone.amplitude} for tone in frf.removed]
    others = {"coherence": frf.coherence, "rejected_hz": frf.rejected_hz, "removed": removed}
    return columns_of(frf) | keys_of(frf) | others


def _print(frf: Frf) -> None:
    import numpy as np

    transient = f", transient by local polynomials ({frf.n_dof} degrees of freedom)" * (frf.method == "lpm")
    piece = "window" if frf.method == "windows" else "period"
    print_message(
        f"{frf.name}: {frf.n_periods} {piece}{'s' * (frf.n_periods > 1)} of {frf.period_samples} samples at "
        f"{frf.fs_hz:g} Hz, {frf.n_realisations} realisation{'s' * (frf.n_realisations > 1)}, "
        f"{frf.n_spoiled} spoiled, {frf.settle_samples} samples of settling left out{transient}"
    )
    with np.errstate(divide="ignore"):
        gain, sigma = 20 * np.log10(np.abs(frf.g)), 10 * np.log10(frf.var_g)
    phase = np.degrees(np.angle(frf.g))
    rows = zip(frf.f_hz, gain, phase, sigma, strict=True)
    print_table(
        Table(
            ["f [Hz]", "|G| [dB]", "phase [deg]", "sigma [dB]"],
            [[f"{f:.4f}", f"{g:.3f}", f"{p:.2f}", f"{s:.2f}"] for f, g, p, s in rows],
        )
    )
