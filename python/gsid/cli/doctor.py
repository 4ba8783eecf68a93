"""gsid doctor"""

from __future__ import annotations

import importlib
import importlib.metadata
import platform
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass

import click

from gsid.base.tables import Table
from gsid.cli.common import EXIT_CRITERION
from gsid.cli.options import json_option
from gsid.cli.output import print_json, print_table

CORES = {"double": "_gsid64", "float": "_gsid32"}
BACKENDS = {
    "fftw": "spectra are then made by the slower streaming core, and `gsid design --optimise` fails",
    "nlopt": "`gsid fit --method ga`, `gsid design --optimise` and fits that end unstable then fail",
    "suitesparse": "fits of many records then use the rotations of gsid itself",
}


@dataclass
class Check:
    """Result of one check."""

    name: str
    ok: bool
    found: str
    hint: str = ""


@click.command(short_help="Check the installation: versions, missing parts, a known system.")
@json_option
@click.pass_context
def doctor(ctx: click.Context, as_json: bool) -> None:
    """Report versions and missing parts with a remedy for each, and measure a known system.

    The exit code is 1 if a part that gsid needs is missing or wrong.
    """
    checks = [
        Check("gsid", True, importlib.metadata.version("gsid")),
        Check("Python", True, f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
        *_packages(),
        *(_core(precision, module) for precision, module in CORES.items()),
        *(_backend(name, hint) for name, hint in BACKENDS.items()),
        _measurement(),
    ]
    good = all(check.ok for check in checks)
    if as_json:
        print_json({"ok": good, "checks": [asdict(check) for check in checks]})
    else:
        rows = [[check.name, "ok" if check.ok else "WRONG", check.found, check.hint] for check in checks]
        print_table(Table(["what", "state", "found", "hint"], rows, left=["what", "state", "found", "hint"]))
    if not good:
        ctx.exit(EXIT_CRITERION)


def _packages() -> Iterator[Check]:
    for requirement in importlib.metadata.requires("gsid") or []:
        name = re.match(r"[\w.-]+", requirement).group()
        extra = re.search(r"extra\s*==\s*['\"]([\w.-]+)", requirement)
        hint = f"optional: `pip install 'gsid[{extra[1]}]'`" if extra else "run `make` in the clone"
        try:
            yield Check(name, True, importlib.metadata.version(name))
        except importlib.metadata.PackageNotFoundError:
            yield Check(name, extra is not None, "not installed", hint)


def _core(precision: str, module: str) -> Check:
    """Load one build of the core and compute a rotation by an eighth of a turn."""
    name = f"core, {precision}"
    try:
        core = importlib.import_module(f"gsid.{module}")
    except ImportError as error:
        return Check(
            name, False, f"does not load: {error}", "run `make` in the clone: it builds the C library"
        )
    table = core.ffi.new("gsid_cplx[8]")
    status = core.lib.gsid_twiddle_fill(8, table)
    error = abs(complex(table[1].re, table[1].im) - (0.5 + 0.5j) * 2**0.5)
    found = core.ffi.string(core.lib.GSID_VERSION).decode()
    return Check(
        name, status == 0 and error < 1e-6, found, "" if error < 1e-6 else "rebuild: `make clean`, `make`"
    )


def _backend(name: str, without: str) -> Check:
    try:
        core = importlib.import_module(f"gsid.{CORES['double']}")
    except ImportError:
        return Check(name, False, "unknown: the core does not load")
    found = core.ffi.string(core.lib.gsid_build_library_version(name.encode())).decode()
    return Check(
        name, bool(found), found or "left out of the build", "" if found else f"{without}; rebuild with it"
    )


def _measurement() -> Check:
    """Measure a first-order low-pass of known response."""
    name, hint = "measurement of a known system", "run `make test`"
    try:
        import numpy as np

        from gsid.records.record import Record
        from gsid.response.estimate import frf

        n, line = 64, np.arange(33)
        spectrum = np.where((line > 0) & (line < 20), np.exp(1j * line**2), 0)
        response = 1 / (1 + 0.3j * line)
        u, y = (np.tile(np.fft.irfft(x * n / 2, n), 3) for x in (spectrum, spectrum * response))
        measured = frf([Record(u, y, 64.0)], period=n, settle=0)
        error = float(np.abs(measured.g - response[measured.line]).max())
    except Exception as error:  # any failure is a result of the check
        return Check(name, False, f"{type(error).__name__}: {error}", hint)
    return Check(name, error < 1e-12, f"error {error:.1e}", "" if error < 1e-12 else hint)
