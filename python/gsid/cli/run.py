"""gsid run"""

from __future__ import annotations

import contextlib
import datetime
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gsid.base.files import is_stdout
from gsid.base.tables import Table
from gsid.cli.attended import Attendance, line_writer, print_record
from gsid.cli.files_in_use import INPUT, OUTPUT
from gsid.cli.option_types import Band
from gsid.cli.options import (
    LIMIT,
    UsageError,
    amplitude_option,
    is_given,
    json_option,
    limit_command_option,
    multisine_options,
    noise_model_option,
    options_as_arguments,
    period_option,
    periods_option,
    picture_option,
    rate_option,
    scale_option,
)
from gsid.cli.output import answered, draw, print_message, print_step, print_table, prints_lines
from gsid.cli.simulated_port import simulated_port
from gsid.cli.stopping import Stopping, print_if_open

if TYPE_CHECKING:
    import numpy as np

    from gsid.excitation.multisine import Multisine
    from gsid.records.record import Record
    from gsid.response.frf import Frf
    from gsid.response.streaming import StreamingFrf
    from gsid.rig.run import Progress

LINE = ("lost_samples", "lost_commands", "link_frames", "link_damaged")
JOURNAL = ".journal"  # behind the record's name
DESIGN = ("period", "band", "lines", "amplitude", "phases", "seed", "shape", "offset_phase")


class Settle(click.ParamType):
    """Samples, or periods with a p behind the number."""

    name = "N|Np"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, bool]:
        if isinstance(value, tuple):
            return value
        number = str(value).removesuffix("p")
        if not number.isdecimal():
            self.fail(f"{value} is neither a number of samples nor, like 2p, of periods", param, ctx)
        return int(number), str(value).endswith("p")


