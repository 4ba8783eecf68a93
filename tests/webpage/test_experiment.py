"""An experiment of the page on a pseudo-terminal: who stops the axis when what fails, and what is kept.

The log of the simulated axis, another process, has the command in force and the time of each tick. STOP is
one line with the command zero after which no tick follows; the axis's own stop is a row of ticks with zero.
"""

import contextlib
import http.client
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import gsid
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.records.files import read_record
from gsid.study.folder import Study
from gsid.webpage.experiment import experiment_of
from gsid.webpage.live import LiveJob

pytestmark = pytest.mark.xdist_group("clock")  # CONTRIBUTING.md
DEADLINE_S = 120  # of one wait, on a loaded computer
ABSENT_S = 3.0
FORM = {
    "fs": "3000",
    "period": "600",
    "low": "5",
    "high": "500",
    "peak": "20",
    "periods": "500",
    "settle": "1",
    "limit_command": "50",
    "limit_travel_deg": "30",
    "limit_rate": "200",
}


class Browser:
    """A page of the server: its websocket, and its requests."""

    def __init__(self, address, token="", reads=True):
        self.port, given = re.search(r":(\d+)/\?token=(\S+)", address).groups()
        self.origin, self.cookie = f"http://127.0.0.1:{self.port}", ""
        self.cookie = self.answer("GET", f"/?token={given}").headers["Set-Cookie"].split(";")[0]
        self.reads, self.seen, self.state = reads, [], {}
        self.socket = connect(
            f"ws://127.0.0.1:{self.port}/live", origin=self.origin, additional_headers={"Cookie": self.cookie}
        ).__enter__()
        self.socket.send(token)
        self.until(lambda: self.state.get("token"))

    def until(self, condition, timeout=DEADLINE_S):
        """Read messages until the condition holds."""
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, (self.state, self.page_state())
            self.look(0.1)

    def look(self, timeout):
        """Read the messages of this time."""
        end = time.monotonic() + timeout
        with contextlib.suppress(TimeoutError):
            while time.monotonic() < end:
                message = json.loads(self.socket.recv(timeout=max(0.001, end - time.monotonic())))
                if self.reads:
                    self.socket.send("read")
                self.seen += message.pop("figures")
                self.state = message

    def answer(self, method, path, body=None):
        connection = http.client.HTTPConnection("127.0.0.1", int(self.port), timeout=DEADLINE_S)
        headers = {"Cookie": self.cookie, "Origin": self.origin}
        connection.request(method, path, json.dumps(body) if body is not None else "", headers)
        answer = connection.getresponse()
        answer.text = answer.read().decode()
        connection.close()
        return answer

    def post(self, path, body=None):
        answer = self.answer("POST", path, body)
        return answer.status, answer.text

    def page_state(self):
        return json.loads(self.answer("GET", "/state").text)

    def start(self, port, **more):
        """Begin an experiment, and wait for a whole period."""
        form = FORM | {"port": port, "token": self.state["token"]} | more
        assert self.post("/live/run", form) == (200, '{"begun":true}')
        self.until(lambda: self.seen and self.seen[-1]["good"] > 1)

    def ended(self):
        """The step of the run, when the look at its record has ended too."""
        self.until(lambda: not self.state["running"])
        self.until(lambda: self.page_state()["job"] is None)
        return next(one for one in self.page_state()["steps"] if one["verb"] == "run")


@pytest.fixture
def axis(tmp_path):
    """A paced axis in a process of its own: its port, and `applied()`, which ends it and reads its log."""
    log = tmp_path / "axis.csv"
    command = [sys.executable, "-m", "gsid.cli.main", "simulate", "--paced", "--log", str(log)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)

    def applied():
        process.terminate()
        process.wait(timeout=20)
        t_s, tick, u = np.loadtxt(log, delimiter=",", skiprows=1).T
        return t_s, tick, u

    process.port, process.applied, process.log = process.stdout.readline().strip(), applied, log
    yield process
    process.kill()
    process.communicate()


