"""The commands of the page: how they begin, end and are stopped, and what is kept of them."""

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from gsid.base.errors import InputError
from gsid.records.files import write_record
from gsid.records.record import Record
from gsid.study import folder as study_folder
from gsid.study.folder import Study
from gsid.webpage import jobs, server
from gsid.webpage import page as page_module
from gsid.webpage.jobs import Job
from gsid.webpage.page import Page

DEADLINE_S = 60
LOOK = {"verb": "look", "records": ["records/a.csv"]}
# A command that writes each Ctrl-C it gets, and judges for a while after the first.
SLOW = """
import signal, sys, time
def stopped(*_):
    print("interrupt", flush=True)
    if not ending:
        ending.append(time.monotonic() + 0.5)
ending = []
signal.signal(signal.SIGINT, stopped)
print('{"words": "ready"}', file=sys.stderr, flush=True)
while not ending or time.monotonic() < ending[0]:
    time.sleep(0.01)
sys.exit(130)
"""
DEAF = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
print('{"words": "ready"}', file=sys.stderr, flush=True)
time.sleep(600)
"""


@pytest.fixture
def study(tmp_path):
    study = Study(tmp_path / "st")
    (tmp_path / "a.csv").write_text("u,y\n" + "1,2\n2,1\n" * 50)
    study.add_file(tmp_path / "a.csv")
    return study


@pytest.fixture
def command(monkeypatch):
    """Run a script in place of gsid."""
    return lambda script: monkeypatch.setattr(jobs, "COMMAND", (sys.executable, "-c", script))


def run(coroutine):
    """As asyncio.run, in a thread: that of the tests may have the event loop of a browser."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, coroutine).result()


async def look(page):
    """One step, to its end."""
    await page.request_step(LOOK)
    await ended(page)


async def ended(page):
    await asyncio.wait_for(page._running, DEADLINE_S)


async def until(condition):
    end = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end
        await asyncio.sleep(0.01)


async def ready(page):
    """One step that runs and can be stopped."""
    await page.request_step(LOOK)
    await until(lambda: page.job.step == "ready")


def fail(*_, **__):
    raise KeyError("no such field")


# ---- begin and end ---------------------------------------------------------------------------------------


def test_a_module_in_the_study_is_not_run(study):
    (study.folder / "click.py").write_text("open('owned', 'w').close()\n")
    run(look(Page(study)))
    assert len(study.steps) == 1
    assert not (study.folder / "owned").exists()


def test_a_second_step_is_refused_from_the_first_moment(study):
    async def both():
        page = Page(study)
        await page.request_step(LOOK)
        with pytest.raises(InputError, match="another step is running"):
            await page.request_step(LOOK)
        await ended(page)

    run(both())
    assert len(study.steps) == 1


def test_the_command_is_shown_as_it_is_typed():
    assert Job(("look", "records/a b.csv")).command == "gsid look 'records/a b.csv'"


def test_an_answer_that_cannot_be_read_does_not_lose_the_step(study, monkeypatch):
    monkeypatch.setattr(page_module, "outcome_of", fail)
    page = Page(study)
    run(look(page))
    (step,) = page.state()["steps"]
    assert "KeyError: 'no such field'" in step["words"][0]
    assert page.state()["job"] is None


@pytest.mark.parametrize("where", [(Study, "add_step"), (Job, "run")])
def test_a_fault_of_the_server_is_shown_until_the_next_step(study, monkeypatch, where):
    async def twice():
        page = Page(study)
        with monkeypatch.context() as patch:
            patch.setattr(*where, fail)
            await look(page)
        faulty = page.state()
        await look(page)
        return faulty, page.state()

    faulty, repaired = run(twice())
    assert "KeyError: 'no such field'" in faulty["error"]
    assert faulty["job"] is None
    assert repaired["error"] is None
    assert len(repaired["steps"]) == 1


