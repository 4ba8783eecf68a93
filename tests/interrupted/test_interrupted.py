"""Each way to end a run, once; `make interrupted-runs` does it 20 times."""

import numpy as np
import pytest

from interrupted.study import WAYS, run_trial

pytestmark = pytest.mark.xdist_group("clock")  # CONTRIBUTING.md


@pytest.mark.parametrize("way", WAYS)
def test_an_interrupted_run_loses_nothing_and_the_axis_stops(tmp_path, way):
    seed = int(np.random.SeedSequence().generate_state(1)[0])
    trial = run_trial(way, seed, tmp_path)
    print(trial)
    assert trial.is_good, trial
    assert trial.n_due > 0 or trial.after_s < 0.4
