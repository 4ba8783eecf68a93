"""Faults around a run of the page, without an axis: a script in place of gsid."""

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest
from filelock import FileLock

from gsid.base.errors import InputError
from gsid.study import folder
from gsid.study.folder import LOCK, Study
from gsid.webpage import jobs, live
from gsid.webpage.interrupted import NOTE, adopt_run, has_note, note_run
from gsid.webpage.jobs import Job
from gsid.webpage.live import Live, LiveJob
from gsid.webpage.page import Page

DEADLINE_S = 30
FORM = {
    "port": "/dev/null",
    "file": "excitation/u.csv",
    "periods": "2",
    "settle": "1",
    "limit_command": "1",
    "limit_travel_deg": "1",
    "limit_rate": "1",
}
DESIGN = {"file": "", "fs": "3000", "period": "600", "low": "5", "high": "500", "peak": "1"}
# A command that writes its output: a run after Ctrl-C or at the end of its input, and as slowly as asked.
SCRIPT = """
import os, pathlib, signal, sys, time
words = sys.argv[1:]
if words[0] == "run":
    try:
        pathlib.Path("begun").touch()
        while os.read(0, 1):
            pass
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    time.sleep(SLOW)
if "-o" in words:
    pathlib.Path(words[words.index("-o") + 1]).write_text("u,y\\n1,2\\n")
print("{}")
sys.exit(130 if words[0] == "run" else 0)
"""


@pytest.fixture
def study(tmp_path, monkeypatch):
    study = Study(tmp_path / "st")
    (tmp_path / "u.csv").write_text("t_s,u\n0,1\n1,0\n")
    study.add_file(tmp_path / "u.csv", kind="excitation")
    monkeypatch.setattr(jobs, "COMMAND", (sys.executable, "-c", SCRIPT.replace("SLOW", "0")))
    return study


async def until(condition):
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s
        await asyncio.sleep(0.02)


async def begun(study, **more):
    """A page with a run that has begun."""
    page = Page(study)
    live = Live(page)
    seat = live.sit("")
    await live.start(FORM | {"token": seat.token} | more)
    await until(lambda: (study.folder / "begun").exists())
    return page, live, seat


def run_steps(study):
    return [one for one in study.steps if one.verb == "run"]


def test_bug_a_run_that_ended_while_the_study_was_in_use_had_no_step(study, monkeypatch):
    monkeypatch.setattr(folder, "LOCK_TIME_S", 0.1)
    monkeypatch.setattr(live, "ADOPT_S", 0.05)

    async def ends_while_in_use():
        page, _, _ = await begun(study)
        with FileLock(study.folder / LOCK):
            page.stop()
            await until(lambda: page.job is None)
            await asyncio.sleep(0.5)
            assert has_note(study)
            assert "the study is in use" in page.error
        await until(lambda: page.state()["steps"])
        assert not has_note(study)
        return page.state()

    state = asyncio.run(ends_while_in_use())
    (step,) = run_steps(study)
    assert step.exit_code == 130
    assert step.words[1] == f"Its samples are in {step.outputs[0]}."
    assert [one["number"] for one in state["steps"]] == [step.number]


def test_bug_a_study_in_use_held_up_every_sign_of_life(study):
    async def longest_gap_s():
        gaps = [0.0]

        async def beat():
            while True:
                before_s = time.monotonic()
                await asyncio.sleep(0.01)
                gaps.append(time.monotonic() - before_s)

        beating = asyncio.create_task(beat())
        lock = FileLock(study.folder / LOCK)
        lock.acquire()
        asyncio.get_running_loop().call_later(2.0, lock.release)
        page, _, _ = await begun(study)
        page.stop()
        await until(lambda: page.job is None)
        beating.cancel()
        await page.close()
        return max(gaps)

    assert asyncio.run(longest_gap_s()) < 1.5


@pytest.mark.parametrize("returns", [True, False])
def test_bug_a_reload_during_the_design_dropped_the_experiment(study, monkeypatch, returns):
    monkeypatch.setattr(live, "ABSENT_S", 2.0)

    async def reload():
        page = Page(study)
        own = Live(page)
        seat = own.sit("")
        await own.start(FORM | DESIGN | {"token": seat.token})
        own.leave(seat)
        await until(lambda: study.steps)
        await asyncio.sleep(0.5)
        assert own.is_running
        if returns:
            own.sit(seat.token)
            await until(lambda: isinstance(page.job, LiveJob))
            page.stop()
        await until(lambda: not own.is_running and page.job is None)
        await page.close()
        return page.error

    error = asyncio.run(reload())
    assert len(run_steps(study)) == returns
    assert returns or "the page that started the experiment has gone" in error


def test_bug_a_page_seemed_idle_between_the_steps_of_an_experiment(study, monkeypatch):
    """Its buttons were on between design, run and look, and what was pressed was refused."""
    shown = []
    tell = Page.changed
    monkeypatch.setattr(
        Page, "changed", lambda page: (shown.append(page.state()["job"] is not None), tell(page))
    )

    async def whole():
        page, _, _ = await begun(study, **DESIGN)
        page.stop()
        await until(lambda: not shown[-1])
        await page.close()

    asyncio.run(whole())
    assert [one.verb for one in study.steps] == ["design", "run", "look"]
    assert shown == [True] * (len(shown) - 1) + [False]


