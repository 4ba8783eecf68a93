"""A study whose process is killed before any one of its changes of files, one after the other."""

import functools
import hashlib
import json
import os
import signal
import sys

import numpy as np
import pytest

from gsid.cli.main import main
from gsid.records.files import write_record
from gsid.records.record import Record
from gsid.study.folder import LOG, SESSION, Study

CHANGES = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.link", "os.symlink"}
MOST = 200  # changes of one command
ENDED = 0


@pytest.fixture
def rec(tmp_path):
    """A record that a meta.json beside it lists, so that its copy is a folder."""
    rng = np.random.default_rng(1)
    u = np.tile(rng.standard_normal(64), 6)
    folder = tmp_path / "rig"
    folder.mkdir()
    write_record(folder / "rec.csv", Record(u, 2 * u + 0.01 * rng.standard_normal(len(u)), 100.0))
    (folder / "meta.json").write_text(json.dumps({"files": ["rec.csv"], "fs_hz": 100}))
    return folder / "rec.csv"


def killed_before(change, run):
    """Run in a process of its own, which is killed before it changes a file this often; its status."""
    child = os.fork()
    if child == 0:
        left = [change]

        def hook(event, arguments):
            writes = (
                event == "open" and isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)
            )
            if writes or event in CHANGES:
                left[0] -= 1
                if left[0] < 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        code = 1
        try:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            os.dup2(1, 2)
            sys.addaudithook(hook)
            run()
            code = ENDED
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def check(folder):
    """The study opens, and has each file that its session notes, with its content."""
    study = Study(folder)
    noted = json.loads((study.folder / SESSION).read_text())["files"]
    for name, digest in noted.items():
        assert hashlib.sha256((study.folder / name).read_bytes()).hexdigest() == digest, name
    for step in study.steps:
        assert set(step.outputs) <= set(noted)
        assert not step.answer or study.answer(step) is not None
    assert all(name in noted for name in study.last_experiment)
    return study


def every_change(tmp_path, before, run):
    """Kill before each change in turn, from the same state; the folders that were left."""
    for change in range(MOST):
        folder = tmp_path / f"study{change}"
        before(folder)
        status = killed_before(change, functools.partial(run, folder))
        assert status in (-signal.SIGKILL, ENDED), change
        yield folder
        if status == ENDED:
            assert change > 5
            return
    raise AssertionError("the command has no end")


def test_a_study_that_was_killed_as_it_began_can_begin_again(tmp_path):
    for folder in every_change(tmp_path, lambda folder: None, Study):
        assert check(folder).steps == []


def test_a_study_that_was_killed_as_a_file_was_opened(tmp_path, rec):
    for folder in every_change(tmp_path, Study, lambda folder: Study(folder).open_files([rec])):
        study = check(folder)
        (name,) = study.open_files([rec])
        assert check(folder).last_experiment == [name]


def test_a_study_that_was_killed_in_a_step(tmp_path, rec, monkeypatch):
    """The next step notes what the killed one left: the log has each step of the session."""
    monkeypatch.chdir(tmp_path)

    def before(folder):
        Study(folder).open_files([rec])
        Study(folder).add_step(["look", "first"], 0)

    assert main(["look", str(rec)]) == 0  # imports
    for folder in every_change(
        tmp_path, before, lambda folder: main(["-C", str(folder), "cut", "--to", "2"])
    ):
        study = check(folder)
        study.add_step(["look", "last"], 0)
        steps = check(folder).steps
        assert [step.verb for step in steps] in (["look", "look"], ["look", "cut", "look"])
        assert len({step.number for step in steps}) == len(steps)
        assert (study.folder / LOG).read_text() == "".join(f"{step.command}\n" for step in steps)
