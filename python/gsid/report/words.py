"""Texts of a report: verdict, facts of the measurement, versions of the software."""

from __future__ import annotations

import platform
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gsid import plots
from gsid._lib import ffi, lib, version
from gsid.models.piecewise import PiecewiseModel
from gsid.plant.model import PlantModel

if TYPE_CHECKING:
    from gsid.comparison import Comparison
    from gsid.excitation.multisine import Multisine
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf


def verdict_of(
    frf: Frf | None, model: RationalModel | PiecewiseModel | PlantModel | None, comparison: Comparison | None
) -> tuple[str, str]:
    """A sentence on the result, and its grade: "good", "bad" or "none"."""
    if comparison is not None:
        return comparison.verdict, "good" if comparison.adequate else "bad"
    if isinstance(model, PlantModel):
        return f"A plant of {len(model.effects)} effects; not compared with a record.", "none"
    if isinstance(model, PiecewiseModel):
        return f"Fitted: models of {len(model.pieces)} adjoining bands; not compared with a record.", "none"
    if model is not None:
        delay = plots.delay_text(model.delay_s, model.fs_hz, model.std_delay_s)
        fitted = (
            f"Fitted: a {plots.order_text(model)} model with a delay of {delay}; not compared with a record."
        )
        return fitted, "none"
    if frf is not None:
        return f"Measured: the frequency response at {len(frf.f_hz)} lines; no model was fitted.", "none"
    return "No frequency response.", "none"


def run_facts(records, spectra, frf: Frf | None, multisine: Multisine | None) -> list[tuple[str, str]]:
    """Facts of the measurement, as name and value."""
    source = frf or (spectra[0] if spectra else None)
    facts = []
    names = [r.name for r in records if r.name] or ([source.name] if source and source.name else [])
    if names:
        facts.append(("Records" if len(names) > 1 else "Record", ", ".join(names)))
    if source is None:
        return facts
    n, fs = source.period_samples, source.fs_hz
    facts += [
        ("Sample rate", f"{fs:g} Hz"),
        ("Period", f"{n} samples ({n / fs:.6g} s), line spacing {fs / n:.4g} Hz"),
        ("Periods", f"{source.n_periods} good, {source.n_spoiled} left out for lost samples"),
        (
            "Settling",
            f"{source.settle_samples} samples ({source.settle_samples / n:.2f} periods) discarded",
        ),
    ]
    if getattr(source, "n_realisations", 1) > 1:
        facts.append(("Realisations", str(source.n_realisations)))
    if multisine is not None:
        facts.append(("Excitation", _excitation_text(multisine)))
    elif frf is not None:
        f = frf.f_hz
        facts.append(("Excitation", f"{len(f)} lines, {f.min():.4g} to {f.max():.4g} Hz"))
    held = {
        "zoh": "held over each sample (zero-order hold)",
        "none": "not held",
        None: "hold not stated",
    }[source.hold]
    facts.append(("Input and output", f"u [{source.u_unit or '-'}], {held}; y [{source.y_unit or '-'}]"))
    return facts


def _excitation_text(m: Multisine) -> str:
    shape = f"{m.shape_db_per_decade:g} dB per decade" if m.shape_db_per_decade else "flat"
    phases = "Schroeder phases" if m.seed is None else f"random phases of seed {m.seed}"
    return (
        f"multisine, {len(m.line)} lines ({m.grid}), {plots.band_text(m.f_hz.min(), m.f_hz.max())}, {shape}, "
        f"{phases}; peak {m.peak:.4g}, rms {m.rms:.4g}, crest factor {m.crest_factor:.3f} on samples, "
        f"{m.crest_factor_fine:.3f} between them"
    )


def command_line() -> str:
    """The command line of this process."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


def versions() -> list[tuple[str, str]]:
    """Names and versions of the software that made the page."""

    def library(name: bytes) -> str:
        return ffi.string(lib.gsid_build_library_version(name)).decode() or "left out of this build"

    return [
        ("gsid", version()),
        ("Python", platform.python_version()),
        ("numpy", np.__version__),
        ("FFTW", library(b"fftw")),
        ("NLopt", library(b"nlopt")),
        ("SuiteSparse", library(b"suitesparse")),
        ("Platform", platform.platform()),
    ]
