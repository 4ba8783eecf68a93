"""gsid distortion"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.distortion_matrix import distortion_matrix
from gsid.cli.files_in_use import RECORD
from gsid.cli.options import band_option, json_option, picture_option, reading_options, records_argument
from gsid.cli.output import answered, draw, print_message, print_table

if TYPE_CHECKING:
    from gsid.records.mimo import MimoRecord
    from gsid.records.record import Record
    from gsid.response.distortion import Distortion
    from gsid.response.superposition import Superposition


@click.command(short_help="Separate noise from nonlinear distortion.")
@records_argument
@reading_options
@band_option("Lines from LO to HI [Hz] only.")
@click.option(
    "--other-level",
    metavar="REC",
    type=RECORD,
    multiple=True,
    help="Record at another input level, whose response is compared. May be repeated.",
)
@picture_option
@json_option
def distortion(
    records: Sequence[str],
    read: Callable[..., list[Record] | list[MimoRecord]],
    band: tuple[float, float] | None,
    other_level: tuple[str, ...],
    picture: str | None,
    as_json: bool,
) -> None:
    """Separate noise from nonlinear distortion in a frequency response.

    One REC is one realisation: a multisine with its own random phases, measured over several periods. The
    scatter over periods is noise. The scatter over realisations is noise and distortion. Lines that are not
    excited show distortion too, for which one REC is enough. If the excited lines are odd, even and odd
    distortion are separated.

    std_nonlinear is of the response of one realisation; var_noise and var_total are of the mean (bla).
    even and odd are amplitudes of the output at even_hz and odd_hz, lines that are not excited. even_noise
    and odd_noise are the amplitudes expected there from noise alone.

    With --other-level the plot shows the change of the response between the levels.

    With several inputs or outputs (--u u1,u2 --y y1,y2) a realisation is as many RECs as inputs, one after
    the other. Distortion is shown at each output and referred to each input, where it enters.
    """
    from gsid.records.mimo import MimoRecord
    from gsid.response.estimate_distortion import distortion as measure
    from gsid.response.superposition import superposition

    measured = read(records, matrix=True)
    if isinstance(measured[0], MimoRecord):
        distortion_matrix(measured, band=band, as_json=as_json)
        return
    result = measure(measured, band=band)
    change = superposition(result, measure(read(other_level), band=band)) if other_level else None
    draw((change or result).plot, picture)
    if not answered(as_json, lambda: _values(result) | (_change(change) if change else {})):
        _print(result)
        if change:
            print(change.sentence)


def _values(d: Distortion) -> dict:
    interval = d.intervals()
    values = {
        "line": d.line,
        "f_hz": d.f_hz,
        "bla_re": d.bla.real,
        "bla_im": d.bla.imag,
        "var_noise": d.var_noise,
        "var_total": d.var_total,
        "std_nonlinear": d.std_nonlinear,
        "std_nonlinear_95": interval["std_nonlinear"],
        "std_noise_95": interval["std_noise"],
        "u": d.u,
        "coherence": d.coherence,
    }
    for name, chosen in (("even", d.even), ("odd", d.odd)):
        values[name] = d.level[chosen]
        values[f"{name}_hz"] = d.free_f_hz[chosen]
        values[f"{name}_noise"] = d.level_noise[chosen]
    if len(d.line) == 1:
        from gsid.response.superposition import harmonics

        values["harmonics"] = [vars(h) for h in harmonics(d)]
    keys = ("n_periods", "n_realisations", "n_spoiled", "period_samples", "settle_samples", "fs_hz")
    return values | {
        "noncausal_power_ratio": d.noncausal_power_ratio,
        "orders_apart": d.orders_apart,
        "bands": [vars(band) for band in d.bands],
        "verdict": d.verdict,
        **{key: getattr(d, key) for key in (*keys, "u_unit", "y_unit")},
    }


def _change(change: Superposition) -> dict:
    return {
        "superposition": {
            "f_hz": change.f_hz,
            "level_ratio": change.level_ratio,
            "change_db": change.change_db,
            "change_deg": change.change_deg,
            "std": change.std,
            "p_value": change.p_value,
            "n_dof": change.n_dof,
            "noise_ratio": change.noise_ratio,
            "one_noise_ratio": change.one_noise_ratio,
            "sentence": change.sentence,
        }
    }


def _print(d: Distortion) -> None:
    import numpy as np

    print_message(
        f"{d.name}: {d.n_realisations} realisation{'s' * (d.n_realisations != 1)}, {d.n_periods} periods of "
        f"{d.period_samples} samples, {len(d.line)} lines excited, {len(d.free_line)} free"
    )
    with np.errstate(divide="ignore"):
        columns = {
            "f [Hz]": [f"{f:.4f}" for f in d.f_hz],
            "|G| [dB]": [f"{x:.2f}" for x in 20 * np.log10(np.abs(d.bla))],
            "noise [dB]": [f"{x:.2f}" for x in 10 * np.log10(d.var_noise)],
        }
        if d.n_realisations > 1:
            columns["total [dB]"] = [f"{x:.2f}" for x in 10 * np.log10(d.var_total)]
        if np.isfinite(d.std_nonlinear).any():  # known from one realisation too if some lines are not excited
            columns["distortion [dB]"] = [f"{x:.2f}" for x in 20 * np.log10(d.std_nonlinear)]
    if len(d.line) == 1:
        _print_harmonics(d)
    else:
        print_table(Table(list(columns), list(zip(*columns.values(), strict=True))))
    print(d.verdict)


def _print_harmonics(d: Distortion) -> None:
    from gsid.response.superposition import harmonics

    unit = f" [{d.y_unit}]" if d.y_unit else ""
    header = ["order", "f [Hz]", f"amplitude{unit}", "below the sine [dB]", "above noise [dB]"]
    rows = [
        [
            f"{h.order}",
            f"{h.f_hz:.4f}",
            f"{h.level:.4g}",
            f"{h.below_fundamental_db:.1f}",
            f"{h.above_noise_db:.1f}",
        ]
        for h in harmonics(d)
    ]
    print_table(Table(header, rows))
