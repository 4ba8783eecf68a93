"""Blind trials with the tool itself, of effects that need a search of their own; more by `make blind`."""

import math

import numpy as np
import pytest
import score
import trials
import truth

from gsid.base.deadline import Deadline
from gsid.diagnosis.from_records.play import fit_play
from gsid.greybox.fit import fit_plant
from gsid.greybox.linear_start import linear_start
from gsid.models.load import load_model
from gsid.records.files import read_record
from gsid.spectrum.realisation import spectra

SEED = 11  # a development seed


@pytest.mark.trial
@pytest.mark.parametrize("effect", ["gear_backlash", "sensor_sample_hold", "hard_stop"])
def test_what_is_hidden_is_in_the_first_group(effect, tmp_path, monkeypatch):
    """Bugs: backlash had no start, a sensor rate was missed between the rates tried, a stop was found on the
    wrong one of two orbits."""
    monkeypatch.setattr(trials, "_choose", lambda rng, kind: [effect])
    monkeypatch.setattr(trials, "TARGETS", (1024.0,))
    trial = trials.make_trial(SEED, 0, {"single": 1.0})
    print(f"seed {SEED}, hidden {trial.key['effects']}, drop {trial.key['predicted_drop']}")
    said = score.gsid_tool(trials.write_trial(trial, tmp_path))
    assert effect in said["ranking"][0]["effects"]
    assert said["verdict"] == "missing_effect"
    # The large trials ask for 1.1 in 19 of 20; one alone may be the twentieth.
    assert said["error_over_floor"] < 1.5


@pytest.mark.trial
def test_a_large_backlash_is_fitted_past_its_walls(tmp_path):
    """A bug: this gear's fit ended at a wall of one record's cost, 2 % from the truth with 4.6 per degree of
    freedom, and effects that are not there were added to it."""
    trial = trials.make_trial(1013, 18, {"single": 1.0})
    place = trials.write_trial(trial, tmp_path)
    measured = [spectra(read_record(path)) for path in sorted(place.glob("fit_*.npz"))]
    null = load_model(place / "null.json")
    without = fit_plant(linear_start(null, measured), measured, max_iter=1)
    found = fit_play(without, null, measured, None, math.inf, Deadline())
    truth_ratio = trial.key["effects"][0]["params"]["inertia_ratio"]
    assert found.cost_per_dof < 1.1  # 0.94 at the truth
    assert (
        abs(found.model["gear_backlash.inertia_ratio"].value / truth_ratio - 1) < 0.01
    )  # its deviation is 0.06 %


def test_the_size_returned_is_the_one_that_was_judged(monkeypatch):
    """A bug: a sensor of 2000 Hz, which a lag imitates, went out with the drop of 1999 Hz."""
    judged = []

    class Nulls:
        def __init__(self):
            self.base = {}

        def refit(self, ys):
            judged.append(ys[0])
            return float(1 + 100 * (len(judged) % 2)), None, None  # a drop that never comes near the target

    class Bench:
        def answers(self, params, n_steps, which):
            return [(params["size"],)]

    hidden = trials.Hidden(lambda size: {"size": size}, 1.0, 100.0)
    size, *_ = trials.calibrate(Nulls(), hidden, Bench(), 1, 20.0)
    assert size == judged[-1]


def null_lines(nulls):
    """The null's own answers as spectra of a period, so that its refit has to come back to the truth."""
    f_hz = np.arange(trials.N // 2 + 1) * trials.FS_HZ / trials.N
    response = np.zeros(len(f_hz), complex)
    response[nulls.lines] = truth.linear_response(nulls.base, f_hz[nulls.lines])
    return nulls.u * response * trials.N / 2


def test_a_refit_that_lost_the_resonance_finds_it_again():
    """A bug: a sensor of 750 Hz went out with a drop of 87 419; its null had settled 2200 residues away."""
    rng = np.random.default_rng(SEED)
    base = trials.draw_base(rng, None)
    lines, commands = trials.draw_commands(rng, base, 1)
    nulls = trials.Nulls(base, lines, commands, np.ones((len(commands), trials.N // 2 + 1)), 8)
    nulls.scale = np.where([name.startswith("mode") for name in nulls.free], 50.0, 1.0)
    here = [np.fft.irfft(spectrum) for spectrum in null_lines(nulls)]
    drop, *_ = nulls.refit(here)
    assert drop < 1e-6