@click.command(short_help="Drive an axis over a serial line and record it.")
@click.option("--port", metavar="PATH", help="Serial port, or the path printed by `gsid simulate`.")
@click.option(
    "--simulate",
    "simulated",
    metavar="OPTIONS",
    help="Instead of --port: drive a simulated axis with these options of `gsid simulate`, for example"
    " '--paced --coulomb 5'.",
)
@rate_option("3000", default=3000.0)
@period_option("6000", default=6000)
@click.option(
    "--band", type=Band(), default=(1.0, 250.0), help="Lines from LO to HI [Hz] only. [default: 1:250]"
)
@multisine_options
@amplitude_option("3", default=3.0)
@click.option(
    "--u",
    "u_file",
    metavar="FILE",
    type=INPUT,
    help="File with one period of the command in column u, instead of a multisine.",
)
@click.option(
    "--zero",
    "zero_s",
    metavar="SECONDS",
    type=click.FloatRange(0, min_open=True),
    help="Measure noise, drift and periodic disturbances with zero input. --period is the length of the"
    " windows of the spectrum.",
)
@noise_model_option
@scale_option
@periods_option(12)
@click.option(
    "--settle",
    type=Settle(),
    default="2p",
    help="Samples, or periods as in 2p, to discard at the start and after a lost command. [default: 2p]",
)
@limit_command_option
@click.option(
    "--limit-travel-deg",
    metavar="D",
    type=LIMIT,
    help="Limit of the travel from the start [deg]: stop above D. The travel is the integral of the rate"
    " in deg/s "
    "less its mean over half a second at rest before the start.",
)
@click.option(
    "--limit-rate", metavar="R", type=LIMIT, help="Limit of |rate|, in the unit of the output: stop above R."
)
@click.option(
    "-o", "--output", metavar="REC", type=OUTPUT, help="Record to write. [default: run_DATE_TIME.csv]"
)
@click.option(
    "--recover",
    "journal_file",
    metavar="JOURNAL",
    type=INPUT,
    help="Make a record from the journal of an interrupted run; needs no port. [default of -o: JOURNAL "
    "without .journal]",
)
@click.option(
    "--attended",
    is_flag=True,
    help="For a program that shows the run: figures as JSON lines on stderr, and a stop when nothing arrives"
    " on stdin for 3 s or it is closed.",
)
@picture_option
@json_option
def run(
    *,
    port: str | None,
    simulated: str | None,
    fs_hz: float,
    period: int,
    band: tuple[float, float],
    shape: dict,
    amplitude: float,
    u_file: str | None,
    zero_s: float | None,
    noise_model: str | None,
    scale: tuple[float, str] | None,
    periods: int,
    settle: tuple[int, bool],
    limit_command: float | None,
    limit_travel_deg: float | None,
    limit_rate: float | None,
    output: str | None,
    journal_file: str | None,
    attended: bool,
    picture: str | None,
    as_json: bool,
) -> None:
    """Excite an axis periodically until it has the requested number of good periods, and write the record.

    A lost or damaged sample spoils its own period only, and the run continues. If too many are lost, the run
    stops and keeps the samples measured so far. It also stops when the axis passes a limit; the planned
    command is compared with --limit-command before the start. The command is set to zero at the end of every
    run.

    Samples are written to REC.journal as they arrive. The journal is removed once the record is on the disk.
    After a crash or a full disk, `gsid run --recover REC.journal` makes a record from it.
    """
    import numpy as np

    from gsid.response.streaming import StreamingFrf
    from gsid.rig.samples import check_length
    from gsid.rig.watch import RunLimits

    if journal_file is not None:
        _recover(journal_file, output, as_json)
        return
    if (port is None) == (simulated is None):
        text = "give --port, --simulate or --recover: one of them"
        raise click.UsageError(text, click.get_current_context())
    if zero_s is not None:
        _check_zero(attended)
        periods = math.ceil(zero_s * fs_hz / period)
    elif noise_model:
        raise UsageError("--noise-model needs --zero", "or `gsid noise REC --noise-model FILE` of a record")
    if u_file is None:  # before an excitation of this length is designed
        check_length(period, settle[0] * (period if settle[1] else 1), periods)
    with options_as_arguments():
        if zero_s is not None:
            plan = _Plan(np.zeros(period), period, fs_hz, np.array([], int), {"excitation": "zero"})
        elif u_file:
            plan = _from_file(u_file, fs_hz)
        else:
            plan = _multisine(fs_hz, period, band, amplitude, shape)
    if plan.is_stepped:
        periods, settle = _of_stepped(periods, settle)
    elif picture and periods < 2 and zero_s is None:
        raise UsageError("--plot draws the frequency response, with its noise", "give --periods 2 or more")
    n_settle = settle[0] * plan.n_period if settle[1] else settle[0]
    default = f"run_{datetime.datetime.now():%Y%m%d_%H%M%S}.csv"
    path = Path(output or default)
    journal = Path(f"{default if is_stdout(path) else path}{JOURNAL}")
    _try_out(path, plan.meta | {"port": port or ""})
    frf = None
    if zero_s is None:
        frf = StreamingFrf(plan.fs_hz, plan.n_period, plan.line, settle_samples=n_settle)
    drive = {
        "periods": periods,
        "settle": n_settle,
        "frf": frf,
        "limits": RunLimits(limit_command, limit_travel_deg, limit_rate),
    }
    if scale is not None:
        drive |= {"command_scale": scale[0], "u_unit": scale[1]}
    with contextlib.ExitStack() as stack:
        if simulated is not None:
            port = stack.enter_context(simulated_port(simulated))
        record = _drive(port, plan, path, journal, drive, attended)
    _warn(record.meta)
    if frf is None:
        _show_noise(path, record, noise_model, picture, as_json)
        return
    response = _response(frf, plan, record)
    if response is not None:
        draw(response.plot, picture)
    _print(path, record, response, as_json)


def _response(streamed: StreamingFrf, plan: _Plan, record: Record) -> Frf | None:
    """The response of a run; None if it has fewer than two good periods."""
    from gsid.response.stepped import stepped_frf

    if plan.is_stepped:
        return stepped_frf([record])
    if streamed.n_periods < 2:
        return None
    return replace(streamed.result(), u_unit=record.u_unit, y_unit=record.y_unit)


