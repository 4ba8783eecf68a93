"""The whole job on the simulated axis: measured over a serial line, fitted, compared; something found."""

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


@dataclass
class Demo:
    """What was measured and found, what it should have shown, and where the report is."""

    linear: Experiment
    friction: Experiment
    search: Search
    checks: dict[str, bool]
    report: Path

    @property
    def passed(self) -> bool:
        return all(self.checks.values())

    def to_dict(self) -> dict[str, Any]:
        """The numbers of `gsid demo --json`."""
        return {
            "report": str(self.report),
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
        Where records, models and the report are written; made when it is not there.
    seed : int
        Of the axis's noise, and of what is hidden in it.
    on_step : callable
        Told in words what comes next.
    on_progress : callable, optional
        Told how far a run over the serial line is.

    Returns
    -------
    Demo
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    bench = Bench(folder, on_step, on_progress)
    excitation = Multisine.design(FS_HZ, PERIOD, first_half.BAND_HZ, amplitude=first_half.AMPLITUDE)
    linear, friction = first_half.both(bench, excitation, seed)
    search = second_half.hide_and_seek(bench, seed)

    on_step("writing the report")
    page = Report("A simulated gimbal axis: measured, fitted, compared, and what was hidden in it")
    first_half.add_to(page, linear, friction, excitation)
    second_half.add_to(page, search)
    path = page.write(folder / "report.html")
    checks = first_half.checks(linear, friction) | second_half.checks(search)
    return Demo(linear, friction, search, checks, path)
