"""Every output goes through `gsid.base.files`: whole or not at all, over nothing but a regular file."""

import ast
import os
import signal
import socket
import stat
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gsid
from gsid import InputError
from gsid.base.files import refuse_overwrite, write_atomically
from gsid.models.rational import RationalModel
from gsid.records.files import read_record, write_record
from gsid.records.record import Record

pytestmark = pytest.mark.xdist_group("clock")  # CONTRIBUTING.md
TEXT = "the new text\n"


def write_text(part):
    part.write_text(TEXT)


@pytest.fixture
def umask():
    """A umask that is neither the usual one nor none."""
    old = os.umask(0o027)
    yield
    os.umask(old)


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664, 0o755])
def test_an_existing_file_keeps_its_mode(tmp_path, umask, mode):
    path = tmp_path / "m.json"
    path.write_text("old")
    path.chmod(mode)
    write_atomically(path, write_text)
    assert stat.S_IMODE(path.stat().st_mode) == mode
    assert path.read_text() == TEXT


def test_a_new_file_has_the_mode_of_the_umask(tmp_path, umask):
    write_atomically(tmp_path / "m.json", write_text)
    assert stat.S_IMODE((tmp_path / "m.json").stat().st_mode) == 0o640


def test_what_replaces_a_private_file_is_private_from_the_start(tmp_path):
    path = tmp_path / "m.json"
    path.write_text("old")
    path.chmod(0o600)
    modes = []
    write_atomically(path, lambda part: modes.append(stat.S_IMODE(part.stat().st_mode)) or write_text(part))
    assert modes == [0o600]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_an_existing_file_keeps_its_owner(tmp_path):
    path = tmp_path / "m.json"
    path.write_text("old")
    os.chown(path, 1234, 2345)
    write_atomically(path, write_text)
    assert (path.stat().st_uid, path.stat().st_gid) == (1234, 2345)


def test_another_group_does_not_get_the_rights_of_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "m.json"
    path.write_text("old")
    path.chmod(0o664)

    def refused(*args):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "chown", refused)
    real = os.stat

    def of_another_group(name, *args, **kwargs):
        found = real(name, *args, **kwargs)
        if Path(name) != path:
            return found
        fields = {field: getattr(found, field) for field in dir(found) if field.startswith("st_")}
        return SimpleNamespace(**fields | {"st_gid": found.st_gid + 1})

    monkeypatch.setattr(os, "stat", of_another_group)
    write_atomically(path, write_text)
    monkeypatch.undo()
    assert stat.S_IMODE(path.stat().st_mode) == 0o604


def test_a_read_only_file_is_not_replaced(tmp_path, monkeypatch):
    path = tmp_path / "rec.csv"
    path.write_text("measured")
    path.chmod(0o444)
    monkeypatch.setattr(os, "access", lambda name, how: Path(name) != path)  # root may write anything
    with pytest.raises(PermissionError, match="read-only"):
        write_atomically(path, write_text)
    assert path.read_text() == "measured"


def test_a_link_stays_a_link_and_its_target_is_replaced(tmp_path):
    (tmp_path / "far").mkdir()
    target, link = tmp_path / "far/data", tmp_path / "latest.csv"
    target.write_text("old")
    target.chmod(0o600)
    link.symlink_to("far/data")
    write_atomically(link, write_text)
    assert link.is_symlink()
    assert (target.read_text(), stat.S_IMODE(target.stat().st_mode)) == (TEXT, 0o600)
    assert [p.name for p in (tmp_path / "far").iterdir()] == ["data"]


def test_a_link_that_leads_nowhere_or_round_is_refused(tmp_path):
    link = tmp_path / "latest.csv"
    link.symlink_to("gone.csv")
    with pytest.raises(InputError, match="leads to no file"):
        write_atomically(link, write_text)
    link.unlink()
    link.symlink_to("latest.csv")
    with pytest.raises(OSError, match="Too many levels"):
        write_atomically(link, write_text)
    assert [p.name for p in tmp_path.iterdir()] == ["latest.csv"]


