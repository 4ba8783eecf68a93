"""The websocket of the workbench: the newest request is answered, none is queued."""

import json

import numpy as np
import pytest
from websockets.sync.client import connect

from gsid.excitation.multisine import Multisine
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.records.files import write_record
from gsid.records.record import Record
from gsid.webpage import workbench

FS, N, SEED, REQUESTS, DEADLINE_S = 3000.0, 3000, 20261123, 200, 120


@pytest.fixture
def bench(server):
    """A connection to the workbench of a study with a record and a model; a function that asks it."""
    print("seed", SEED)
    effects = [
        Effect("rigid_body", {"gain": Param(7.4)}),
        Effect("viscous_friction", {"rate": Param(11.0)}),
        Effect("coulomb_friction", {"level": Param(15.0)}),
    ]
    model = PlantModel(FS, effects, y_unit="deg/s")
    u = Multisine.design(FS, N, (2, 250), rms=20.0, phases="random", seed=SEED).table()
    y = np.tile(model.simulate(u).y, 3) + np.random.default_rng(SEED).normal(0, 0.01, 3 * N)
    record = Record(np.tile(u, 3), y, FS, N, 0, hold="zoh", y_unit="deg/s")
    write_record(server.folder / "records/rec.csv", record)
    model.save(server.folder / "models/2-start.json")
    own = f"127.0.0.1:{server.port}"
    headers = {"Cookie": server.cookie, "Origin": f"http://{own}"}
    with connect(f"ws://{own}/workbench", additional_headers=headers) as connection:
        yield connection


def request_of(serial, **more):
    return json.dumps({"serial": serial, "model": "models/2-start.json", "record": "records/rec.csv", **more})


def answer_of(bench):
    return json.loads(bench.recv(timeout=DEADLINE_S))


def test_the_effects_are_sent_when_the_model_is_another_one(bench):
    bench.send(request_of(1))
    first = answer_of(bench)
    assert first["sheet"][0]["label"] == "rigid_body"
    assert first["fit_percent"] == first["fitted"]["fit_percent"]
    bench.send(request_of(2, values={"coulomb_friction.level": 1.0}))
    moved = answer_of(bench)
    assert "sheet" not in moved
    assert moved["fit_percent"] < first["fit_percent"]
    bench.send(request_of(3, added=[{"law": "c*w^3", "params": {"c": 0.0}}]))
    assert [effect["label"] for effect in answer_of(bench)["sheet"]][-1] == "expression"


def test_requests_that_wait_are_replaced_by_the_newest(bench):
    bench.send(request_of(0))
    answer_of(bench)
    for serial in range(1, REQUESTS + 1):
        bench.send(request_of(serial, values={"coulomb_friction.level": 15.0 + serial}))
    answered = [answer_of(bench)["serial"]]
    while answered[-1] != REQUESTS:
        answered.append(answer_of(bench)["serial"])
    assert answered == sorted(answered)
    assert len(answered) < REQUESTS


def test_after_values_that_cannot_be_simulated_the_sliders_are_there(bench):
    wrong = request_of(1, added=[{"effect": "cubic_spring"}], values={"cubic_spring.stiffness": -1e8})
    bench.send(wrong)
    answer = answer_of(bench)
    assert "cannot be simulated" in answer["error"]
    assert answer["sheet"][-1]["label"] == "cubic_spring"
    bench.send(request_of(2))
    assert answer_of(bench)["fit_percent"] > 90


def test_any_fault_of_a_simulation_is_answered():
    class Broken:
        def answer(self, wanted):
            raise MemoryError("too much")

    found = json.loads(workbench._answered(Broken(), '{"serial": 7}'))
    assert found["serial"] == 7
    assert "MemoryError: too much" in found["where"]
