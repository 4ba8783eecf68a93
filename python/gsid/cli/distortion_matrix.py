"""gsid distortion with several inputs or outputs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gsid.base.tables import Table
from gsid.cli.frf_matrix import refuse_options
from gsid.cli.options import options_as_arguments
from gsid.cli.output import answered, print_message, print_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gsid.records.mimo import MimoRecord
    from gsid.response.mimo_distortion import ChannelDistortion, MimoDistortion

SINGLE_ONLY = {"other_level": "--other-level", "picture": "--plot"}


def distortion_matrix(
    records: Sequence[MimoRecord], *, band: tuple[float, float] | None, as_json: bool
) -> None:
    """Separate noise and distortion of each channel and print them."""
    from gsid.response.mimo_distortion import distortion_mimo

    refuse_options(SINGLE_ONLY)
    with options_as_arguments():
        result = distortion_mimo(records, band=band)
    if not answered(as_json, lambda: _values(result)):
        _print(result)


def _values(d: MimoDistortion) -> dict:
    names = ("f_hz", "var_noise", "var_total", "std_nonlinear")
    counts = ("n_experiments", "n_realisations", "n_periods", "period_samples", "fs_hz", "masked_hz")
    return {
        **{name: getattr(d, name) for name in (*names, *counts)},
        "bla_re": d.bla.real,
        "bla_im": d.bla.imag,
        "outputs": [_channel(one) for one in d.outputs],
        "inputs": [_channel(one) for one in d.inputs],
        "distorted_outputs": d.distorted_outputs,
        "distorted_inputs": d.distorted_inputs,
        "verdict": d.verdict,
    }


def _channel(one: ChannelDistortion) -> dict:
    names = ("name", "unit", "f_hz", "level", "level_noise")
    bands = [vars(band) for band in one.bands]
    return {name: getattr(one, name) for name in names} | {"bands": bands, "distorted": one.is_distorted}


def _print(d: MimoDistortion) -> None:
    n_y, n_u = d.bla.shape[1:]
    print_message(
        f"{n_y} x {n_u} responses, {d.n_realisations} realisations, {d.n_experiments} experiments, "
        f"{d.n_periods} periods of {d.period_samples} samples, {len(d.f_hz)} lines excited"
    )
    rows = [
        [f"{'at output' if one.side == 'output' else 'referred to input'} {one.name}", one.sentence]
        for one in [*d.outputs, *d.inputs]
    ]
    print_table(Table(["channel", "distortion"], rows, left=["channel", "distortion"]))
    print(d.verdict)