def test_the_next_steps_are_offered_after_a_restart(study):
    """They were kept by the server alone."""
    (study.folder / "records/a.csv").write_text("# fs_hz: 100\nu,y\n" + "1,2\n2,1\n" * 50)
    page = Page(study)
    run(look(page))
    (before,) = page.state()["steps"]
    assert before["next"]
    assert Page(Study(study.folder)).state()["steps"] == [before]


def test_a_step_of_the_command_line_is_shown(study, monkeypatch):
    """The page showed the study as its server had changed it."""
    monkeypatch.setattr(page_module, "FOLLOW_S", 0.01)

    async def follow():
        page, changed = Page(study), asyncio.Event()
        page.watchers.add(changed)
        following = asyncio.create_task(page.follow())
        await asyncio.sleep(0)
        Study(study.folder).add_step(["look", "records/a.csv"], 0)
        await asyncio.wait_for(changed.wait(), DEADLINE_S)
        following.cancel()
        return page.state()

    assert [step["verb"] for step in run(follow())["steps"]] == ["look"]


def test_a_watcher_that_fails_does_not_end_the_command(study, command):
    command("""import sys; print('{"words": "one"}', file=sys.stderr); print('{}')""")
    job = Job(("look",))
    run(asyncio.wait_for(job.run(study.folder, fail), DEADLINE_S))
    assert (job.exit_code, job.stdout, job.step) == (0, b"{}\n", "one")


# ---- lines on stderr -------------------------------------------------------------------------------------


def test_what_is_not_json_is_a_message(study, command):
    lines = [
        b'{"step": "2/3", "words": "scanning", "seconds_left": 4.4}',
        b'{"message": "note: a"}',
        b"Traceback (most recent call last):",
        b"\xff\xfe",
        b'{"words": 3}',
        b"[" * 10_000,
        b"12",
        b"",
        b'{"message": "last"}',
    ]
    too_long = "sys.stderr.buffer.write(b'x' * 200_000 + bytes([10]))"
    command(f"import sys; {too_long}; [sys.stderr.buffer.write(line + bytes([10])) for line in {lines}]")
    job = Job(("look",))
    run(asyncio.wait_for(job.run(study.folder, lambda: None), DEADLINE_S))
    assert (job.step, job.step.part, job.step.seconds_left) == ("[2/3] scanning, 4 s left", "2/3", 4.4)
    as_they_are = [lines[2].decode(), "\ufffd\ufffd", '{"words": 3}', "[" * 10_000, "12"]
    assert job.messages[-7:] == ["note: a", *as_they_are, "last"]


def test_steps_and_messages_of_a_real_command(study):
    """With the steps of each moment, as the page shows them."""
    rng = np.random.default_rng(3)
    u = np.tile(rng.standard_normal(64), 8)
    y = np.convolve(u, [0.5, 0.3])[: len(u)] + 0.01 * rng.standard_normal(len(u))
    write_record(study.folder / "records/b.csv", Record(u, y, 100.0))
    job, steps = Job(("start", "records/b.csv", "--json")), []
    run(asyncio.wait_for(job.run(study.folder, lambda: steps.append(job.step)), DEADLINE_S))
    assert (job.exit_code, "fitting structures to b.csv" in steps) == (0, True), job.messages
    assert "note: b.csv: period of 64 samples found from u" in job.messages
    assert "summary" in json.loads(job.stdout)


def test_an_error_of_a_real_command_has_its_where_and_hint(study):
    job = Job(("look", "records/none.csv"))
    run(asyncio.wait_for(job.run(study.folder, lambda: None), DEADLINE_S))
    assert job.exit_code == 3
    assert [text.split(":")[0].strip() for text in job.messages] == ["error", "where", "hint"]


def test_progress_does_not_read_the_study_again(study, monkeypatch):
    page = Page(study)
    before = page.state()
    monkeypatch.setattr(Study, "_read", fail)
    assert page.state() == before


# ---- stop ------------------------------------------------------------------------------------------------


