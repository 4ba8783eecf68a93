"""`gsid diagnose` where nothing is missing: held commands, in records that state the hold and that do not."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from study import Cell, Outcome, Study

from gsid.diagnosis.from_records.diagnose import diagnose
from gsid.diagnosis.from_records.hold_check import STAND_IN
from gsid.plant.model import PlantModel
from gsid.records.record import Record

sys.path.append(str(Path(__file__).resolve().parents[1] / "blind"))
ALPHA = 0.05
SEED = 14
FS_HZ, N, N_PERIODS = 3000.0, 3000, 8
LEVELS = (6.0, 20.0)  # command rms, one record of each
TOP_HZ = (190, 450)  # 0.063 of the sample rate, where a held command looks like another, and 0.15


def run(cell: Cell, seed: int) -> Outcome:
    """One null trial; both cells have the same records, so that they differ by the header alone."""
    import trials
    import truth

    rng = np.random.default_rng([SEED, seed])
    base = trials.draw_base(rng, rng.choice(["sensor_lag", ""]))
    noise = trials.Noise.drawn(rng)
    line = np.arange(1, rng.choice(TOP_HZ), 2)  # odd, 1 Hz apart
    records = []
    for level in LEVELS:
        spectrum = np.zeros(N // 2 + 1, complex)
        spectrum[line] = level * np.sqrt(2 / len(line)) * np.exp(2j * np.pi * rng.random(len(line)))
        u = np.fft.irfft(spectrum) * N / 2
        y = noise.measured(rng, truth.steady(base, u, tolerance=1e-4 * noise.std)[0], N_PERIODS)
        records.append(Record(np.tile(u, N_PERIODS), y, FS_HZ, N, 0, hold=cell.setting, y_unit="deg/s"))
    found = diagnose(PlantModel.from_dict(trials.null_model(rng, base)), records, alpha=ALPHA)
    named = {effect for effects in found.found for effect in effects}
    return {
        "p_value": found.p_value,
        "lag or hold named": bool(named & STAND_IN),
        "effect named": found.named,
    }


STUDY = Study(
    name="held_null",
    title="Diagnosis of held commands",
    about=(
        "Null records of the simulator of the blind trials (`docs/explanation/blind.md`): a linear axis "
        "with a flexible mode, half of them behind a gyro with a lag, under commands that are held over each "
        "sample of 3 kHz; two records of 8 periods, at two levels, with excited lines up to 190 or 450 Hz. "
        "`gsid diagnose` gets the correct model with all values 5 % off. Both cells have the same records. "
        "If a record does not state its hold, the model is rejected only if it fails under both assumptions, "
        "so the level is a bound. A lag, a delay or a sampler must never be named, not even as "
        "the nearest effect."
    ),
    cells=(Cell("hold: zoh", "zoh"), Cell("hold not stated", None, at_most=True)),
    run=run,
    levels=(ALPHA,),
    n_seeds=200,
    n_short=2,
    pooled=False,
    never=("lag or hold named",),
    batch=1,
)
