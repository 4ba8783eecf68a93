"""The first stage on a measured oscillator with a cubic spring."""

import numpy as np
import pytest

from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.plant.model import PlantModel
from gsid.records.record import Record
from measured import DATA

SILVERBOX = DATA / "silverbox" / "Schroeder80mV.npz"
FS_HZ, N = 610.3515625, 1024


@pytest.mark.skipif(not SILVERBOX.exists(), reason=f"no measured record {SILVERBOX} (set GSID_DATA)")
def test_silverbox_is_a_cubic_spring():
    """The record does not state its hold: the input is band-limited."""
    whole = np.load(SILVERBOX)
    part = slice(10587, 10587 + 11 * N)
    record = Record(whole["u"][part].astype(float), whole["y"][part].astype(float), FS_HZ, N)
    effects = {
        "rigid_body": {"gain": 2e5},
        "viscous_friction": {"rate": 20},
        "cable_spring": {"stiffness": 2e5},
    }
    model = {"gsid_model": 1, "fs_hz": FS_HZ, "output": "angle", "angle_unit": "m"}
    model["effects"] = [{"effect": effect, "params": params} for effect, params in effects.items()]
    found = first_stage(record, PlantModel.from_dict(model), band=(1, 165))
    print(found)
    assert (found.conclusion.kind, found.conclusion.effects) == ("named", ("cubic_spring",))
    assert found.ranking[0].share_kept_out > 0.99