def test_what_is_not_a_regular_file_is_not_replaced(tmp_path):
    (tmp_path / "folder.json").mkdir()
    os.mkfifo(tmp_path / "pipe.json")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket.json"))
    (tmp_path / "null.json").symlink_to("/dev/null")
    kinds = {"folder": "folder", "pipe": "pipe", "socket": "socket", "null": "character device"}
    for name, kind in kinds.items():
        path = tmp_path / f"{name}.json"
        before = path.lstat().st_ino
        with pytest.raises(InputError, match=kind):
            write_atomically(path, write_text)
        assert path.lstat().st_ino == before
    assert len(list(tmp_path.iterdir())) == len(kinds)
    with pytest.raises(InputError, match="character device"):
        write_atomically("/dev/null", write_text)
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_temporary_names_cannot_be_guessed_and_are_new(tmp_path):
    names = []

    def keep(part):
        assert part.stat().st_size == 0
        names.append(part.name)

    for _ in range(20):
        write_atomically(tmp_path / "rec.csv", keep)
    assert len(set(names)) == 20
    assert not any("rec" in name or str(os.getpid()) in name for name in names)
    assert all(name.endswith(".csv") for name in names)
    assert [p.name for p in tmp_path.iterdir()] == ["rec.csv"]


def test_a_long_name_has_a_temporary_name_too(tmp_path):
    path = tmp_path / f"{'x' * 250}.csv"
    write_atomically(path, write_text)
    assert path.read_text() == TEXT


def test_file_and_folder_are_synced_in_order(tmp_path, monkeypatch):
    done = []
    sync, rename = os.fsync, os.replace
    monkeypatch.setattr(
        os,
        "fsync",
        lambda fd: done.append("folder" if stat.S_ISDIR(os.fstat(fd).st_mode) else "file") or sync(fd),
    )
    monkeypatch.setattr(os, "replace", lambda *names: done.append("rename") or rename(*names))
    write_atomically(tmp_path / "m.json", write_text)
    assert done == ["file", "rename", "folder"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGINT])
def test_nothing_is_left_behind_by_a_signal(tmp_path, number):
    """It sleeps in short pieces: Python sees a signal that comes just before a sleep only after it."""
    code = (
        "import sys, time; from gsid.base.files import write_atomically\n"
        "def slow(part):\n    part.write_text('half'); print('now', flush=True)\n"
        "    for _ in range(3000): time.sleep(0.01)\n"
        "write_atomically(sys.argv[1], slow)"
    )
    path = tmp_path / "rec.csv"
    path.write_text("old")
    with subprocess.Popen(
        [sys.executable, "-c", code, path], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        process.stdout.readline()
        process.send_signal(number)
        assert process.wait(20) == -number
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["rec.csv"]


def test_handlers_of_signals_are_as_they_were(tmp_path):
    numbers = [signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT]
    before = [signal.getsignal(number) for number in numbers]
    write_atomically(tmp_path / "m.json", write_text)
    assert [signal.getsignal(number) for number in numbers] == before


def test_stdout_takes_a_record_and_a_model(tmp_path):
    record = Record(np.sin(np.arange(40.0)), np.cos(np.arange(40.0)), 10.0)
    write_record(tmp_path / "rec.csv", record)
    RationalModel([1], [1, 2], 0.1).save(tmp_path / "m.json")
    code = (
        "import sys; from gsid import RationalModel, read_record, write_record\n"
        "print('before'); write_record('-', read_record('rec.csv'))\n"
        "RationalModel([1], [1, 2], 0.1).save('-')"
    )
    out = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, check=True).stdout
    expected = b"before\n" + (tmp_path / "rec.csv").read_bytes() + (tmp_path / "m.json").read_bytes()
    assert out == expected
    assert {p.name for p in tmp_path.iterdir()} == {"rec.csv", "m.json"}


