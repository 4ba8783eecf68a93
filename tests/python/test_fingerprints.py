"""Laws of a ranking beside the missing torque, against the law that was simulated."""

import dataclasses
import json

import numpy as np
import pytest

import gsid
from gsid.diagnosis.from_records.fingerprints import LAWS, _percent, fingerprints
from gsid.excitation.multisine import Multisine
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.records.record import Record

pytestmark = pytest.mark.xdist_group("fingerprints")  # the module's fixture is made once
FS, N, PERIODS, SEED, LEVEL = 1000.0, 2000, 4, 20261123, 20.0


def params(**values):
    return {name: Param(value) for name, value in values.items()}


@pytest.fixture(scope="module")
def found():
    print("seed", SEED)
    linear = PlantModel(
        FS,
        [Effect("rigid_body", params(gain=7.4)), Effect("viscous_friction", params(rate=11.0))],
        y_unit="deg/s",
    )
    axis = linear.with_effect("coulomb_friction", {"level": LEVEL})
    u = Multisine.design(FS, N, (1, 100), rms=20.0, phases="random", seed=SEED).table()
    y = np.tile(axis.simulate(u).y, PERIODS)
    noise = np.random.default_rng(SEED).normal(0, 0.002 * np.std(y), len(y))
    record = Record(np.tile(u, PERIODS), y + noise, FS, N, 0, hold="zoh", y_unit="deg/s")
    return gsid.diagnose_records(record, linear, fast=True)


def test_the_first_law_is_the_one_that_was_simulated_and_follows_the_data(found):
    first, *others = fingerprints(found)
    assert first.law.effects[0] == "coulomb_friction"
    assert first.measured.name == "rate"
    assert first.follows > 0.98
    assert len(others) < LAWS
    assert all(one.follows < first.follows + 0.02 for one in others)


def test_the_curve_of_dry_friction_jumps_by_twice_its_level_where_the_rate_is_zero(found):
    """The linear part takes what is proportional to the rate from the curve, but not the jump."""
    first = fingerprints(found)[0]
    at, torque = first.by_law.at, first.by_law.torque
    near = np.abs(at) < 0.5 * np.max(np.abs(at))
    inside = near & (np.abs(at) > 1.5 * np.diff(at).min())
    columns = np.column_stack([at, np.sign(at), np.ones_like(at)])[inside]
    _, step, _ = np.linalg.lstsq(columns, torque[inside], rcond=None)[0]
    assert -step == pytest.approx(LEVEL, rel=0.15)


def test_both_curves_have_the_same_bins_and_the_entries_are_numbers(found):
    for one in fingerprints(found):
        entry = one.to_dict()
        sizes = {len(entry[key]) for key in ("at", "measured", "std", "by_law")}
        assert len(sizes) == 1
        assert one.measured.name in one.sentence
        json.dumps({key: value for key, value in entry.items() if not isinstance(value, np.ndarray)})


def test_nothing_missing_has_no_fingerprints(found):
    assert fingerprints(dataclasses.replace(found, verdict="adequate")) == []


def test_a_law_of_a_small_share_is_not_presented_as_the_missing_one(found):
    """It "explains 1.158 % of the misfit and follows 99.92 % of the torque": read as a success."""
    first = fingerprints(found)[0]

    def sentence(share):
        law = dataclasses.replace(first.law, share_kept_out=share)
        return dataclasses.replace(first, law=law).sentence

    assert first.follows > 0.5
    assert "explains only 1.158 % of the misfit: it is not what is missing" in sentence(0.01158)
    assert "explains 97 % of the misfit, and its curve over the rate follows" in sentence(0.97)
    assert sentence(float("nan")).startswith("The curve of coulomb_friction over the rate follows")


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (3.3e-15, "less than 0.01 %"),  # bug: "3.331e-13 % of the torque missing there"
        (0.99999999, "more than 99.99 %"),  # bug: 100 %
        (0.9992, "99.92 %"),
        (1.0, "100 %"),
        (0.0, "0 %"),
        (-0.2, "0 %"),
    ],
)
def test_a_share_becomes_neither_0_nor_100_percent_by_rounding(share, text):
    assert _percent(share) == text
