"""gsid frf with several inputs or outputs: a matrix of frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.options import is_given, options_as_arguments
from gsid.cli.output import answered, print_message, print_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gsid.records.mimo import MimoRecord
    from gsid.response.mimo import MimoFrf

SINGLE_ONLY = {
    "reference": "--r",
    "output": "-o",
    "remove_periodic": "--remove-periodic",
    "lpm": "--lpm",
    "window": "--window",
    "controller": "--controller",
    "merge": "--merge",
    "min_input": "--min-input",
    "picture": "--plot",
}


def refuse_options(only: dict[str, str]) -> None:
    """Refuse the options that were given and are for one input and one output.

    Raises
    ------
    UsageError
        One of them was given.
    """
    context = click.get_current_context()
    given = [option for name, option in only.items() if is_given(context, name)]
    if given:
        raise click.UsageError(f"{', '.join(given)}: for one input and one output", context)


def frf_matrix(records: Sequence[MimoRecord], *, band: tuple[float, float] | None, as_json: bool) -> None:
    """Measure and print the matrix of responses."""
    from gsid.response.mimo import frf_mimo

    refuse_options(SINGLE_ONLY)
    with options_as_arguments():
        result = frf_mimo(records, band=band)
    if not answered(as_json, lambda: _values(result)):
        _print(result)


def _values(frf: MimoFrf) -> dict:
    names = ("n_experiments", "n_periods", "source", "fs_hz", "period_samples", "inputs", "outputs")
    values = {"f_hz": frf.f_hz, "g_re": frf.g.real, "g_im": frf.g.imag, "var_g": frf.var_g}
    values |= {name: getattr(frf, name) for name in (*names, "u_units", "y_units", "hold")}
    return values | {"n_masked": frf.n_masked, "masked_hz": frf.masked_hz}


def _print(frf: MimoFrf) -> None:
    import numpy as np

    print_message(
        f"{frf.n_y} x {frf.n_u} responses, {frf.n_experiments} experiments, {frf.n_periods} periods of "
        f"{frf.period_samples} samples at {frf.fs_hz:g} Hz, sigma from the scatter over {frf.source}"
    )
    with np.errstate(divide="ignore"):
        gain, sigma = 20 * np.log10(np.abs(frf.g)), 10 * np.log10(frf.var_g)
    phase = np.degrees(np.angle(frf.g))
    rows = []
    for i, j in np.ndindex(frf.n_y, frf.n_u):
        columns = zip(frf.f_hz, gain[:, i, j], phase[:, i, j], sigma[:, i, j], strict=True)
        names = frf.outputs[i], frf.inputs[j]
        rows += [[f"{f:.4f}", *names, f"{x:.3f}", f"{angle:.2f}", f"{s:.2f}"] for f, x, angle, s in columns]
    header = ["f [Hz]", "output", "input", "|G| [dB]", "phase [deg]", "sigma [dB]"]
    print_table(Table(header, rows, left=["output", "input"]))
