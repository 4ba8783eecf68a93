"""The group of verbs. Only this file turns exceptions into messages and exit codes."""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import sys
import traceback
from collections.abc import Callable, Sequence

import click
from click.exceptions import NoArgsIsHelpError, NoSuchCommand, NoSuchOption

from gsid.base.errors import GsidError, InputError, SimulationError
from gsid.cli.common import EXIT_GOOD, EXIT_INPUT, EXIT_INTERNAL, EXIT_INTERRUPT, EXIT_USAGE, HELP_NAMES
from gsid.cli.in_study import StudyStep
from gsid.cli.options import library_option
from gsid.cli.output import MESSAGES, PROGRESS, print_message

VERBS = {
    "design": "Make a periodic excitation.",
    "simulate": "Serve a simulated gimbal axis on a serial line.",
    "gimbal": "Measure a simulated gimbal of four axes, with several inputs at once.",
    "run": "Drive an axis over a serial line and record it.",
    "look": "Show what is in a record: samples, period, lost samples, lines, drift, spikes.",
    "cut": "Write a part of a record as a record.",
    "noise": "Measure the noise spectrum and find periodic disturbances.",
    "frf": "Measure the frequency response and its variance from records.",
    "join": "Join bands measured apart to one response, and test that they agree.",
    "plot": "Draw several responses and their uncertainties in one picture.",
    "distortion": "Separate noise from nonlinear distortion in a frequency response.",
    "fit": "Fit a rational model, or a stack of effects, to records.",
    "start": "Find the linear structure of an axis from its records.",
    "compare": "Test whether a model is adequate, and show the bands where it fails.",
    "predict": "Show the output of a model beside the measured output, over time.",
    "effects": "List the catalogue of physical effects.",
    "diagnose": "Find the physical effects that a model of an axis lacks.",
    "add": "Add an effect to a model and report how much the error falls.",
    "export-c": "Write a model as C for firmware.",
    "next": "Propose the next excitation, from what was measured.",
    "fleet": "Run one recipe over many units, and compare the units.",
    "report": "Write a report as one HTML page.",
    "open": "Copy files into a study, the folder of -C DIR.",
    "script": "Write the script that repeats a study, in Python or as commands.",
    "studio": "Open a page to identify and diagnose by clicks.",
    "demo": "Measure the simulated axis and find the effect hidden in it.",
    "doctor": "Check the installation: versions, missing parts, a known system.",
}


