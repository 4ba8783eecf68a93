"""Texts of a report: what was made, facts of the measurement, versions of the software."""

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
    from gsid.diagnosis.ladder import Ladder
    from gsid.excitation.multisine import Multisine
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf
    from gsid.spectrum.spectra import Spectra


def what_was_made(frf: Frf | None, model: RationalModel | PiecewiseModel | PlantModel | None) -> str:
    """A sentence on what was measured or fitted.

    Parameters
    ----------
    frf : Frf or None
    model : RationalModel, PiecewiseModel, PlantModel or None
    """
    if isinstance(model, PlantModel):
        return f"A plant of {len(model.effects)} effects; not compared with a record."
    if isinstance(model, PiecewiseModel):
        return f"Fitted: models of {len(model.pieces)} adjoining bands; not compared with a record."
    if model is not None:
        delay = plots.delay_text(model.delay_s, model.fs_hz, model.std_delay_s)
        return (
            f"Fitted: a {plots.order_text(model)} model with a delay of {delay}; not compared with a record."
        )
    if frf is not None:
        return f"Measured: the frequency response at {len(frf.f_hz)} lines; no model was fitted."
    return "No frequency response."


def error_fall(ladder: Ladder) -> str:
    """How the error on the validation data falls, without a capital and a full stop.

    Parameters
    ----------
    ladder : Ladder
        With at least one step. Steps on different data are not compared: only the last one counts then.
    """
    last = ladder.rungs[-1]
    first = ladder.rungs[0] if len(ladder.levels()) == len(ladder.rungs) + 1 else last
    size = f"{first.held_out['before']:.3g} to {last.held_out['after']:.3g} {last.y_unit}".rstrip()
    floor = f"noise alone leaves {last.noise_floor_rms:.3g}"
    goes = "falls" if last.held_out["after"] < first.held_out["before"] else "goes"
    return f"the rms error on {last.kept_out} {goes} from {size}, where {floor}"


def run_facts(records, spectra, frf: Frf | None, multisine: Multisine | None) -> list[tuple[str, str]]:
    """Facts of the measurement, as name and value."""
    source = frf or (spectra[0] if spectra else None)
    facts = []
    names = [r.name for r in records if r.name] or ([source.name] if source and source.name else [])
    if names:
        facts.append(("Records" if len(names) > 1 else "Record", ", ".join(names)))
    if source is None:
        return facts
    facts += _timing(source)
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


def _timing(source: Frf | Spectra) -> list[tuple[str, str]]:
    """Sample rate, period and settling, as far as they are known: a response may come from a table."""
    n, fs = source.period_samples, source.fs_hz
    facts = [("Sample rate", f"{fs:g} Hz")] if fs and np.isfinite(fs) else []
    if not n or not facts:
        return facts
    return [
        *facts,
        ("Period", f"{n} samples ({n / fs:.6g} s), line spacing {fs / n:.4g} Hz"),
        ("Periods", f"{source.n_periods} good, {source.n_spoiled} left out for lost samples"),
        (
            "Settling",
            f"{source.settle_samples} samples ({source.settle_samples / n:.2f} periods) discarded",
        ),
    ]


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
