"""gsid doctor"""

from __future__ import annotations

import importlib
import importlib.metadata
import platform
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from email.message import Message
from typing import cast

import click

from gsid.base.tables import Table
from gsid.cli.common import EXIT_CRITERION
from gsid.cli.options import json_option
from gsid.cli.output import print_json, print_table

CORES = {"double": "_gsid64", "float": "_gsid32"}
# Libraries of the C code: licence, and what happens without it.
BACKENDS = {
    "fftw": ("GPL-2.0-or-later", ""),
    "nlopt": (
        "LGPL-2.1-or-later",
        "`gsid fit --method ga`, `gsid design --optimise` and fits that end unstable fail; rebuild with it",
    ),
    "suitesparse": ("GPL-2.0-or-later", ""),
}
# Used instead of a library that is left out, without loss of results.
REPLACED = {"fftw": "left out: numpy transforms", "suitesparse": "left out: rotations of gsid"}


@dataclass
class Check:
    """Result of one check."""

    name: str
    ok: bool
    found: str
    hint: str = ""
    licence: str = ""


@click.command(short_help="Check the installation: versions, missing parts, a known system.")
@json_option
@click.pass_context
def doctor(ctx: click.Context, as_json: bool) -> None:
    """Report versions, licences and missing parts, and measure a known system.

    The exit code is 1 if a part that gsid needs is missing or wrong.
    """
    checks = [
        Check("gsid", True, importlib.metadata.version("gsid"), licence=_licence("gsid")),
        _variant(),
        Check("Python", True, f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
        *_packages(),
        *(_core(precision, module) for precision, module in CORES.items()),
        *(_backend(name, *facts) for name, facts in BACKENDS.items()),
        _measurement(),
    ]
    good = all(check.ok for check in checks)
    if as_json:
        print_json({"ok": good, "checks": [asdict(check) for check in checks]})
    else:
        columns = ["what", "state", "found", "licence", "hint"]
        rows = [[one.name, "ok" if one.ok else "WRONG", one.found, one.licence, one.hint] for one in checks]
        print_table(Table(columns, rows, left=columns))
    if not good:
        ctx.exit(EXIT_CRITERION)


def _packages() -> Iterator[Check]:
    for requirement in importlib.metadata.requires("gsid") or []:
        name = re.match(r"[\w.-]+", requirement).group()
        extra = re.search(r"extra\s*==\s*['\"]([\w.-]+)", requirement)
        hint = f"optional: `pip install 'gsid[{extra[1]}]'`" if extra else "run `make` in the clone"
        try:
            yield Check(name, True, importlib.metadata.version(name), licence=_licence(name))
        except importlib.metadata.PackageNotFoundError:
            yield Check(name, extra is not None, "not installed", hint)


def _licence(package: str) -> str:
    """Return the licence that a package states, or an empty text."""
    try:
        stated = cast(Message, importlib.metadata.metadata(package))
    except importlib.metadata.PackageNotFoundError:
        return ""
    classifiers = [
        text.split(" :: ")[-1] for text in stated.get_all("Classifier", []) if "License ::" in text
    ]
    # `get`: with the package importlib_metadata, as Dask has it, a key that is missing is an error.
    short = (stated.get("License") or "").partition("\n")[0]
    return stated.get("License-Expression") or ", ".join(classifiers) or (short if len(short) < 40 else "")


def _variant() -> Check:
    """Report whether the C code contains a library under the GPL, which then applies to the whole."""
    try:
        found = {name: _library_version(name) for name in BACKENDS}
    except ImportError:
        return Check("variant", False, "unknown: the core does not load")
    gpl = [name for name, version in found.items() if version and BACKENDS[name][0].startswith("GPL")]
    return Check("variant", True, f"with {' and '.join(gpl)} (GPL)" if gpl else "without GPL libraries")


def _library_version(name: str) -> str:
    """Return the version of a library of the C code, or an empty text if it was left out."""
    core = importlib.import_module(f"gsid.{CORES['double']}")
    return core.ffi.string(core.lib.gsid_build_library_version(name.encode())).decode()


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


def _backend(name: str, licence: str, without: str) -> Check:
    try:
        found = _library_version(name)
    except ImportError:
        return Check(name, False, "unknown: the core does not load")
    if found:
        return Check(name, True, found, licence=licence)
    return Check(name, name in REPLACED, REPLACED.get(name, "left out of the build"), without)


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