def test_stop_sends_one_interrupt_and_the_command_ends_by_itself(study, command, monkeypatch):
    seen = []
    read = page_module.outcome_of
    monkeypatch.setattr(
        page_module,
        "outcome_of",
        lambda *given, stopped: seen.append((given, stopped)) or read(*given, stopped),
    )

    async def stop_three_times():
        page = Page(study)
        await ready(page)
        assert page.state()["job"]["stopping"] is False
        for _ in range(3):
            page.stop()
            await asyncio.sleep(0.05)
        assert page.state()["job"] | {"command": ""} == {
            "command": "",
            "verb": "look",
            "step": "stopping",
            "stopping": True,
        }
        await ended(page)
        return page.state()

    command(SLOW)
    state = run(stop_three_times())
    ((_, exit_code, stdout, _), stopped), *_ = seen
    assert (exit_code, stdout, stopped) == (130, b"interrupt\n", True)
    assert state["steps"][-1]["failed"] is False


def test_a_command_that_is_stopped_while_it_loads_has_not_failed(study, command):
    async def stop():
        page = Page(study)
        await ready(page)
        page.stop()
        await ended(page)
        return page.state()

    command(SLOW.replace("signal.signal(", "signal.signal(signal.SIGINT, signal.SIG_DFL) or ("))
    (step,) = run(stop())["steps"]
    assert study.steps[-1].exit_code == 130
    assert step["words"][0] == "The step was stopped."
    assert not step["failed"]


def test_a_command_that_does_not_stop_is_ended_by_force(study, command, monkeypatch):
    monkeypatch.setattr(jobs, "STOP_S", 0.2)

    async def stop():
        page = Page(study)
        await ready(page)
        page.stop()
        await ended(page)

    command(DEAF)
    run(stop())
    assert study.steps[-1].exit_code == -signal.SIGKILL


@pytest.mark.parametrize(("script", "exit_code"), [(SLOW, 130), (DEAF, -signal.SIGKILL)])
def test_the_end_of_the_server_stops_the_command_and_keeps_the_step(
    study, command, monkeypatch, script, exit_code
):
    monkeypatch.setattr(Job, "close_s", 3.0 if script == SLOW else 0.2)

    async def close():
        page = Page(study)
        await ready(page)
        await asyncio.wait_for(page.close(), DEADLINE_S)

    command(script)
    run(close())
    assert study.steps[-1].exit_code == exit_code


# ---- watchers --------------------------------------------------------------------------------------------


class Watcher:
    """A websocket of a page; `reads` is awaited before each state is taken."""

    def __init__(self, page, reads):
        self.app = type("App", (), {"state": type("State", (), {"page": page})})
        self.reads, self.states = reads, []

    async def accept(self):
        pass

    async def receive(self):
        await asyncio.Event().wait()

    async def send_text(self, text):
        await self.reads()
        self.states.append(text)


def test_a_page_that_does_not_read_stops_no_command(study):
    async def watched():
        page = Page(study)
        stuck, reading = Watcher(page, asyncio.Event().wait), Watcher(page, lambda: asyncio.sleep(0))
        watching = [asyncio.create_task(server._changes(one)) for one in (stuck, reading)]
        await until(lambda: len(page.watchers) == 2)
        await look(page)
        await until(lambda: reading.states and '"job": null' in reading.states[-1])
        for one in watching:
            one.cancel()
        await asyncio.gather(*watching, return_exceptions=True)
        assert not page.watchers
        assert not stuck.states
        assert '"number": 1' in reading.states[-1]

    run(watched())


# ---- the process of the server ---------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGTERM, signal.SIGINT], ids=lambda one: one.name)
def test_a_signal_ends_the_server(studio, number):
    process, _ = studio()
    process.send_signal(number)
    assert process.wait(timeout=20) == (130 if number == signal.SIGINT else 0)