def assert_stop(u):
    """One zero at the end, after a command other than zero."""
    assert u[-1] == 0, "the command is not zero"
    assert np.count_nonzero(u[-50:]) > 25, "the axis stopped by its own timeout"


def stop_of(applied, after_s):
    """Time of STOP after a moment [s].

    The moment is read before the request: STOP may come within 0.3 ms of it.
    """
    t_s, _, u = applied
    assert_stop(u)
    print(f"the STOP frame came {1e3 * (t_s[-1] - after_s):.0f} ms after the request")
    return t_s[-1] - after_s


def record_of(folder):
    (path,) = (Path(folder) / "st/records").glob("*-run.npz")
    return read_record(path)


# ---- stop ------------------------------------------------------------------------------------------------


def test_stop_reaches_the_axis_and_the_record_is_kept(studio, axis, tmp_path):
    process, _ = studio()
    page = Browser(process.address)
    page.start(axis.port)
    begin_s = time.monotonic()
    assert page.post("/stop")[0] == 200
    step = page.ended()
    assert stop_of(axis.applied(), begin_s) > 0
    assert "The step was stopped." in step["words"]
    assert any("good periods" in one for one in step["words"])
    record = record_of(tmp_path)
    assert int(record.meta["good_periods"]) > 1
    assert record.meta["command_zero_confirmed"] == "yes"
    state = page.page_state()
    assert state["records"] == ["records/2-run.npz"]
    assert [one["verb"] for one in state["steps"]] == ["design", "run", "look"]
    assert not (tmp_path / "st/.run.json").exists()


def test_without_a_page_for_3_s_the_run_stops(studio, axis, tmp_path):
    process, _ = studio()
    page = Browser(process.address)
    page.start(axis.port)
    page.socket.close()
    gone_s = time.monotonic()
    other = Browser(process.address)  # watches; it has no control
    assert other.state["control"] == "none"
    step = other.ended()
    assert stop_of(axis.applied(), gone_s) > ABSENT_S - 0.5
    assert "no sign of life for 3 s from the page that holds control" in " ".join(step["words"])
    assert int(record_of(tmp_path).meta["good_periods"]) > 1


def test_a_page_that_hangs_is_no_page(studio, axis, tmp_path):
    process, _ = studio()
    page = Browser(process.address)
    page.start(axis.port)
    page.reads = False
    hangs_s = time.monotonic()
    time.sleep(ABSENT_S + 3)
    assert stop_of(axis.applied(), hangs_s) < ABSENT_S + 3
    page.reads = True
    page.socket.send("read")
    page.ended()
    assert int(record_of(tmp_path).meta["good_periods"]) > 1


def test_a_reload_within_3_s_goes_on(studio, axis):
    process, _ = studio()
    page = Browser(process.address)
    page.start(axis.port)
    for _ in range(2):
        page.socket.close()
        time.sleep(1)
        page = Browser(process.address, page.state["token"])
        assert page.state["control"] == "own"
        page.look(ABSENT_S)
    assert page.state["running"]
    page.post("/stop")
    assert "The step was stopped." in page.ended()["words"]


def test_another_page_watches_takes_control_and_may_always_stop(studio, axis):
    process, _ = studio()
    first, second = Browser(process.address), Browser(process.address)
    first.start(axis.port)
    second.until(lambda: second.seen)
    assert second.state["control"] == "other"
    second.socket.send("take")
    second.until(lambda: second.state["control"] == "own")
    first.until(lambda: first.state["control"] == "other")
    first.socket.close()
    second.look(ABSENT_S + 2)
    assert second.state["running"]
    third = Browser(process.address)
    assert third.post("/stop")[0] == 200
    second.ended()
    assert_stop(axis.applied()[-1])


def test_a_copy_of_a_tab_gets_no_control(studio):
    process, _ = studio()
    page = Browser(process.address)
    assert Browser(process.address, page.state["token"]).state["token"] != page.state["token"]


