"""`gsid diagnose` on null records of the blind trials' simulator, with and without `hold: zoh` in the file."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

from study import Cell, Outcome, Study

sys.path.append(str(Path(__file__).resolve().parents[1] / "blind"))
OF_HOLDS = {"motor_lag", "sensor_lag", "transport_delay", "sensor_sample_hold"}
TRIALS_SEED = 14001


def run(cell: Cell, seed: int) -> Outcome:
    """One null trial; both cells see the same records, so that a difference is the header's."""
    import trials

    from gsid.diagnose import diagnose
    from gsid.io import read_record
    from gsid.model import PlantModel
    from gsid.plant import PlantModel

    trial = trials.make_trial(TRIALS_SEED, seed, {"null": 1.0})