def _check_zero(attended: bool) -> None:
    """Refuse options of an excitation."""
    context = click.get_current_context()
    names = [name for name in DESIGN if name != "period"]
    given = [f"--{name.replace('_', '-')}" for name in names if is_given(context, name)]
    given += [f"--{name}" for name, of in (("u", "u_file"), ("periods", "periods")) if is_given(context, of)]
    if given:
        raise click.UsageError(f"--zero excites nothing: leave out {', '.join(given)}", context)
    if attended:
        raise click.UsageError("--zero has no response that --attended could show", context)


def _show_noise(
    path: Path, record: Record, noise_model: str | None, picture: str | None, as_json: bool
) -> None:
    """Noise, drift and periodic disturbances of a run with zero input."""
    from gsid.cli.noise import noise_values, print_noise, save_noise_model
    from gsid.spectrum.noise import noise

    found = noise(replace(record, name=str(path)))
    draw(found.plot, picture)
    save_noise_model(found, noise_model)
    if not answered(as_json, lambda: _figures_of(path, record) | {"noise": noise_values(found)}):
        print_noise(found)


def _of_stepped(periods: int, settle: tuple[int, bool]) -> tuple[int, tuple[int, bool]]:
    """Defaults of a stepped sine: one sequence without settling, since each sine has its waiting time."""
    context = click.get_current_context()
    if not is_given(context, "periods"):
        periods = 1
    return periods, settle if is_given(context, "settle") else (0, False)


@dataclass(frozen=True)
class _Plan:
    """One period of the command, or its multisine, and its excited lines."""

    excitation: Multisine | np.ndarray
    n_period: int
    fs_hz: float
    line: np.ndarray
    meta: dict[str, str]
    is_stepped: bool = False


def _multisine(fs_hz: float, period: int, band: tuple[float, float], amplitude: float, shape: dict) -> _Plan:
    from gsid.excitation.multisine import Multisine

    signal = Multisine.design(fs_hz, period, band, **shape, amplitude=amplitude)
    return _Plan(signal, period, fs_hz, signal.line, {"excitation": repr(signal)})


def _drive(
    port: str, plan: _Plan, path: Path, journal: Path, options: dict[str, Any], attended: bool
) -> Record:
    """Run, and write the record in any case; then raise the error that ended the run early."""
    from gsid.rig.link import Stopped
    from gsid.rig.run import run

    stopping = Stopping()
    is_gone = Attendance() if attended else lambda: False
    with stopping.caught():
        failure: BaseException | None = None
        try:
            shown = _figures(options) if attended else _bar(options, plan)
            with options_as_arguments(), shown as show:
                record = run(
                    port,
                    plan.excitation,
                    fs_hz=plan.fs_hz,
                    meta=plan.meta,
                    on_progress=show,
                    journal=journal,
                    should_stop=lambda: stopping() or is_gone(),
                    **options,
                )
        except BaseException as error:  # first write what was measured
            failure, record = error, getattr(error, "record", None)
        if stopping():
            print_if_open(f"{stopping.name()}: the run is stopped")
        if record is not None:
            is_written = _keep(path, record, journal, failure)
            if is_written and attended:
                good, spoiled = (int(record.meta[name]) for name in ("good_periods", "spoiled_periods"))
                print_record(str(path), len(record), good, spoiled)
        if isinstance(failure, Stopped) and not stopping() and isinstance(is_gone, Attendance):
            print_if_open(f"{is_gone.reason}: the run is stopped")  # last: the reader may hang
    if failure is not None:
        raise failure
    if stopping():  # while the record of a whole run was written
        raise KeyboardInterrupt
    return record


def _keep(path: Path, record: Record, journal: Path, failure: BaseException | None) -> bool:
    """Write the record, then remove the journal, which is kept if that fails; whether it is written."""
    from gsid.base.errors import InputError

    try:
        _write(path, record)
    except (OSError, InputError, KeyboardInterrupt) as error:
        reason = getattr(error, "strerror", None) or str(error) or "stopped"
        hint = f"the samples are in the journal: `gsid run --recover {journal} -o REC` makes a record of it"
        if failure is None:
            raise InputError("the record cannot be written", str(path), reason, hint) from error
        print_if_open(f"the record cannot be written: {path}: {reason}\n  hint: {hint}")
        return False
    journal.unlink(missing_ok=True)
    return True