def test_stop_before_the_axis_moves_begins_no_run(studio, axis):
    process, _ = studio()
    page = Browser(process.address)
    form = FORM | {"port": axis.port, "token": page.state["token"]}
    assert page.post("/live/run", form)[0] == 200
    page.until(lambda: page.state["running"])  # the excitation is designed
    assert page.post("/stop")[0] == 200
    page.until(lambda: not page.state["running"])
    assert [one["verb"] for one in page.page_state()["steps"]] == ["design"]
    assert page.page_state()["job"] is None
    axis.terminate()
    axis.wait(timeout=20)
    assert axis.log.read_text() == "t_s,tick,u\n"  # not a tick


# ---- what fails ------------------------------------------------------------------------------------------


def test_the_end_of_the_server_by_force_stops_the_axis(studio, axis, tmp_path):
    process, _ = studio()
    page = Browser(process.address)
    page.start(axis.port)
    killed_s = time.monotonic()
    process.kill()
    wait_for_record(tmp_path)
    assert stop_of(axis.applied(), killed_s) > 0
    assert int(record_of(tmp_path).meta["good_periods"]) > 1
    page = Browser(studio()[0].address)  # the next server
    state = page.page_state()
    assert state["records"] == ["records/2-run.npz"]
    assert "The server ended during this run" in state["steps"][-1]["words"][0]
    assert "records/2-run.npz" in state["steps"][-1]["words"][1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda one: one.name)
def test_the_end_of_the_server_stops_the_axis(studio, axis, tmp_path, number):
    process, _ = studio()
    page = Browser(process.address)
    page.start(axis.port)
    begin_s = time.monotonic()
    process.send_signal(number)
    process.wait(timeout=DEADLINE_S)
    assert stop_of(axis.applied(), begin_s) > 0
    assert int(record_of(tmp_path).meta["good_periods"]) > 1


def test_a_server_that_hangs_stops_the_axis_after_3_s(studio, axis, tmp_path):
    process, _ = studio()
    page = Browser(process.address)
    page.start(axis.port)
    begin_s = time.monotonic()
    process.send_signal(signal.SIGSTOP)
    try:
        wait_for_record(tmp_path)
    finally:
        process.send_signal(signal.SIGCONT)
    assert stop_of(axis.applied(), begin_s) > ABSENT_S - 0.5


def test_a_run_that_is_killed_leaves_the_axis_to_its_own_timeout(studio, axis, tmp_path):
    process, _ = studio()
    page = Browser(process.address)
    page.start(axis.port)
    killed_s = time.monotonic()
    os.kill(run_of(process.pid), signal.SIGKILL)
    step = page.ended()
    words = " ".join(step["words"])
    assert step["failed"]
    assert "ended by SIGKILL" in words
    assert "check that the axis stands still" in words
    page.until(lambda: page.page_state()["records"])
    assert int(record_of(tmp_path).meta["good_periods"]) > 1  # of the journal
    t_s, _, u = axis.applied()
    assert u.any()
    zero_s = t_s[np.flatnonzero(u)[-1]] - killed_s
    print(f"the command was zero {1e3 * zero_s:.0f} ms after the end of gsid run")
    assert np.count_nonzero(u[-50:]) == 0, "something else stopped the axis"


def test_a_line_that_is_gone_has_a_sentence_and_a_record(studio, axis, tmp_path):
    process, _ = studio()
    page = Browser(process.address)
    page.start(axis.port)
    axis.kill()
    step = page.ended()
    assert "the port is gone" in step["words"][0]
    assert any("check cable and power of the axis" in one for one in step["words"])
    assert int(record_of(tmp_path).meta["good_periods"]) > 1


