"""gsid gimbal"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import click

from gsid.cli.experiments import Numbers, files_in, folder_option
from gsid.cli.files_in_use import FILE_OUTPUT, RECORD
from gsid.cli.option_types import Value
from gsid.cli.options import SEED, json_option, options_as_arguments, periods_option
from gsid.cli.output import answered, print_message, working


@click.command(short_help="Measure a simulated gimbal of four axes.")
@click.argument("excitations", metavar="EXC...", nargs=-1, required=True, type=RECORD)
@periods_option(3)
@click.option(
    "--settle-periods",
    metavar="N",
    type=click.IntRange(0),
    default=2,
    help="Periods before these, in which the motion settles. [default: 2]",
)
@click.option(
    "--friction",
    metavar=Value.name,
    type=Value(),
    multiple=True,
    help="Dry friction of an axis [N m], for example inner_azimuth=0.003. May be repeated. [default: none]",
)
@click.option(
    "--angle-deg",
    metavar=Numbers.name,
    type=Numbers(),
    help="Working position of the four axes [deg]. [default: 10,-30,2,3]",
)
@click.option(
    "--noise",
    metavar="RMS",
    type=click.FloatRange(0),
    default=0.05,
    help="Rms noise of each gyro [deg/s]. [default: 0.05]",
)
@click.option("--seed", metavar="N", type=SEED, default=1, help="Random seed of the noise. [default: 1]")
@click.option("--truth", metavar="FILE", type=FILE_OUTPUT, help="Write the true parameters as JSON.")
@folder_option
@json_option
def gimbal(
    *,
    excitations: Sequence[str],
    periods: int,
    settle_periods: int,
    friction: tuple[tuple[str, float], ...],
    angle_deg: tuple[float, ...] | None,
    noise: float,
    seed: int,
    truth: str | None,
    folder: str,
    as_json: bool,
) -> None:
    """Measure a simulated gimbal: roll, outer elevation, inner azimuth and inner elevation.

    EXC are periods of torques [N m] with the columns u1 .. u4, as `gsid design orthogonal` writes them. DIR
    receives one record for each, with the rates at the four gyros [deg/s] as y1 .. y4. The axes are coupled
    by their inertia, by gyroscopic torques, and because each gyro also measures the rates of the axes before.
    """
    from gsid.base.files import write_atomically
    from gsid.records.mimo import write_mimo_record
    from gsid.rig.gimbal import AXES, N_AXES, Gimbal, by_axis, read_periods

    with options_as_arguments():
        u, fs_hz = read_periods(excitations)
        how = {} if angle_deg is None else {"angle_deg": angle_deg}
        how |= {"friction_nm": by_axis(dict(friction), (0.0,) * N_AXES)}
        plant = Gimbal(noise_deg_s=(noise,) * N_AXES, fs_hz=fs_hz, seed=seed, **how)
    paths = files_in(folder, len(u))
    with working("moving the gimbal"), options_as_arguments():
        records = plant.measure(u, periods, settle_periods)
    for path, record in zip(paths, records, strict=True):
        write_mimo_record(path, record)
    if truth:
        text = json.dumps(plant.truth(), indent=1) + "\n"
        write_atomically(truth, lambda part: Path(part).write_text(text, encoding="utf-8"))
    figures = {"n_experiments": len(paths), "n_periods": periods, "axes": list(AXES)}
    if not answered(as_json, lambda: figures):
        print_message(f"wrote {len(paths)} records of {periods} periods to {folder}")