def _warn(meta: dict[str, str]) -> None:
    """Warn of doubts about a completed run."""
    from gsid.rig.link import SILENCE_STOP_S

    if meta["command_zero_confirmed"] != "yes":
        print_message("warning: the axis has not confirmed that its command is zero")
    silence_s = float(meta["longest_host_silence_s"])
    if silence_s > SILENCE_STOP_S:
        print_message(
            f"warning: this computer sent nothing for {silence_s:g} s, and the axis stopped meanwhile: "
            "periods that this has disturbed are left out"
        )


def _recover(journal: str, output: str | None, as_json: bool) -> None:
    """Write the record of a journal; the journal is kept."""
    from gsid.base.errors import InputError
    from gsid.rig.journal import recover

    context = click.get_current_context()
    given = [
        param.opts[0]
        for param in context.command.params
        if param.name not in ("journal_file", "output", "as_json") and is_given(context, str(param.name))
    ]
    if given:
        raise click.UsageError(f"--recover measures nothing: leave out {', '.join(given)}", context)
    path = Path(output or journal.removesuffix(JOURNAL))
    if output is None and (path.exists() or str(path) == journal):
        raise InputError("the file exists already", str(path), None, "name the record with -o REC")
    got = recover(journal)
    if got.n_torn or got.n_damaged:
        print_message(
            f"warning: {journal}: {got.n_torn} bytes at the end are not a whole block and are ignored"
            + (f", and {got.n_damaged} damaged ones before: their samples are lost" if got.n_damaged else "")
        )
    _write(path, got.record)
    print_message(f"{journal} is kept: remove it when the record is good")
    meta = got.record.meta
    counts = {"n_periods": int(meta["good_periods"]), "n_spoiled": int(meta["spoiled_periods"])}
    lost = {"n_torn_bytes": got.n_torn, "n_damaged_bytes": got.n_damaged}
    figures = {"record": str(path), **counts, "lost_samples": int(meta["lost_samples"]), **lost}
    answered(as_json, lambda: figures)


def _from_file(path: str, fs_hz: float) -> _Plan:
    """One period of the command in a file."""
    import numpy as np

    from gsid.base.errors import InputError
    from gsid.records.files import read_record
    from gsid.response.stepped import steps_of
    from gsid.spectrum.excited import excited_lines

    context = click.get_current_context()
    given = [f"--{name.replace('_', '-')}" for name in DESIGN if is_given(context, name)]
    if given:
        raise click.UsageError(f"--u provides the whole excitation: leave out {', '.join(given)}", context)
    record = read_record(path, u="u", y="u", fs_hz=fs_hz if is_given(context, "fs_hz") else None)
    u = record.u[: record.period_samples]
    if (peak := float(np.max(np.abs(u)))) > float(np.finfo(np.float32).max):
        hint = "scale u to the range of the axis's command"
        raise InputError("u is too large for the line", path, f"peak {peak:g}, single precision", hint)
    spectrum = np.fft.rfft(u) * (2 / len(u))
    excited = np.flatnonzero(excited_lines(spectrum[None], len(u)))
    if not len(excited):
        raise InputError(
            "u excites no line",
            path,
            None,
            "make an excitation with `gsid design`",
        )
    meta = {"excitation": f"from {Path(path).name}"}
    steps = steps_of(record.meta, path)
    layout = {} if steps is None else {key: str(value) for key, value in steps.keys().items()}
    return _Plan(u, len(u), record.fs_hz, excited, meta | layout, is_stepped=steps is not None)


def _try_out(path: Path, meta: dict[str, str]) -> None:
    """Check before the axis moves that a record with these texts can be written."""
    import secrets
    import tempfile

    import numpy as np

    from gsid.records.files import write_record
    from gsid.records.record import Record

    record = Record(np.zeros(2), np.zeros(2), 1.0, meta=meta, name=str(path))
    if is_stdout(path):
        with tempfile.TemporaryDirectory() as folder:
            write_record(Path(folder) / "record.csv", record)
        return
    # A random name, at which no link can have been placed.
    probe = path.with_name(f".gsid-{secrets.token_hex(8)}{path.suffix}")
    try:
        write_record(probe, record)
    finally:
        probe.unlink(missing_ok=True)


