"""What the benchmarks share: peers of `make peers`, times taken in turn, figures as JSON or as a table."""

import importlib.metadata
import json
import os
import platform
import subprocess
import sys
import time
import types
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy

from gsid._lib import ffi, lib, version

PEERS = Path(__file__).resolve().parent.parent / "build/peers"
sys.path.append(str(PEERS))


def peer_version(package: str) -> str | None:
    """Version of a package of benchmarks/requirements.txt; None, and a word of it, where it is missing."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        print(f"without {package}: run `make peers` first", file=sys.stderr)
        return None


def best_linear_approximation() -> types.ModuleType:
    """The robust methods of best-linear-approximation.

    The package asks for Python 3.12 because of its loader of data sets alone, which is left out before that.
    """
    loader = "best_linear_approximation._dataloader"
    if sys.version_info < (3, 12) and loader not in sys.modules:
        stand_in = types.ModuleType(loader)
        for name in ("f16", "fine_steering_mirror", "parallel_wiener_hammerstein", "silverbox"):
            setattr(stand_in, f"load_{name}", None)
        sys.modules[loader] = stand_in
    from best_linear_approximation import robust

    return robust


def octave(program: str) -> str | None:
    """What Octave prints, on one core; None where it is not installed."""
    one_core = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            ["octave-cli", "--no-gui", "-q", "--eval", program],
            capture_output=True,
            text=True,
            env=one_core,
            check=False,
        )
    except FileNotFoundError:
        return None
    if done.returncode:
        raise RuntimeError(done.stderr)
    return done.stdout


def versions(*packages: str) -> dict[str, str]:
    """Versions of gsid, of what it stands on, and of the peers that are there."""
    own = {
        "gsid": version(),
        "fftw": ffi.string(lib.gsid_build_library_version(b"fftw")).decode(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
    }
    return own | {name: found for name in packages if (found := peer_version(name))}


def best_seconds(jobs: dict[str, Callable[[], object]], turns: int) -> dict[str, float]:
    """Least processor time of each job [s], the jobs taking turns."""
    best = dict.fromkeys(jobs, float("inf"))
    for _ in range(turns):
        for name, job in jobs.items():
            start = time.process_time()
            job()
            best[name] = min(best[name], time.process_time() - start)
    return best


def show(figures: dict, rows: list[tuple[str, ...]]) -> None:
    """Print the figures as JSON or, with --table, the rows (the first is the head) as the docs have them."""
    if "--table" not in sys.argv[1:]:
        print(json.dumps(figures, indent=2))
        return
    head, *body = rows
    for row in (head, ("---",) * len(head), *body):
        print("| " + " | ".join(row) + " |")
    print("\n" + ", ".join(f"{name} {value}" for name, value in figures["versions"].items()))