class Verbs(click.Group):
    """Import a verb when it is used, not to list it."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(VERBS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in VERBS:
            return None
        word = name.replace("-", "_")
        return getattr(importlib.import_module(f"gsid.cli.{word}"), word)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] not in VERBS and not args[0].startswith("-"):
            raise NoSuchCommand(args[0], possibilities=VERBS, ctx=ctx)
        if ctx.params.get("folder") is not None and ctx.obj is not None:
            args = ctx.obj.begin(ctx, ctx.params["folder"], args)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Verbs"):
            formatter.write_dl(list(VERBS.items()))


@click.group(
    cls=Verbs,
    context_settings={"help_option_names": HELP_NAMES, "max_content_width": 110},
    epilog="`gsid demo` shows the whole loop; `gsid diagnose REC...` starts from your own records.\n\n"
    "`-o -` writes to the standard output.\n\n"
    "Exit codes: 0 good, 1 a requested criterion is not met, 2 usage, 3 bad input, 4 internal error.",
)
@click.version_option(package_name="gsid", prog_name="gsid", message="%(prog)s %(version)s")
@library_option(
    "Load an effect compiled from C that a model file names. This runs its code.", "libraries", multiple=True
)
@click.option(
    "-C",
    "folder",
    metavar="DIR",
    type=click.Path(),
    help="Run the verb in the study DIR: with its last records and newest model, for results in its folders.",
)
def gsid(libraries: Sequence[tuple[str, str]], folder: str | None) -> None:
    """Measure a servo axis, fit a model, and find the physical effects that the model lacks."""
    if libraries:
        from gsid.effects.custom import load

        for path, name in libraries:
            load(path, name)


def main(argv: list[str] | None = None) -> int:
    """Run the command.

    Parameters
    ----------
    argv : list of str, optional
        Arguments without the program's name; default those of the process.

    Returns
    -------
    int
        Exit code: 0 good, 1 a requested criterion is not met, 2 usage, 3 bad input, 4 internal.
    """
    _log_to_stderr()
    _use_one_thread_for_algebra()
    MESSAGES.clear()
    step = StudyStep()
    try:
        return _exit_code(lambda: step.end(_exit_code(lambda: _run(argv, step))))
    finally:
        with contextlib.suppress(OSError):  # the folder was deleted
            step.leave()


def _exit_code(run: Callable[[], int]) -> int:
    """Run, and turn an exception into a message and an exit code."""
    try:
        return run()
    except click.UsageError as error:
        _usage(error)
        return EXIT_USAGE
    except InputError as error:
        place = [error.where] if error.where else []
        where = ": ".join([*place, *([] if error.value is None else [str(error.value)])])
        _error(error.what, where, error.hint or "repair the file, or name another file")
        return EXIT_INPUT
    except (BrokenPipeError, SystemExit):  # the reader closed the pipe; click exits
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_GOOD
    except (OSError, click.FileError) as error:
        where = getattr(error, "filename", None) or ""
        _error(
            getattr(error, "strerror", None) or str(error), str(where), "check the name and the permissions"
        )
        return EXIT_INPUT
    except (KeyboardInterrupt, click.Abort):
        print_message("stopped")
        return EXIT_INTERRUPT
    except GsidError as error:
        of_data = isinstance(error, SimulationError) or error.of_data
        hint = "check the files for numbers that are too large or too small" if of_data else ""
        _error(str(error), "", error.hint or hint)
        return EXIT_INPUT if of_data else EXIT_INTERNAL
    except ImportError as error:
        _error(str(error), "", "`gsid doctor` lists what is missing")
        return EXIT_INTERNAL
    except Exception as error:
        _error(
            f"{type(error).__name__}: {error}",
            "",
            "this is a bug in gsid: set GSID_DEBUG=1 to see the traceback",
        )
        return EXIT_INTERNAL


def _run(argv: list[str] | None, step: StudyStep) -> int:
    try:
        if os.environ.get(PROGRESS, "") not in ("", "json"):
            raise click.UsageError(f"{PROGRESS} is {os.environ[PROGRESS]}: json is the one value that it has")
        result = gsid.main(args=argv, prog_name="gsid", standalone_mode=False, obj=step)
        sys.stdout.flush()
        return result if isinstance(result, int) else EXIT_GOOD
    except Exception:
        if os.environ.get("GSID_DEBUG") == "1":
            traceback.print_exc()
        raise


def _use_one_thread_for_algebra() -> None:
    """Keep OpenBLAS to one thread unless the user set a number; it reads it when NumPy is imported.

    The matrices of a fit are small: threads that wait for each other cost more than they calculate.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


class _Printed(logging.Handler):
    """Prints as the verbs do: messages contain names of files, columns and topics."""

    def emit(self, record: logging.LogRecord) -> None:
        print_message(self.format(record))


def _log_to_stderr() -> None:
    """Print the messages that the library logs on stderr, each message once."""
    printed: set[str] = set()

    def is_new(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        if text in printed:
            return False
        printed.add(text)
        return True

    logging.addLevelName(logging.INFO, "note")
    logging.addLevelName(logging.WARNING, "warning")
    handler = _Printed()
    handler.setFormatter(logging.Formatter("%(levelname)s: %(message)s"))
    handler.addFilter(is_new)
    logger = logging.getLogger("gsid")
    logger.handlers = [handler]
    logger.setLevel(logging.INFO)
    logger.propagate = False


def _usage(error: click.UsageError) -> None:
    if isinstance(error, NoArgsIsHelpError):
        for line in error.format_message().splitlines():
            print_message(line)
        return
    close = getattr(error, "possibilities", None)
    command = error.ctx.command_path if error.ctx else "gsid"
    what = error.message if close else error.format_message()
    hint = getattr(error, "hint", "")
    if isinstance(error, NoSuchOption) and error.option_name == "--plot":
        hint = f"verbs with --plot: {', '.join(_verbs_that_draw())}; `gsid report` writes a page of pictures"
    if not hint:
        meant = f"did you mean {' or '.join(close)}? " if close else ""
        hint = f"{meant}see `{command} --help`"
    _error(what.rstrip("."), command, hint)


def _verbs_that_draw() -> list[str]:
    commands = {verb: gsid.get_command(click.Context(gsid), verb) for verb in VERBS}
    return [verb for verb, one in commands.items() if any("--plot" in p.opts for p in one.params)]


def _error(what: str, where: str, hint: str) -> None:
    print_message(what, "error:", "red")
    if where:
        print_message(f"  where: {where}")
    if hint:
        print_message(hint, "  hint:", "cyan")


if __name__ == "__main__":
    sys.exit(main())
