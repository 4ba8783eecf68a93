"""gsid simulate"""

from __future__ import annotations

import contextlib
import json
import math
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gsid.cli.files_in_use import FILE_OUTPUT, INPUT
from gsid.cli.option_types import Ends, Value
from gsid.cli.options import SEED, is_given, json_option, options_as_arguments
from gsid.cli.output import print_json, print_message

if TYPE_CHECKING:
    from gsid.rig.server import Damage, Server


GYROS = {
    "every-tick": {"gyro_refresh_hz": 0.0},
    "locked": {"gyro_refresh_hz": 400.0},
    "free-running": {"gyro_refresh_hz": 400.02, "gyro_free_running": 1},
}


@click.command(short_help="Serve a simulated gimbal axis on a serial line.")
@click.option("--paced", is_flag=True, help="Run in real time. [default: as fast as commands come]")
@click.option("--link", metavar="PATH", type=click.Path(), help="Make a symlink to the pseudo-terminal.")
@click.option("--once", is_flag=True, help="End when the host closes the port.")
@click.option(
    "--axis",
    "axis_file",
    metavar="FILE.json",
    type=INPUT,
    help="Simulate this model, or the axis whose parameters --truth wrote. [default: the axis of the thesis]",
)
@click.option(
    "--coulomb",
    metavar="LEVEL",
    type=float,
    help="Coulomb friction of this level: short for --effect coulomb_friction --param level=LEVEL.",
)
@click.option("--effect", metavar="EFFECT", help="Add this effect of `gsid effects` to the axis.")
@click.option(
    "--param",
    "params",
    type=Value(),
    multiple=True,
    help="Parameter of EFFECT. May be repeated. [default: typical values]",
)
@click.option(
    "--linear", is_flag=True, help="Leave out dry friction, and neither clip nor round the command."
)
@click.option(
    "--noise-scale",
    metavar="X",
    type=click.FloatRange(0),
    default=1.0,
    help="Factor on the noise and the fan of the default axis. [default: 1]",
)
@click.option(
    "--seed",
    metavar="N",
    type=SEED,
    help="Random seed of the noise and of --damage. [default: 1]",
)
@click.option(
    "--damage",
    metavar="RATE",
    type=click.FloatRange(0, 1),
    default=0.0,
    help="Share of frames to damage, in both directions. [default: 0]",
)
@click.option(
    "--gyro",
    type=click.Choice(list(GYROS)),
    default="every-tick",
    show_default=True,
    help="When the gyro measures: at every tick; at 400 Hz in step with the ticks; or at 400.02 Hz by its own"
    " clock, from an instant that --seed sets.",
)
@click.option(
    "--stops",
    type=Ends(),
    help="Angles of the mechanical stops [deg], for example -135:50; an empty end has none. [default: none]",
)
@click.option(
    "--torque-noise",
    metavar="RMS",
    type=click.FloatRange(0),
    default=0.0,
    help="Process noise: rms torque over inertia [deg/s^2], below torque_noise_hz (10 Hz). [default: 0]",
)
@click.option(
    "--set",
    "assignments",
    metavar="NAME=VALUE",
    multiple=True,
    help="Set a parameter of the axis. May be repeated.",
)
@click.option("--truth", metavar="FILE", type=FILE_OUTPUT, help="Write the true parameters as JSON.")
@click.option(
    "--log",
    metavar="FILE",
    type=FILE_OUTPUT,
    help="Write the applied command: t_s (monotonic clock), tick, u. It is 0 after HELLO and STOP.",
)
@json_option
def simulate(
    *,
    paced: bool,
    link: str | None,
    once: bool,
    axis_file: str | None,
    coulomb: float | None,
    effect: str | None,
    params: tuple[tuple[str, float], ...],
    linear: bool,
    noise_scale: float,
    seed: int | None,
    damage: float,
    gyro: str,
    stops: tuple[float, float] | None,
    torque_noise: float,
    assignments: tuple[str, ...],
    truth: str | None,
    log: str | None,
    as_json: bool,
) -> None:
    """Serve a simulated gimbal axis on a pseudo-terminal, for `gsid run --port`.

    The first line on stdout is the path of the port. Ctrl-C or SIGTERM ends the server.
    """
    from gsid.base.files import write_atomically
    from gsid.rig.server import pseudo_terminal, serve_line, symlink

    made = server_of(
        paced=paced,
        axis_file=axis_file,
        coulomb=coulomb,
        effect=effect,
        params=params,
        linear=linear,
        noise_scale=noise_scale,
        seed=seed,
        damage=damage,
        gyro=gyro,
        stops=stops,
        torque_noise=torque_noise,
        assignments=assignments,
    )
    server, damage_in, damage_out = made
    axis = server.axis
    if truth:
        _write_json(Path(truth), axis.truth())
    for name in ("SIGTERM", "SIGHUP"):
        signal.signal(getattr(signal, name), signal.default_int_handler)

    def serve() -> None:
        with pseudo_terminal() as (axis_fd, host_fd, path), symlink(link, path):
            if as_json:
                print_json({"port": path, "paced": paced, "damage": damage, "parameters": axis.parameters})
            else:
                print(path)
            sys.stdout.flush()
            with contextlib.suppress(KeyboardInterrupt):
                serve_line(server, axis_fd, host_fd, damage_in, damage_out, once)

    if log is None:
        serve()
    else:
        write_atomically(log, lambda part: _logged(part, server, serve))
    served = server.served
    print_message(
        f"served {served.ticks} ticks, {served.commands_lost} commands lost"
        + (f", latest sample {1e3 * served.late_s:.1f} ms behind the clock" if paced else "")
        + (f", {damage_in.n_hits + damage_out.n_hits} frames damaged on purpose" if damage else "")
    )


