"""Bodies compared with dry friction along the measured motion, against another simulator."""

from dataclasses import replace

import axes
import numpy as np
import pytest
from scipy.signal import max_len_seq

import gsid
from gsid.structure.elements import Structure, Values
from gsid.structure.friction import rivals, with_friction
from gsid.structure.held_sensor import measurement
from gsid.structure.projection import refine
from gsid.structure.select import Candidate, select
from gsid.structure.settings import StructureSettings

SEED = 20261123
LEVEL = 0.2 * axes.DRIVE  # unit of the command
ANY = 30.0  # odds [nats] that leave two bodies where the data decide
DECIDED = "decided between structures"


def soft(**changes):
    """A resonance of the spring at 1.1 Hz, between the first line of 0.5 Hz and the second, and friction."""
    body = {"gain": 12.0, "rate": 6.0, "stiffness": (2 * np.pi * 1.1) ** 2, "coulomb": 0.2}
    return axes.Axis(**({"modes": [(90.0, 0.02, 0.2)], "lag_s": 0.0, "delay_s": 3e-3} | body | changes))


def recorded(axis, rng, **how):
    u, y = axes.measured(axis, rng, **how)
    return gsid.Record(u, y, axes.FS_HZ, axes.N, 0, hold="zoh", u_unit="A")


def selected(records, **settings):
    source = measurement(records, None, None, None, None)
    measured = source.total_variance()
    return select(measured, "zoh", settings=StructureSettings(**settings)), measured, source


@pytest.mark.parametrize("seed", [0, 2])
def test_bug_friction_hid_a_spring_with_one_line_below_it(seed):
    """The simpler body was chosen: the best linear approximation does not decide."""
    print("seed", SEED, seed)
    before, measured, source = selected([recorded(soft(), np.random.default_rng([SEED, seed]))])
    assert before.chosen.structure.body == "viscous"
    after = with_friction(before, measured, source)
    assert after.chosen.structure == Structure("rate", "sprung", 1, 0, False)
    assert after.friction == pytest.approx(LEVEL, rel=0.05)
    assert "viscous" not in [one.structure.body for one in after.likely]


def test_the_values_remain_those_of_the_best_linear_approximation():
    rng = np.random.default_rng([SEED, 0])
    before, measured, source = selected([recorded(soft(), rng)])
    after = with_friction(before, measured, source)
    fitted = {one.structure: one.fitted for one in before.likely}
    assert all(one.fitted is fitted[one.structure] for one in after.likely)
    assert after.data is before.data


def test_lags_and_modes_keep_the_scores_of_the_best_linear_approximation():
    rng = np.random.default_rng([SEED, 0])
    before, measured, source = selected([recorded(soft(), rng)], odds=ANY)
    after = with_friction(before, measured, source)
    plain = {one.structure: one.score for one in before.likely}
    own = after.chosen.structure
    assert own == Structure("rate", "sprung", 1, 0, False)
    others = [one for one in after.likely if one.structure.body == "sprung" and one.structure != own]
    assert others
    for one in others:
        assert one.score - after.chosen.score == pytest.approx(plain[one.structure] - plain[own])


def test_a_viscous_body_with_friction_stays_viscous():
    rng = np.random.default_rng([SEED, 10])
    before, measured, source = selected([recorded(soft(stiffness=0.0, rate=15.0), rng)])
    assert {one.structure.body for one in rivals(before)} == {"viscous", "sprung"}
    after = with_friction(before, measured, source)
    assert after.chosen.structure == before.chosen.structure == Structure("rate", "viscous", 1, 0, False)
    assert after.friction == pytest.approx(LEVEL, rel=0.05)


def test_bug_a_spring_without_stiffness_won_by_the_errors_of_its_motion():
    """Each body had its own motion, and they did not converge together: a viscous body lost by 35 nats."""
    rng = np.random.default_rng([18, 20, 45])
    before, measured, source = selected([recorded(axes.drawn(rng, 0.2), rng)])
    assert {one.structure.body for one in rivals(before)} == {"viscous", "sprung"}
    after = with_friction(before, measured, source)
    assert after.friction == pytest.approx(LEVEL, rel=0.05)
    assert after.chosen.structure == Structure("rate", "viscous", 2, 0, False)
    (other,) = [one for one in after.likely if one.structure.body == "sprung" and one.structure.n_lags == 0]
    one_parameter = np.log(2 * len(measured)) / 2
    assert other.score - after.chosen.score == pytest.approx(one_parameter, rel=0.5)


