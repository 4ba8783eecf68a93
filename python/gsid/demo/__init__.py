"""Demonstration on a simulated axis: measure over a serial line, fit, compare, and find a hidden effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsid.demo import linear as first_half
from gsid.demo import missing as second_half
from gsid.demo.axis import FS_HZ, PERIOD, Bench
from gsid.demo.linear import Experiment
from gsid.demo.missing import Search
from gsid.excitation.multisine import Multisine
from gsid.report import Report
from gsid.rig.run import Progress
from gsid.study.folder import Study


@dataclass
class Demo:
    """Results of the demo, the checks of these results, and the paths of report and study."""

    linear: Experiment
    friction: Experiment
    search: Search
    checks: dict[str, bool]
    report: Path
    study: Path

    @property
    def passed(self) -> bool:
        return all(self.checks.values())

    def to_dict(self) -> dict[str, Any]:
        """The numbers of `gsid demo --json`."""
        return {
            "report": str(self.report),
            "study": str(self.study),
            "passed": self.passed,
            "checks": self.checks,
            "truth": [
                {"name": t.name, "unit": t.unit, "truth": t.truth, "estimate": t.estimate, "std": t.std}
                for t in self.linear.truth
            ],
            "linear": self.linear.comparison.to_dict(),
            "friction": self.friction.comparison.to_dict(),
            "hidden": self.search.to_dict(),
        }


def demo(
    folder: str | Path,
    *,
    seed: int = 1,
    on_step: Callable[[str], None] = lambda text: None,
    on_progress: Callable[[Progress], None] | None = None,
) -> Demo:
    """Measure, fit and compare the simulated axis without and with Coulomb friction; find a hidden effect.

    Parameters
    ----------
    folder : path-like
        Folder of the records, models and report; created if it does not exist.
    seed : int
        Random seed of the noise and of the hidden effect.
    on_step : callable
        Called with a short description of each step before it starts.
    on_progress : callable, optional
        Called with the progress of a run over the serial line.

    Returns
    -------
    Demo
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    bench = Bench(folder, on_step, on_progress)
    excitation = Multisine.design(FS_HZ, PERIOD, first_half.BAND_HZ, amplitude=first_half.AMPLITUDE)
    linear, friction = first_half.both(bench, excitation, seed)
    search = second_half.find_hidden_effect(bench, seed)

    on_step("writing the report")
    page = Report("A simulated gimbal axis with a hidden effect")
    second_half.add_to(page, search)
    first_half.add_to(page, linear, friction, excitation)
    path = page.write(folder / "report.html")
    checks = first_half.checks(linear, friction) | second_half.checks(search)
    return Demo(linear, friction, search, checks, path, _study(folder, seed))


def _study(folder: Path, seed: int) -> Path:
    """A study of the axis with the hidden effect: its records only, for a search by hand."""
    study = Study(folder / f"study{seed}")
    study.open_files(sorted(folder.glob("hidden*.csv")))
    return study.folder