def test_under_nohup_the_end_of_the_terminal_does_not_end_the_server(studio):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # what nohup does
    try:
        process, _ = studio()
    finally:
        signal.signal(signal.SIGHUP, before)
    process.send_signal(signal.SIGHUP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(timeout=1)


def test_two_servers_on_one_study_are_refused(studio):
    studio()
    process, log = studio(waits=False)
    assert process.wait(timeout=DEADLINE_S) == 3
    assert "the study is open in another gsid studio" in log.read_text()


def test_a_port_in_use_has_a_hint(studio, server):
    process, log = studio("--port", str(server.port), waits=False)
    assert process.wait(timeout=DEADLINE_S) == 3
    assert "choose another --port" in log.read_text()


def test_the_browser_gets_the_address_in_a_file_of_its_user(studio, tmp_path, monkeypatch):
    browser = tmp_path / "bin/xdg-open"
    browser.parent.mkdir()
    browser.write_text(
        f'#!/bin/sh\necho "$@" >{tmp_path}/words\nstat -c %a "$1" >{tmp_path}/mode\n'
        f'cp "$1" {tmp_path}/part.html\nmv {tmp_path}/part.html {tmp_path}/page.html\n'
    )
    browser.chmod(0o755)
    monkeypatch.setenv("PATH", f"{browser.parent}{os.pathsep}{os.environ['PATH']}")
    process, log = studio(browser=True)
    end = time.monotonic() + DEADLINE_S
    while not (tmp_path / "page.html").exists():
        assert time.monotonic() < end, log.read_text()
        time.sleep(0.05)
    words = (tmp_path / "words").read_text()
    assert "token" not in words
    assert (tmp_path / "mode").read_text() == "600\n"
    assert f"url={process.address}" in (tmp_path / "page.html").read_text()
    process.send_signal(signal.SIGTERM)
    process.wait(timeout=20)
    assert not os.path.exists(words.strip())  # a file of the token stays nowhere


# ---- at the same time ------------------------------------------------------------------------------------


def test_a_stop_does_not_wait_for_a_study_in_use(study):
    """A requested step waited for the lock of the study, and the whole server with it."""

    async def stop_meanwhile():
        page = Page(study)
        with study._lock():
            beginning = asyncio.create_task(page.request_step(LOOK))
            begun = time.monotonic()
            await asyncio.sleep(0.05)
            with pytest.raises(InputError, match="another step is about to begin"):
                await page.request_step(LOOK)
            page.stop()
            assert time.monotonic() - begun < study_folder.LOCK_TIME_S / 2
        with pytest.raises(InputError, match="stopped before it began"):
            await beginning
        assert page.job is None
        await page.request_step(LOOK)
        await ended(page)

    run(stop_meanwhile())
    assert [step.number for step in study.steps] == [1]


def test_an_upload_does_not_replace_a_newer_state(study, tmp_path, monkeypatch):
    """Its reading had begun before a step ended, and was stored after that of the step."""
    (tmp_path / "b.csv").write_text("u,y\n" + "1,3\n2,1\n" * 50)
    read, reads = Page._study_state, []

    def slow_at_first(page):
        found = read(page)
        reads.append(found)
        if len(reads) == 2:  # the first is that of the constructor
            time.sleep(1.0)
        return found

    async def upload_while_a_step_ends():
        page = Page(study)
        job = Job(("look", "records/a.csv"))
        job.exit_code, page.number = 0, study.begin_step()
        adding = asyncio.create_task(page.add_file(tmp_path / "b.csv", "b.csv"))
        await until(lambda: len(reads) == 2)
        await page._record(job)
        await adding
        return page.state()

    monkeypatch.setattr(Page, "_study_state", slow_at_first)
    assert len(run(upload_while_a_step_ends())["steps"]) == 1


def test_unfinished_uploads_of_a_killed_server_are_removed(studio, tmp_path):
    process, _ = studio()
    process.kill()
    process.wait()
    (tmp_path / "st/.upload-abc").mkdir()
    (tmp_path / "st/.upload-abc/upload").write_text("half a file")
    studio()
    assert not (tmp_path / "st/.upload-abc").exists()
