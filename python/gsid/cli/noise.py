"""gsid noise"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from gsid.base.tables import Table
from gsid.cli.options import (
    UsageError,
    alpha_option,
    json_option,
    noise_model_option,
    picture_option,
    reading_options,
    records_argument,
)
from gsid.cli.output import answered, draw, print_message, print_table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from gsid.records.record import Record
    from gsid.spectrum.noise import Noise


@click.command(short_help="Measure the noise spectrum and find periodic disturbances.")
@records_argument
@reading_options
@alpha_option(0.01)
@noise_model_option
@picture_option
@json_option
def noise(
    records: Sequence[str],
    read: Callable[..., list[Record]],
    alpha: float,
    noise_model: str | None,
    picture: str | None,
    as_json: bool,
) -> None:
    """Measure the noise of the output and find periodic disturbances, best with zero input.

    Periodic disturbances, for example of a fan, are detected by a test with the false-alarm rate --alpha and
    named by their frequency. The spectrum is that of the remaining noise. A file needs no input; if it has a
    periodic one, the response to it is subtracted first. With zero input --period sets the resolution.
    """
    from gsid.spectrum.noise import noise as analyse

    if picture and len(records) > 1:
        raise UsageError("--plot draws the noise of one record", "run `gsid noise` once for each record")
    if noise_model and len(records) > 1:
        raise UsageError("--noise-model is that of one record", "run `gsid noise` once for each record")
    found = [analyse(record, alpha=alpha) for record in read(records, zero_input=True)]
    draw(found[0].plot, picture)
    save_noise_model(found[0], noise_model)
    if not answered(as_json, lambda: {"records": [noise_values(one) for one in found]}):
        for one in found:
            print_noise(one)


def save_noise_model(found: Noise, path: str | None) -> None:
    """Write a noise model, if a file is named."""
    if path:
        found.save(path)
        print_message(f"wrote {path}")


def noise_values(n: Noise) -> dict:
    """Of a record, for --json."""
    low, high = n.interval()
    tones = [vars(tone) | {"name": tone.name} for tone in n.tones]
    keys = (
        "variance",
        "variance_rest",
        "mean",
        "std_mean",
        "drift",
        "std_drift",
        "alpha",
        "segment_samples",
        "period_samples",
        "settle_samples",
    )
    return {
        "record": n.name,
        "f_hz": n.f_hz,
        "psd": n.psd,
        "psd_95": [low, high],
        "n_dof": n.n_dof,
        "tones": tones,
        **{
            key: _or_null(getattr(n, key))
            for key in (*keys, "n_samples", "n_lost", "fs_hz", "refresh_hz", "y_unit")
        },
        "sentence": n.sentence,
        "level": n.drift_words,
    }


def _or_null(value: Any) -> Any:
    return None if isinstance(value, float) and math.isnan(value) else value


def print_noise(n: Noise) -> None:
    """Print bands, periodic disturbances, mean and drift, and the sentence."""
    import numpy as np

    less = f", without the part that repeats every {n.period_samples} samples" if n.period_samples else ""
    lost = f", {n.n_lost} lost" if n.n_lost else ""
    print_message(
        f"{n.name}: {n.n_samples} samples at {n.fs_hz:g} Hz{less}{lost}; windows of {n.segment_samples}"
    )
    unit = n.y_unit or "1"
    octave = np.floor(np.log2(n.f_hz / n.f_hz[0])).astype(int)
    step = n.f_hz[0]  # f_hz begins one line above 0
    bands = [octave == i for i in range(octave.max() + 1)]
    print_table(
        Table(
            ["from [Hz]", "to [Hz]", f"rms [{unit}]", f"density [{unit}/sqrt(Hz)]"],
            [
                [
                    f"{n.f_hz[band][0]:.4g}",
                    f"{n.f_hz[band][-1]:.4g}",
                    f"{np.sqrt(n.psd[band].sum() * step):.4g}",
                    f"{np.sqrt(n.psd[band].mean()):.4g}",
                ]
                for band in bands
            ],
        )
    )
    if n.tones:
        print()
        print_table(
            Table(
                ["disturbance", "sigma [Hz]", f"amplitude [{unit}]", "sigma", "false alarm"],
                [
                    [
                        tone.name,
                        f"{tone.std_f_hz:.2g}",
                        f"{tone.amplitude:.4g}",
                        f"{tone.std_amplitude:.2g}",
                        f"{tone.p_value:.2g}",
                    ]
                    for tone in n.tones
                ],
                left=["disturbance"],
            )
        )
    print(f"{n.drift_words[0].upper()}{n.drift_words[1:]}.")
    print(n.sentence)
