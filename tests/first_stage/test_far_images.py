"""The response to a held command in the first stage, against the matrix exponential of the axis."""

import linear_axes as axes
import missing_linear_study as study
import numpy as np
import pytest

import gsid
from gsid.base.zero_order_hold import hold_factor
from gsid.diagnosis.missing_torque.far_images import FarImages
from gsid.diagnosis.missing_torque.problem import Problem, linear_part
from gsid.diagnosis.missing_torque.settings import DEFAULTS
from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.spectrum.realisation import spectra_of

SEED = 5324


def records_of(trial):
    return [gsid.Record(u, y, trial.fs_hz, trial.period_samples, 0, hold="zoh") for u, y in trial.records]


@pytest.mark.parametrize("effect", axes.EFFECTS)
@pytest.mark.parametrize("index", range(4))
def test_the_response_is_that_of_the_matrix_exponential(effect, index):
    """With a delay of whole samples all images have one sign: those beyond the last are x^2 / 125 at x fs."""
    print("seed", SEED, effect, index)
    trial = axes.drawn(SEED, effect, index)
    problem = Problem(study.model_of(trial, trial.axis), spectra_of(records_of(trial)), None, DEFAULTS)
    part = linear_part(study.model_of(trial, trial.axis))
    lines = problem.first[0]
    expected = axes.response(trial.axis, lines.f_hz, trial.fs_hz, trial.output, "zoh")
    found = problem.responses(part, DEFAULTS.images)[0][0]
    most = 2 / DEFAULTS.images_far * (lines.f_hz / trial.fs_hz) ** 2
    assert np.all(np.abs(found / expected - 1) < most + 1e-8)


@pytest.mark.parametrize("delay", [0.0, 0.4, 17.99])
def test_the_nodes_show_all_images(delay):
    """A body behind a lag of 0.3 samples, and a mode above the sample rate."""
    fs_hz, f_hz = 1000.0, np.linspace(1.0, 499.0, 300)

    def command(f, hold):
        s = 2j * np.pi * f
        mode = 0.1 * s / (s**2 + 2 * 0.02 * 9000 * s + 9000**2)
        return hold * (1 / s + mode) / (1 + 3e-4 * s) * np.exp(-s * delay / fs_hz)

    images = [f_hz + m * fs_hz for m in range(-40, 41) if abs(m) > 3]
    expected = sum(command(f, hold_factor(f, fs_hz)) for f in images)
    found = FarImages(f_hz, fs_hz, 3, 40).sum(command, delay / fs_hz)
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.max(np.abs(expected)))


def test_bug_a_lag_was_hidden_by_the_images_that_were_left_out():
    """Of 0.025 samples, with a noise of a few ten thousandths: three images on each side took its place."""
    trial = axes.drawn(5322, "lag", 80)
    start = trial.start(np.random.default_rng([5, trial.period_samples]), 0.05)
    stage = first_stage(records_of(trial), study.model_of(trial, start))
    assert set(stage.conclusion.effects) == {"motor_lag", "sensor_lag"}
    assert stage.ranking[0].drop > 100
