"""Bad input of every kind ends with exit status 3, or 0 where it can be read.

`make hostile` runs all of the corpus, each run in a process of its own.
"""

import collections
import json
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from entries import PLANT_VERBS, Entry, read_by
from hostile_corpus import corpus
from hostile_runs import faults, key, load, run_corpus, table
from sound_files import catalogue_plant, plant

RUNS = Path(__file__).with_name("hostile_runs.py")
CLASSES = {
    "key",
    "text",
    "samples",
    "type",
    "csv",
    "container",
    "meta.json",
    "excitation",
    "plant",
    "rational",
}
CLASSES |= {"catalogue", "rational z", "matrix", "pieces", "model", "size", "law", "table", "library"}
PARTS = 2  # at a time


@pytest.fixture(scope="module")
def entries():
    return corpus()


@pytest.mark.long
def test_no_bad_input_ends_otherwise(tmp_path):
    """Of 434 bad inputs 22 ended with 4, 7 with 2, and one wrong byte of a .mat ended the process."""
    parts = [
        subprocess.Popen(
            [
                sys.executable,
                RUNS,
                "--short",
                "--verbs",
                "1",
                "--part",
                f"{i}/{PARTS}",
                "--out",
                f"{i}.jsonl",
            ],
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for i in range(PARTS)
    ]
    talk = [part.communicate(timeout=1800)[1] for part in parts]
    lines = [line for i in range(PARTS) for line in (tmp_path / f"{i}.jsonl").read_text().splitlines()]
    results = [json.loads(line) for line in lines]
    wrong = [run for run in results if run["faults"]]
    assert not wrong, "\n".join(talk)
    assert len(results) >= 400
    assert {run["kind"] for run in results} == CLASSES


def test_the_corpus_depends_on_its_seed_alone(entries):
    first, second = corpus(short=True), corpus(short=True)
    assert [entry.files for entry in first] == [entry.files for entry in second]
    assert min(collections.Counter(entry.kind for entry in first).values()) >= 1
    assert not [entry.name for entry in entries if not entry.commands]


MOST = 12.0  # of the quickest command, which only reads and writes the model: the bug was 40 of it


@pytest.mark.parametrize("model", [plant(), catalogue_plant()])
def test_the_sound_models_are_quick(model):
    """A bug: adding an effect to the sound models took 14 s, so that bad ones near to them did too."""
    commands = [words for words in read_by(PLANT_VERBS, "m0.json") if words[0] in ("add", "diagnose")]
    entry = Entry("sound", "model", {"m0.json": json.dumps(model).encode()}, commands)
    # From a small process: a fork has the memory of its parent, and keeps that peak when it starts a program.
    program = "import sys, pickle, hostile_runs as h; e = pickle.load(sys.stdin.buffer); " + (
        "sys.stdout.buffer.write(pickle.dumps(list(h.run_corpus([e], 99, own_process=True))))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        input=pickle.dumps(entry),
        cwd=RUNS.parent,
        stdout=subprocess.PIPE,
        check=True,
    )
    results = pickle.loads(done.stdout)
    assert not [one for one in results if one["faults"]]
    seconds = [one["seconds"] for one in results]
    assert max(seconds) < MOST * min(seconds)


def test_a_run_that_was_cut_goes_on(tmp_path, entries):
    """What ended well is left out, what was at fault or cut off is run again."""
    runs = [{"faults": []}, {"faults": ["exit 4"]}, {"faults": []}]
    lines = [json.dumps(one) + "\n" for one in runs]
    file = tmp_path / "runs.jsonl"
    file.write_text("".join(lines) + lines[0][:5])
    assert load(file) == [runs[0], runs[2]]
    assert file.read_text() == lines[0] + lines[2]
    assert load(tmp_path / "none.jsonl") == []
    first = next(iter(run_corpus(entries[:1], 1, own_process=True)))
    ended = {key(first["name"], first["argv"])}
    assert [one["name"] for one in run_corpus(entries[:2], 1, own_process=True, ended=ended)] == [
        entries[1].name
    ]


def test_no_two_runs_have_one_key(entries):
    keys = [key(entry.name, argv) for entry in entries for argv in entry.commands]
    assert len(keys) == len(set(keys))


def test_what_counts_as_a_fault():
    good = {"code": 3, "seconds": 1.0, "megabytes": 100.0, "printed": b"error: a\n  where: b\n  hint: c\n"}
    assert faults(good) == []
    assert faults(good | {"code": 0, "printed": b""}) == []
    for wrong in (
        {"code": 4},
        {"code": 2},
        {"code": -11},
        {"seconds": 11.0},
        {"megabytes": 501.0},
        {"printed": b"error: a\n"},
        {"printed": b"hint: \x1b[31m"},
        {"printed": b"hint: Traceback"},
    ):
        assert len(faults(good | wrong)) == 1, wrong
    assert "| all | 1 | 1 | 0 | 1 | 0 | 1.0 | 100 |" in table([good | {"kind": "a", "name": "b"}])