def test_realisations_with_lines_and_levels_of_their_own_have_one_friction():
    rng = np.random.default_rng([SEED, 20])
    records = []
    for first, coulomb in ((1, 0.2), (3, 0.1)):
        u, y = axes.measured(soft(coulomb=coulomb), rng, lines=np.arange(first, axes.LINE_MAX + 1, 4))
        larger = 0.2 / coulomb  # the axis is the same: only the drive differs
        records.append(gsid.Record(u * larger, y * larger, axes.FS_HZ, axes.N, 0, hold="zoh"))
    before, measured, source = selected(records, odds=ANY)
    assert before.chosen.structure.body == "viscous"
    assert np.allclose(measured.share.sum(axis=0), 1)
    assert np.all((measured.share > 0).sum(axis=0) == 1)
    after = with_friction(before, measured, source)
    assert after.chosen.structure.body == "sprung"
    assert after.friction == pytest.approx(LEVEL, rel=0.05)


def test_an_axis_without_friction_shows_none():
    rng = np.random.default_rng([SEED, 30])
    before, measured, source = selected([recorded(soft(coulomb=0.0, stiffness=0.0), rng)])
    numbers = before.chosen.fitted.values.numbers()
    sprung = refine(Values.of(**{**numbers, "body": (numbers["body"][0], 1.0)}), before.data)
    before = replace(before, likely=[before.chosen, Candidate(sprung, before.chosen.score + 3.0, "")])
    assert len(rivals(before)) == 2
    assert with_friction(before, measured, source) is before


def test_no_motion_in_a_closed_loop_and_behind_a_held_sensor():
    rng = np.random.default_rng([SEED, 40])
    before, measured, source = selected([recorded(soft(), rng)])
    closed = replace(source, reference="r")
    assert with_friction(before, measured, closed) is before
    assert with_friction(before, replace(measured, sensor_rate_hz=500.0), source) is before
    assert with_friction(before, replace(measured, smooth_phases=True), source) is before


def test_start_reports_the_friction_that_decided():
    rng = np.random.default_rng([SEED, 0])
    found = gsid.start(recorded(soft(), rng))
    assert "cable_spring" in found.effects
    (text,) = [text for text in found.assumed if DECIDED in text]
    assert float(text.split()[3]) == pytest.approx(LEVEL, rel=0.05)
    assert text.split()[4] == "A"


def test_bug_a_period_of_odd_length_with_all_lines_excited_was_an_internal_error():
    """A pseudo-random binary sequence of 1023 samples: its line 511 is below half of the sample rate."""
    n, fs_hz = 1023, 1000.0
    rng = np.random.default_rng([SEED, 1])
    line = np.arange(1, n // 2 + 1)
    s = 2j * np.pi * line * fs_hz / n
    command = 2.0 * max_len_seq(10)[0] - 1.0
    lines = np.zeros(n // 2 + 1, complex)
    lines[line] = np.fft.rfft(command)[line] * np.exp(-2e-3 * s) / ((s + 30.0) * (1 + 1.2e-3 * s))
    y = np.tile(np.fft.irfft(lines, n), 6)
    y += 0.02 * y.std() * rng.standard_normal(len(y))
    record = gsid.Record(np.tile(command, 6), y, fs_hz, n, 0, hold="none", y_unit="deg/s")
    source = measurement([record], None, None, None, None)
    measured = source.total_variance()
    assert measured.line[-1] == n // 2
    found = select(measured, "none", ("rate",))
    theta = found.chosen.fitted.values.theta
    sprung = Values(Structure("rate", "sprung", 0, 1, False), np.insert(theta, 1, 0.0))
    rival = Candidate(refine(sprung, found.data), found.chosen.score + 1, "")
    found = replace(found, likely=[found.chosen, rival])
    assert len(rivals(found)) == 2
    assert with_friction(found, measured, source).chosen.structure.body == "viscous"
