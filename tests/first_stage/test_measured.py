"""The first stage on measured records, and on a public synthetic one: which law, which values, or unknown."""

import numpy as np
import pytest

from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.plant.model import PlantModel
from gsid.records.files import read_record
from gsid.records.record import Record
from measured import DATA


def given(name):
    """A file of the measured records."""
    path = DATA / name
    if not path.exists():
        pytest.skip(f"no measured record {path} (set GSID_DATA)")
    return path


def model(fs_hz, unit, **effects):
    stack = [{"effect": effect, "params": params} for effect, params in effects.items()]
    return PlantModel.from_dict(
        {"gsid_model": 1, "fs_hz": fs_hz, "output": "angle", "angle_unit": unit, "effects": stack}
    )


def test_silverbox_is_a_cubic_spring():
    """The record does not state its hold: the input is band-limited."""
    whole, fs_hz, n = np.load(given("silverbox/Schroeder80mV.npz")), 610.3515625, 1024
    part = slice(10587, 10587 + 11 * n)
    record = Record(whole["u"][part].astype(float), whole["y"][part].astype(float), fs_hz, n)
    start = model(
        fs_hz,
        "m",
        rigid_body={"gain": 2e5},
        viscous_friction={"rate": 20},
        cable_spring={"stiffness": 2e5},
    )
    found = first_stage(record, start, band=(1, 165))
    print(found)
    assert (found.conclusion.kind, found.conclusion.effects) == ("named", ("cubic_spring",))
    assert found.ranking[0].share_kept_out > 0.99
    assert found.cost_per_dof > 1e4  # in units of noise, whatever the weights
    assert 10 < found.ranking[0].cost_per_dof < 200


def test_the_hysteretic_benchmark_is_bouc_wen_with_its_rates():
    """Five periods, and no hold stated: the wrong one has the lower cost without a law."""
    whole = np.load(given("bouc_wen_synthetic/bw.npz"))
    record = Record(whole["u_train"].astype(float), whole["y_train"].astype(float), 750.0, 8192, 0)
    start = model(
        750, "m", rigid_body={"gain": 500}, viscous_friction={"rate": 5}, cable_spring={"stiffness": 25000}
    )
    found = first_stage(record, start)
    print(found, found.ranking[0].params)
    assert (found.conclusion.kind, found.conclusion.effects) == ("named", ("bouc_wen",))
    true = {"stiffness": 25000.0, "unloading": 1.90, "loading": -0.30}
    assert found.ranking[0].params == pytest.approx(true, rel=0.02)


AXIS = {"rigid_body": {"gain": 0.388}, "viscous_friction": {"rate": 2.03}}
LOOP = {"position_velocity_loop": {"kp": 160.18, "kv": 243.45, "rate_samples": 2}}


@pytest.mark.parametrize(("u", "start", "kind"), [("q_ref", LOOP | AXIS, "named"), ("v", AXIS, "nearest")])
def test_emps_has_coulomb_friction_of_the_published_level(u, start, kind):
    """Two laps: by its drive voltage the law leaves 11 % of the torque that the linear model leaves."""
    whole, n = np.load(given("emps/estimation.npz")), 6240
    record = Record(whole[u][n : 3 * n].astype(float), whole["q"][n : 3 * n], 1000.0, n, 0)
    found = first_stage(record, model(1000, "m", **start), band=(0.1, 80))
    print(found)
    assert (found.conclusion.kind, found.conclusion.effects) == (kind, ("coulomb_friction",))
    one = found.ranking[0]
    assert one.params["level"] / one.linear["rigid_body"]["gain"] == pytest.approx(0.580, rel=0.03)


@pytest.mark.parametrize("name", ["A", "B"])
def test_the_motor_bench_is_unknown(name):
    path = given(f"twomass_motor_bench/multisine_{name}.npz")
    start = model(
        2500,
        "rad",
        rigid_body={"gain": 100},
        viscous_friction={"rate": 10},
        flexible_mode={"f_hz": 76, "zeta": 0.02, "residue": 1},
        transport_delay={"delay_s": 5e-4},
    )
    found = first_stage(read_record(path, u="iq_ref", y="theta_motor"), start, band=(11, 250))
    print(found)
    assert found.conclusion.kind in ("unknown", "nearest")