def test_a_limit_that_is_exceeded_stops_the_axis_and_has_a_sentence(studio, axis, tmp_path):
    process, _ = studio()
    page = Browser(process.address)
    form = FORM | {"port": axis.port, "token": page.state["token"], "limit_rate": "0.5"}
    assert page.post("/live/run", form)[0] == 200
    page.until(lambda: any(one["verb"] == "run" for one in page.page_state()["steps"]))
    step = page.ended()
    words = " ".join(step["words"])
    assert "the axis exceeds a limit: stopped" in step["words"][0]
    assert "limit 0.5" in words
    assert "lower the amplitude" in words
    assert_stop(axis.applied()[-1])


# ---- what is shown ---------------------------------------------------------------------------------------


def test_the_simulated_axis_gives_a_record_that_is_looked_at(studio):
    process, _ = studio()
    page = Browser(process.address)
    form = FORM | {"port": "simulated", "token": page.state["token"], "periods": "20", "lock_step": True}
    assert page.post("/live/run", form)[0] == 200
    page.until(lambda: len(page.page_state()["steps"]) == 3)
    design, run, look = page.page_state()["steps"]
    assert "lines" in design["words"][0]
    assert run["words"][0] == "Measured records/2-run.csv: 20 good periods, 0 lost."
    assert look["words"][0].startswith("2-run.csv: 12600 samples at 3000 Hz")
    assert not any(one["failed"] for one in (run, look))
    assert "--attended" not in run["command"]  # typed again, it needs no page
    page.look(1)
    newest = page.seen[-1]
    assert (newest["good"], newest["requested"]) == (20, 20)
    assert newest["ticks"] >= 12600
    response = [one["response"] for one in page.seen if "response" in one][-1]
    assert len(response["f_hz"]) == len(response["std"]) == response["n_lines"] == 100
    late = Browser(process.address)
    late.look(1)
    assert late.seen[-1] == newest
    assert [one for one in late.seen if "response" in one][-1]["response"] == response


def test_the_simulated_axis_is_that_of_a_model_of_the_study(studio, tmp_path):
    process, _ = studio()
    effects = [Effect("rigid_body", {"gain": Param(3.7)}), Effect("viscous_friction", {"rate": Param(40.0)})]
    (tmp_path / "new").mkdir()
    PlantModel(3000.0, effects, y_unit="deg/s").save(tmp_path / "new" / "my axis.json")
    name = Study(tmp_path / "st").add_file(tmp_path / "new" / "my axis.json", kind="models")
    page = Browser(process.address)
    form = FORM | {"port": "simulated", "token": page.state["token"], "periods": "20", "lock_step": True}
    assert name in json.loads(page.answer("GET", "/live/form").text)["models"]
    assert page.post("/live/run", form | {"model": "models/none.json"})[0] == 400
    assert page.post("/live/run", form | {"model": name})[0] == 200
    page.until(lambda: len(page.page_state()["steps"]) == 3)
    run = page.page_state()["steps"][1]
    assert not run["failed"], run
    found = gsid.frf(gsid.read_record(tmp_path / "st" / "records" / "2-run.csv"))
    wanted = 3.7 / (2j * np.pi * found.f_hz + 40.0)
    low = found.f_hz < 50  # above, the step of a sample matters
    assert np.all(np.abs(found.g[low] / wanted[low] - 1) < 0.2)


def test_a_spoiled_period_has_a_sentence(studio, axis):
    process, _ = studio()
    page = Browser(process.address)
    page.start(axis.port, periods="12")
    os.kill(run_of(process.pid), signal.SIGSTOP)
    time.sleep(0.6)
    os.kill(run_of(process.pid), signal.SIGCONT)
    step = page.ended()
    assert "Lost samples spoil a period: check cable" in " ".join(step["words"])
    assert page.seen[-1]["spoiled"] >= 1
    assert 0 in page.seen[-1]["periods"]


def test_a_page_that_joins_late_gets_the_last_response_and_10_s_of_figures():
    job = LiveJob(("run",), on_figures=lambda: None)
    for n in range(1, 1001):
        response = ', "response": {"n_lines": 7}' if n == 2 else ""
        job.takes(b'{"live": {"ticks": %d%s}}\n' % (n, response.encode()))
    (first, response), *sets = job.after(0)
    assert (first, json.loads(response)) == (2, {"response": {"n_lines": 7}})
    assert [json.loads(text)["ticks"] for _, text in sets] == list(range(801, 1001))
    assert job.after(1000) == []
    assert [number for number, _ in job.after(998)] == [999, 1000]


