"""A simulated axis for `gsid run --simulate`: served by a process that ends with this one."""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import time
import tty
from collections.abc import Iterator

import click

from gsid.cli.simulate import server_of, simulate

END_S = 5.0
WAIT_S = 0.01


@contextlib.contextmanager
def simulated_port(options: str) -> Iterator[str]:
    """Serve a simulated axis, and return the path of its port.

    The process that serves it only has the axis's end of the line: the end of this process, however it comes,
    closes the other end, and the server ends too.

    Parameters
    ----------
    options : str
        Those of `gsid simulate`, as typed.
    """
    try:
        words = shlex.split(options)
    except ValueError as error:
        raise click.UsageError(f"--simulate: {error}", click.get_current_context()) from error
    with simulate.make_context("simulate", words, parent=click.get_current_context()) as context:
        for name in ("once", "link", "truth", "log", "as_json"):
            if context.params.pop(name):
                text = f"--simulate has no --{name.removeprefix('as_')}: use `gsid simulate` and --port"
                raise click.UsageError(text, context.parent)
        server, damage_in, damage_out = server_of(**context.params)
    from gsid.rig.server import serve_line

    axis_fd, host_fd = os.openpty()
    tty.setraw(host_fd)
    path = os.ttyname(host_fd)
    child = os.fork()
    if child == 0:
        try:
            os.close(host_fd)
            _leave_terminal()
            os.set_blocking(axis_fd, False)
            serve_line(server, axis_fd, -1, damage_in, damage_out, False)
        finally:
            os._exit(0)
    os.close(axis_fd)
    try:
        yield path
    finally:
        os.close(host_fd)
        _end(child)


def _leave_terminal() -> None:
    """Signals to the group of the run, such as Ctrl-C, must reach the axis as STOP only."""
    os.setsid()
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT"):
        signal.signal(getattr(signal, name), signal.SIG_DFL)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)


def _end(child: int) -> None:
    end = time.monotonic() + END_S
    while os.waitpid(child, os.WNOHANG) == (0, 0):
        if time.monotonic() > end:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return
        time.sleep(WAIT_S)