def server_of(
    *,
    paced: bool,
    axis_file: str | None,
    coulomb: float | None,
    effect: str | None,
    params: tuple[tuple[str, float], ...],
    linear: bool,
    noise_scale: float,
    seed: int | None,
    damage: float,
    gyro: str,
    stops: tuple[float, float] | None,
    torque_noise: float,
    assignments: tuple[str, ...],
) -> tuple[Server, Damage, Damage]:
    """The axis that these options describe, and the damage to its line in both directions."""
    from gsid.base.errors import GsidError
    from gsid.rig.axis import SimulatedAxis, hidden_parameters
    from gsid.rig.server import Damage, Server

    if params and not effect:
        raise click.UsageError("--param needs --effect", click.get_current_context())
    values = _scaled_noise(noise_scale) | GYROS[gyro] | {"torque_noise_rms": torque_noise}
    if axis_file is not None:
        from gsid.rig.axis_file import axis_parameters

        values |= axis_parameters(axis_file) | _typed_in(values, noise_scale, gyro, torque_noise)
    if stops is not None:
        low, high = (0.0 if math.isinf(end) else end for end in stops)  # 0: no stop on this side
        values |= {"stop_low_deg": low, "stop_high_deg": high}
    if linear:
        values |= {"coulomb_level": 0.0, "command_limit": 0.0}
    if coulomb is not None:
        values["coulomb_level"] = coulomb
    if effect:
        values |= hidden_parameters(effect, dict(params))
    if seed is not None:
        values["seed"] = seed
    values |= dict(_parameter(text) for text in assignments)
    with options_as_arguments():
        try:
            axis = SimulatedAxis(**values)
        except GsidError as error:
            text = f"{error.message} (include/gsid/host/axis.h has the ranges)"
            raise click.UsageError(text, click.get_current_context()) from error
    random = int(axis.parameters["seed"])
    return Server(axis, paced), Damage(damage, random), Damage(damage, random + 1)


def _typed_in(
    values: dict[str, float], noise_scale: float, gyro: str, torque_noise: float
) -> dict[str, float]:
    """Of the values by options, those that were typed: they replace what a file states."""
    context = click.get_current_context()
    typed = {
        "noise_scale": _scaled_noise(noise_scale),
        "gyro": GYROS[gyro],
        "torque_noise": {"torque_noise_rms": torque_noise},
    }
    kept = {name for option, own in typed.items() if is_given(context, option) for name in own}
    return {name: value for name, value in values.items() if name in kept}


def _logged(path: Path, server: Server, serve: Callable[[], None]) -> None:
    """Serve, with a line in the file for every tick and every stop."""
    with path.open("w") as file:
        file.write("t_s,tick,u\n")
        server.on_applied = lambda t_s, first, u: file.writelines(
            f"{t_s:.6f},{tick},{value:.9g}\n" for tick, value in enumerate(u.tolist(), first)
        )
        serve()


def _scaled_noise(factor: float) -> dict[str, float]:
    from gsid.rig.axis import SimulatedAxis

    defaults = SimulatedAxis().parameters
    return {name: factor * defaults[name] for name in ("noise_rms", "noise_low_rms", "fan_amplitude")}


def _parameter(text: str) -> tuple[str, float]:
    from gsid.base.errors import choose
    from gsid.rig.axis import parameter_types

    types = parameter_types()
    name, equals, value = text.partition("=")
    context = click.get_current_context()
    if not equals:
        raise click.UsageError(f"--set {text} is not NAME=VALUE", context)
    if name not in types:
        raise click.UsageError(f"no axis parameter {name}; {choose(name, types)}", context)
    try:
        return name, types[name](value)
    except ValueError:
        raise click.UsageError(
            f"--set {text}: {value} is not a number ({types[name].__name__})", context
        ) from None


def _write_json(path: Path, values: dict) -> None:
    from gsid.base.files import write_atomically

    write_atomically(
        path, lambda part: part.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    )