@pytest.mark.parametrize("name", ["limit_command", "limit_travel_deg", "limit_rate", "peak"])
@pytest.mark.parametrize("value", ["", None, "0", "-1", "x", "nan", "1e999", True])
def test_no_axis_moves_without_its_limits(server, name, value):
    page = Browser(f"http://127.0.0.1:{server.port}/?token={server.token}")
    form = FORM | {"port": "/dev/null", "token": page.state["token"], name: value}
    code, text = page.post("/live/run", form)
    assert code == 400
    assert json.loads(text)["error"].startswith(("Limit of", "Peak command"))
    assert page.page_state()["job"] is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"port": ""},
        {"port": ["x"]},
        {"port": "a\0b"},
        {"port": "simulated", "effect": "--log=/tmp/x"},
        {"file": "../secret"},
        {"file": "records/../../secret"},
        {"lines": "all"},
        {"low": "600"},
        {"peak": "51"},
        {"periods": "1.5"},
        {"periods": "1000000000000"},
        {"token": "guessed"},
        {"token": None},
    ],
    ids=str,
)
def test_a_form_that_is_not_valid_is_refused(server, wrong):
    page = Browser(f"http://127.0.0.1:{server.port}/?token={server.token}")
    code, text = page.post("/live/run", FORM | {"port": "/dev/null", "token": page.state["token"]} | wrong)
    assert code == 400
    assert "error" in json.loads(text)
    assert page.page_state()["job"] is None


def test_bug_typed_numbers_were_rounded_to_six_digits_some_upwards(tmp_path):
    typed = {
        "limit_rate": "12.3456789",
        "limit_command": "0.99999996",
        "peak": "0.99999995",
        "fs": "3000.0001",
    }
    wanted = experiment_of(Study(tmp_path / "st"), FORM | {"port": "/dev/null"} | typed)
    assert {"--limit-rate=12.3456789", "--limit-command=0.99999996", "--limit-travel-deg=30"} <= {*wanted.run}
    assert {"--peak=0.99999995", "--fs=3000.0001", "--band=5:500"} <= {*wanted.design}


@pytest.mark.parametrize("origin", ["http://evil.example", "null", None])
def test_another_page_moves_no_axis(ask, origin):
    assert ask("POST", "/live/run", FORM | {"port": "simulated"}, origin=origin).code == 403


def test_a_websocket_of_another_page_gets_no_figures(server):
    with pytest.raises(Exception, match="403"):
        connect(
            f"ws://127.0.0.1:{server.port}/live",
            origin="http://evil.example",
            additional_headers={"Cookie": server.cookie},
        ).__enter__()


@pytest.mark.parametrize("first", [b"\xff", "x" * 100_000, ""])
def test_a_message_that_is_not_valid_leaves_the_server(server, ask, first):
    own = {"origin": f"http://127.0.0.1:{server.port}", "additional_headers": {"Cookie": server.cookie}}
    with contextlib.suppress(ConnectionClosed), connect(f"ws://127.0.0.1:{server.port}/live", **own) as one:
        one.send(first)
        one.send("anything")
        one.recv(timeout=2)
    assert ask("GET", "/state").code == 200


def run_of(server_pid):
    """Process of `gsid run`, a child of the server."""
    children = Path(f"/proc/{server_pid}/task/{server_pid}/children").read_text().split()
    (run,) = (int(one) for one in children if b"\0run\0" in Path(f"/proc/{one}/cmdline").read_bytes())
    return run


def wait_for_record(folder):
    end = time.monotonic() + DEADLINE_S
    while not list((Path(folder) / "st/records").glob("*-run.npz")):
        assert time.monotonic() < end
        time.sleep(0.1)