def test_a_step_that_is_requested_while_an_experiment_begins_is_refused(study):
    """It was accepted, and the experiment refused when it had been prepared."""

    async def both():
        page = Page(study)
        own = Live(page)
        form = FORM | DESIGN | {"token": own.sit("").token}
        with study._lock():
            beginning = asyncio.create_task(own.start(form))
            await until(lambda: own.is_running)
            with pytest.raises(InputError, match="another step is about to begin"):
                await page.request_step({"verb": "look", "records": []})
        await beginning
        await until((study.folder / "begun").exists)
        page.stop()
        await until(lambda: page.state()["job"] is None)
        await page.close()

    asyncio.run(both())
    assert [one.verb for one in study.steps] == ["design", "run", "look"]


def test_stop_while_the_page_is_awaited_begins_no_run(study):
    async def stop():
        page = Page(study)
        own = Live(page)
        seat = own.sit("")
        await own.start(FORM | DESIGN | {"token": seat.token})
        own.leave(seat)
        await until(lambda: study.steps)
        page.stop()
        own.sit(seat.token)
        await until(lambda: not own.is_running)
        await page.close()

    asyncio.run(stop())
    assert not run_steps(study)
    assert not has_note(study)


def test_bug_an_axis_began_to_move_before_its_note_was_written(study, monkeypatch):
    def fail(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr(live, "note_run", fail)

    async def start():
        page = Page(study)
        own = Live(page)
        with pytest.raises(OSError, match="no space"):
            await own.start(FORM | {"token": own.sit("").token})
        assert page.job is None
        assert not own.is_running
        await asyncio.sleep(0.5)

    asyncio.run(start())
    assert not (study.folder / "begun").exists()


def test_bug_the_end_of_the_server_killed_a_run_that_wrote_its_record(study, monkeypatch):
    monkeypatch.setattr(Job, "close_s", 0.1)
    monkeypatch.setattr(jobs, "COMMAND", (sys.executable, "-c", SCRIPT.replace("SLOW", "1.5")))

    async def close():
        page, _, _ = await begun(study)
        await asyncio.wait_for(page.close(), DEADLINE_S)

    asyncio.run(close())
    (step,) = run_steps(study)
    assert step.exit_code == 130
    assert step.outputs == (f"records/{step.number}-run.npz",)


def test_a_run_that_was_killed_with_the_server_leaves_a_page_that_names_the_journal(study, monkeypatch):
    monkeypatch.setattr(LiveJob, "close_s", 0.1)
    monkeypatch.setattr(jobs, "COMMAND", (sys.executable, "-c", SCRIPT.replace("SLOW", "600")))
    held = []
    monkeypatch.setattr(live, "note_run", lambda *words: held.append(note_run(*words)) or held[0])

    async def close():
        page, _, _ = await begun(study)
        await asyncio.wait_for(page.close(), DEADLINE_S)

    asyncio.run(close())
    (step,) = run_steps(study)
    assert step.exit_code == -signal.SIGKILL
    assert any("may not have sent STOP" in one for one in step.words)
    os.close(held[0])  # as the end of the process does
    journal = f"records/{step.number}-run.npz.journal"
    (study.folder / journal).touch()
    page = Page(study)
    Live(page)
    assert f"gsid run --recover {journal} -o records/{step.number}-run.npz" in page.error
    assert not has_note(study)
    assert len(run_steps(study)) == 1


def test_bug_a_run_was_adopted_while_it_still_wrote_its_record(study):
    held = note_run(study, 7, ["run"], "records/7-run.csv")
    writes = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE, pass_fds=(held,))
    os.close(held)  # the server has ended
    assert adopt_run(study) is None
    assert has_note(study)
    assert not study.steps

    async def start():
        own = Live(Page(study))
        with pytest.raises(InputError, match="the last run still writes its record"):
            await own.start(FORM | {"token": own.sit("").token})
        assert not own.is_running

    asyncio.run(start())
    (study.folder / "records/7-run.csv").write_text("u,y\n1,2\n")
    writes.communicate(b"\n")
    assert adopt_run(study) == ""
    assert study.steps[0].words[1] == "Its samples are in records/7-run.csv."
    assert not has_note(study)


def test_a_page_that_joins_gets_the_run_that_has_ended_meanwhile(study, monkeypatch):
    monkeypatch.setattr(live, "ADOPT_S", 0.05)
    held = note_run(study, 7, ["run"], "records/7-run.csv")

    async def joins():
        page = Page(study)
        own = Live(page)
        own.sit("")
        await asyncio.sleep(0.2)
        assert not study.steps
        os.close(held)
        await until(lambda: page.state()["steps"])

    asyncio.run(joins())
    assert not has_note(study)


def test_bug_the_record_of_a_run_was_read_from_the_words_of_a_message():
    job = LiveJob(("run",))
    line = '{"record": {"path": "records/a b.csv", "samples": 70, "good": 6, "spoiled": 1}}\n'
    assert job.takes(line.encode())
    assert job.messages == ["records/a b.csv keeps 70 samples: 6 good periods, 1 spoiled."]


def test_a_note_that_is_not_one_is_removed(study):
    (study.folder / NOTE).write_text("[]")
    with contextlib.suppress(InputError):
        assert adopt_run(study) == ""
    assert not has_note(study)