@pytest.mark.parametrize("extension", ["csv", "npz", "mat", "h5", "CSV", "NPZ", "MAT", "H5"])
def test_every_format_arrives_whole(tmp_path, extension):
    """Bug: numpy and scipy add their extension to a name in .NPZ or .MAT: another file was written."""
    record = Record(np.arange(40.0), np.ones(40), 10.0)
    write_record(tmp_path / f"rec.{extension}", record)
    assert [p.name for p in tmp_path.iterdir()] == [f"rec.{extension}"]
    np.testing.assert_array_equal(read_record(tmp_path / f"rec.{extension}").u, record.u)


def test_an_input_is_recognised_under_every_name(tmp_path):
    rec = tmp_path / "rec.csv"
    rec.write_text("measured")
    (tmp_path / "folder").mkdir()
    (tmp_path / "soft.csv").symlink_to(rec)
    os.link(rec, tmp_path / "hard.csv")
    for name in ("rec.csv", "soft.csv", "hard.csv", "folder/../rec.csv"):
        with pytest.raises(InputError, match="an input") as caught:
            refuse_overwrite(tmp_path / name, [tmp_path / "other.csv", rec], "it would replace an input")
        assert "2.csv" in caught.value.hint
    refuse_overwrite(tmp_path / "new.csv", [rec], "it would replace an input")


WRITERS = {
    "write_text",
    "write_bytes",
    "savefig",
    "savez",
    "savez_compressed",
    "savetxt",
    "savemat",
    "replace",
}


def test_nothing_writes_but_through_this_function():
    """Calls that write, wherever they stand in the package, fill a `part` or a stream in memory."""
    package = Path(gsid.__file__).parent
    found = []
    for path in package.rglob("*.py"):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and _writes(call) and path != package / "base/files.py":
                found.append((path.relative_to(package).as_posix(), ast.unparse(call)[:100]))
    outside = [one for one in found if "part" not in one[1]]
    # Writers of formats, called by `write_record` with the temporary name; and figures drawn in memory.
    assert {(where, text.split("(")[0]) for where, text in outside} <= {
        ("records/arrays.py", "np.savez"),
        ("records/arrays.py", "savemat"),
        ("records/arrays.py", "h5py.File"),
        ("records/csv.py", "open"),
        ("records/mimo.py", "open"),
        ("response/streaming.py", "np.savez"),  # into a file that was opened with the temporary name
        ("cli/simulate.py", "path.open"),  # the log: called with the temporary name too
        ("report/pictures.py", "figure.savefig"),
        ("plots/style.py", "self.savefig"),
        ("study/folder.py", "open"),  # the log of commands: a line is appended
        ("study/folder.py", "os.replace"),  # a whole copy, under the lock of the study
        ("webpage/safety.py", "place.write_text"),  # the address, in a temporary folder
        ("webpage/server.py", "open"),  # an upload, to a temporary file
    }, outside


def _writes(call):
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    if name in ("open", "File"):
        return any(
            isinstance(a, ast.Constant) and a.value in ("w", "wb", "x", "a", "r+", "w+") for a in call.args
        )
    owner = ast.unparse(call.func.value) if isinstance(call.func, ast.Attribute) else ""
    return name in WRITERS - {"replace"} or (name == "replace" and owner == "os")


def test_a_slow_reader_never_sees_half_a_file(tmp_path):
    """While a file is rewritten many times, each look at it finds a whole one."""
    path = tmp_path / "rec.csv"
    texts = [str(digit) * 100_000 for digit in range(10)]
    write_atomically(path, lambda part: part.write_text(texts[0]))
    code = (
        "import sys, time; from gsid.base.files import write_atomically\n"
        "for i in range(60): write_atomically(sys.argv[1], lambda p: p.write_text(str(i % 10) * 100_000))"
    )
    with subprocess.Popen([sys.executable, "-c", code, path]) as process:
        while process.poll() is None:
            assert path.read_text() in texts
            time.sleep(0.001)
    assert process.returncode == 0