def _write(path: Path, record: Record) -> None:
    from gsid.records.files import write_record

    write_record(path, record)
    good, lost = record.meta["good_periods"], record.meta["spoiled_periods"]
    print_if_open(f"wrote {path}: {len(record)} samples, {good} good periods, {lost} lost")


def _steps(plan: _Plan, n_settle: int) -> Callable[[Progress], None]:
    """Print each period that ends as a step, and the time that is left if no more are lost."""
    from gsid.base.progress import ProgressText

    counted = (-1, -1)

    def show(now: Progress) -> None:
        nonlocal counted
        if (now.good, now.lost) == counted:
            return
        counted = now.good, now.lost
        left = n_settle + (now.requested + now.lost) * plan.n_period - now.ticks
        words = f"{now.good} good periods, {now.lost} lost"
        with contextlib.suppress(OSError):  # the reader may end while the run continues
            print_step(ProgressText(words, f"{now.good}/{now.requested}", max(0.0, left / plan.fs_hz)))

    return show


@contextlib.contextmanager
def _figures(options: dict[str, Any]) -> Iterator[Callable[[Progress], None]]:
    """Figures of the run as JSON lines."""
    from gsid.rig.figures import Figures

    with line_writer() as writer:
        figures = Figures(options["frf"], options["limits"], options["settle"], writer.send)
        try:
            yield figures.take
        finally:
            writer.waits = True
            figures.flush()


@contextlib.contextmanager
def _bar(options: dict[str, Any], plan: _Plan) -> Iterator[Callable[[Progress], None] | None]:
    """A progress bar on stderr when that is a terminal; steps for a program that reads them."""
    if prints_lines():
        yield _steps(plan, options["settle"])
        return
    if not sys.stderr.isatty():
        yield None
        return
    from rich import progress as rich
    from rich.console import Console

    columns = (
        rich.TextColumn("periods: {task.completed} good, {task.fields[lost]} lost"),
        rich.BarColumn(),
        rich.TextColumn("{task.fields[ticks]} ticks"),
        rich.TimeElapsedColumn(),
    )
    bar = rich.Progress(*columns, console=Console(stderr=True))
    task = bar.add_task("", total=options["periods"], lost=0, ticks=0)
    gone = contextlib.suppress(OSError)  # the terminal may be closed while the run continues

    def show(now: Progress) -> None:
        with gone:
            bar.update(task, completed=now.good, lost=now.lost, ticks=now.ticks)

    bar.start()
    try:
        yield show
    finally:
        with gone:
            bar.stop()


def _print(path: Path, record: Record, frf: Frf | None, as_json: bool) -> None:
    """The response as the C core measured it while the axis ran, and how the line behaved."""
    figures = _figures_of(path, record)
    lines = {}
    if frf is not None:
        lines = {"f_hz": frf.f_hz, "g_re": frf.g.real, "g_im": frf.g.imag, "var_g": frf.var_g}
    if answered(as_json, lambda: figures | lines):
        return
    rows = [
        [name, f"{value:.6g}" if isinstance(value, float) else str(value)] for name, value in figures.items()
    ]
    print_table(Table(["figure", "value"], rows, left=["figure"]))


def _figures_of(path: Path, record: Record) -> dict[str, Any]:
    """Of the record and of the line."""
    import numpy as np

    return {
        "record": str(path),
        "n_periods": int(record.meta["good_periods"]),
        "n_spoiled": int(record.meta["spoiled_periods"]),
        "period_samples": record.period_samples,
        "settle_samples": record.settle_samples,
        "fs_hz": record.fs_hz,
        "peak_command": float(abs(record.u).max()),
        "rms_output": float(np.sqrt(np.mean(record.y[record.valid] ** 2))),
        **{key: int(record.meta[key]) for key in LINE},
    }
