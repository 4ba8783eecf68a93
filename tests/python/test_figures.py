"""Live figures of a run beside the samples that they reduce."""

import json

import numpy as np
import pytest
from line import Loopback, multisine, quiet_axis

from gsid.response.streaming import StreamingFrf
from gsid.rig import figures
from gsid.rig.figures import LINES_MOST, Figures, response_figures
from gsid.rig.run import run
from gsid.rig.server import Server
from gsid.rig.watch import RunLimits

N, PERIODS = 600, 6
LIMITS = RunLimits(command=500.0, travel_deg=90.0, rate=400.0)


def measured(monkeypatch, pictures_hz, lose=lambda kind, tick: False):
    """A whole run in lock-step: its record, its sets of figures, its response."""
    monkeypatch.setattr(figures, "PICTURES_HZ", pictures_hz)
    monkeypatch.setattr(figures, "RESPONSE_S", 0.0)
    sets = []
    frf = StreamingFrf(3000.0, N, np.arange(1, 41))
    live = Figures(frf, LIMITS, N, sets.append)
    record = run(
        Loopback(Server(quiet_axis()), lose),
        multisine(N),
        periods=PERIODS,
        settle=N,
        frf=frf,
        on_progress=live.take,
        limits=LIMITS,
    )
    live.flush()
    return record, json.loads(json.dumps(sets, allow_nan=False)), frf


@pytest.mark.parametrize("pictures_hz", [0.001, 1e9], ids=["one at the end", "one for each block"])
def test_the_extremes_are_those_of_the_samples(monkeypatch, pictures_hz):
    record, sets, _ = measured(monkeypatch, pictures_hz)
    assert (len(sets) > 10) == (pictures_hz > 1)
    ends = [round(end * 3000) for one in sets for end in one["t_s"]]
    assert ends == sorted(set(ends))
    assert sets[-1]["ticks"] == ends[-1] >= len(record)
    for name, values in (("command", record.u), ("rate", record.y)):
        low = [value for one in sets for value in one[name]["low"]]
        high = [value for one in sets for value in one[name]["high"]]
        for first, end, least, most in zip([0, *ends], ends, low, high, strict=False):
            if end <= len(record):
                assert least == pytest.approx(values[first:end].min(), rel=1e-4)
                assert most == pytest.approx(values[first:end].max(), rel=1e-4)
        assert sets[-1]["peaks"][name] == pytest.approx(np.abs(values).max(), rel=1e-4)
    travel = np.cumsum(record.y) / 3000.0
    assert sets[-1]["peaks"]["travel_deg"] == pytest.approx(np.abs(travel).max(), rel=0.02)
    assert sets[-1]["limits"] == {"command": 500.0, "travel_deg": 90.0, "rate": 400.0}


def test_the_response_is_that_of_the_measurement(monkeypatch):
    _, sets, frf = measured(monkeypatch, 1e9)
    responses = [one["response"] for one in sets if "response" in one]
    assert len(responses) >= PERIODS - 2
    found, wanted = responses[-1], frf.result()
    np.testing.assert_allclose(found["magnitude"], np.abs(wanted.g), rtol=1e-4)
    np.testing.assert_allclose(found["std"], np.sqrt(wanted.var_g / 2), rtol=1e-4)
    turns = (np.array(found["phase_deg"]) - np.degrees(np.angle(wanted.g))) / 360
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-4)


def test_many_lines_are_thinned(monkeypatch):
    frf = StreamingFrf(3000.0, 6000, np.arange(1, 2500))
    u = np.random.default_rng(1).normal(size=6000)
    frf.step(np.tile(u, 3), np.tile(u, 3))
    found = response_figures(frf.result())
    assert found["n_lines"] == 2499
    assert 100 < len(found["f_hz"]) <= LINES_MOST
    assert (found["f_hz"][0], found["f_hz"][-1]) == (0.5, 1249.5)


def test_a_lost_sample_leaves_a_gap_and_a_spoiled_period(monkeypatch):
    lost = range(2 * N + 10, 2 * N + 40)
    _, sets, _ = measured(monkeypatch, 1e9, lambda kind, tick: kind == 2 and tick in lost)
    assert (sets[-1]["good"], sets[-1]["spoiled"], sets[-1]["requested"]) == (PERIODS, 1, PERIODS)
    assert sets[-1]["periods"] == [1, 0, 1, 1, 1, 1, 1]


def test_the_time_left_ends_at_zero(monkeypatch):
    _, sets, _ = measured(monkeypatch, 1e9)
    left = [one["left_s"] for one in sets]
    assert left[0] is None
    assert left[-1] == 0
    assert all(value >= 0 for value in left[1:])
