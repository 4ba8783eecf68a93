"""The command as a function, its snapshots, and records for it to read."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from known_system import FS_HZ, LINES, N_PERIOD, N_PERIODS, response

from gsid.cli.main import main
from gsid.records.files import write_record
from gsid.records.record import Record

SNAPSHOTS = Path(__file__).parent / "snapshots"
UPDATE = "GSID_UPDATE_SNAPSHOTS"  # set to 1 to accept what the command now says


@dataclass
class Result:
    code: int
    out: str
    err: str


@pytest.fixture(autouse=True)
def plain_words(monkeypatch, tmp_path):
    """Same width, no colour, and file names without folders, wherever the tests run."""
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.delenv("GSID_DEBUG", raising=False)
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def gsid(capsys):
    """Run the command in this process: `gsid("frf", "rec.csv")`. Its messages are shown if the test fails."""
    shown = []

    def run(*arguments):
        capsys.readouterr()
        code = main([str(a) for a in arguments])
        captured = capsys.readouterr()
        shown.append(captured.err)
        return Result(code, captured.out, captured.err)

    yield run
    sys.stderr.write("".join(shown))


@pytest.fixture
def snapshot():
    """Compare a text with the one kept under this name."""

    def compare(name, text):
        path = SNAPSHOTS / f"{name}.txt"
        if os.environ.get(UPDATE) == "1":
            SNAPSHOTS.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        assert path.is_file(), f"no snapshot {path.name}: look at the text, then run with {UPDATE}=1\n{text}"
        assert text == path.read_text(encoding="utf-8"), f"if this is meant, run with {UPDATE}=1"

    return compare


@pytest.fixture
def record():
    """Six periods of a random-phase multisine through `response`, with noise of 0.01."""
    rng = np.random.default_rng(30)
    spectrum = np.zeros(N_PERIOD // 2 + 1, complex)
    spectrum[LINES] = np.exp(2j * np.pi * rng.random(len(LINES))) * N_PERIOD / 2
    output = spectrum * response(np.arange(len(spectrum)) * FS_HZ / N_PERIOD)
    u, y = (np.tile(np.fft.irfft(x, N_PERIOD), N_PERIODS) for x in (spectrum, output))
    return Record(u, y + 0.01 * rng.standard_normal(len(y)), FS_HZ, u_unit="A", y_unit="deg/s")


@pytest.fixture
def rec_csv(record, tmp_path):
    write_record(tmp_path / "rec.csv", record)
    return "rec.csv"
