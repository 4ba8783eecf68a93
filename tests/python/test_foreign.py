"""Foreign binary files: no byte of theirs may end the process, read another file or fill the memory."""

import os
import resource
import signal
import subprocess
import sys
import threading
import time
import zipfile

import h5py
import numpy as np
import pytest
from foreign_files import NAMES, U, Y, arrays, flipped, npy_claiming, write

from gsid.base.errors import InputError
from gsid.records import foreign
from gsid.records.files import read_record

pytestmark = pytest.mark.xdist_group("clock")  # CONTRIBUTING.md
KINDS = ["rec.mat", "recz.mat", "v73.mat", "rec.h5", "rec.npz", "rec.ulg"]
SEED, FLIPS = 140, 150


def names(path):
    return NAMES.get(path.suffix, {})


@pytest.fixture
def sound(tmp_path):
    write(tmp_path / "sound.npz")
    return tmp_path / "sound.npz"


@pytest.mark.parametrize("kind", KINDS)
def test_wrong_bytes_give_an_error_or_a_record(tmp_path, kind):
    """A bug: one wrong byte in a .mat ended the process (scipy's reader)."""
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    path = tmp_path / kind
    write(path)
    whole = path.read_bytes()
    assert len(read_record(path, **names(path))) == len(U)
    for _ in range(FLIPS):
        path.write_bytes(flipped(whole, rng))
        fault = None
        try:
            read_record(path, **names(path))
        except InputError as error:
            fault = error
        assert fault is None or (str(path) in fault.where and fault.hint)


@pytest.mark.parametrize("kind", KINDS)
def test_the_arrays_arrive_whole(tmp_path, kind):
    path = tmp_path / kind
    write(path)
    record = read_record(path, **names(path))
    tolerance = 1e-6 if kind == "rec.ulg" else 0
    np.testing.assert_allclose(record.u, U, rtol=tolerance)
    np.testing.assert_allclose(record.y, Y, rtol=tolerance)
    assert record.fs_hz == 250.0


# ---------------------------------------------------------------- what a file may not make us read


@pytest.fixture
def secret(tmp_path):
    path = tmp_path / "secret"
    path.write_bytes(os.urandom(8 * len(U)))
    return path


def h5(path, **entries):
    with h5py.File(path, "w") as file:
        file["u"], file.attrs["fs_hz"] = U, 250.0
        for name, value in entries.items():
            file[name] = value
    return path


def test_h5_external_storage_is_refused(tmp_path, secret):
    """A bug: /etc/passwd was read into y."""
    path = h5(tmp_path / "rec.h5")
    with h5py.File(path, "a") as file:
        file.create_dataset("y", (len(U),), "f8", external=[(str(secret), 0, 8 * len(U))])
    with pytest.raises(InputError, match="y is stored in other files") as caught:
        read_record(path)
    assert caught.value.hint


def test_h5_virtual_datasets_are_refused(tmp_path, secret):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["y"] = Y
    path = h5(tmp_path / "rec.h5")
    layout = h5py.VirtualLayout((len(Y),), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "y", (len(Y),))
    with h5py.File(path, "a") as file:
        file.create_virtual_dataset("y", layout)
    with pytest.raises(InputError, match="y is stored in other files"):
        read_record(path)


@pytest.mark.parametrize("behind_soft_link", [False, True])
def test_h5_external_links_are_refused(tmp_path, behind_soft_link):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["group/y"] = Y
    path = h5(tmp_path / "rec.h5")
    with h5py.File(path, "a") as file:
        if behind_soft_link:
            file["away"] = h5py.ExternalLink("other.h5", "/group")
            file["y"] = h5py.SoftLink("/away/y")
        else:
            file["y"] = h5py.ExternalLink("other.h5", "/group/y")
    with pytest.raises(InputError, match="y is a link to another file"):
        read_record(path)


def test_h5_links_inside_the_file_are_followed(tmp_path):
    path = h5(tmp_path / "rec.h5", **{"axis/gyro": Y})
    with h5py.File(path, "a") as file:
        file["axis/near"] = h5py.SoftLink("gyro")
        file["y"] = h5py.SoftLink("/axis/near")
    np.testing.assert_array_equal(read_record(path).y, Y)
    with h5py.File(path, "a") as file:
        del file["y"]
        file["y"] = h5py.SoftLink("/y")
    with pytest.raises(InputError, match="circular link"):
        read_record(path)


def test_h5_other_columns_that_point_elsewhere_are_left_alone(tmp_path, secret):
    path = h5(tmp_path / "rec.h5", y=Y, theta_deg=Y)
    with h5py.File(path, "a") as file:
        file.create_dataset("z", (len(U),), "f8", external=[(str(secret), 0, 8 * len(U))])
        file["away"] = h5py.ExternalLink("other.h5", "/y")
    assert list(read_record(path).columns) == ["theta_deg"]


@pytest.mark.parametrize("name", ["y", "z"])
def test_h5_declared_sizes_allocate_nothing(tmp_path, name):
    """A bug: 15 kB allocated 4.2 GB, whatever the dataset's name."""
    path = h5(tmp_path / "rec.h5", **({} if name == "y" else {"y": Y}))
    with h5py.File(path, "a") as file:
        file.create_dataset(name, (525_000_000,), "f8", chunks=(1000,))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    if name == "y":
        with pytest.raises(InputError, match=r"4\.2 GB declared"):
            read_record(path)
    else:
        assert len(read_record(path)) == len(U)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak < 50_000  # kB


def test_zip_bombs_are_refused_by_their_declared_size(tmp_path):
    path = tmp_path / "rec.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("y.npy", "w") as member:
        size = 1_100 * 2**20
        member.write(npy_claiming((size // 8,)))
        for _ in range(1_100):
            member.write(bytes(2**20))
    assert path.stat().st_size < 2e6
    start = time.monotonic()
    with pytest.raises(InputError, match=r"too large for its file.*1\.15 GB declared"):
        read_record(path)
    assert time.monotonic() - start < 5


def test_an_array_larger_than_its_member_is_damaged(tmp_path):
    path = tmp_path / "rec.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("u.npy", npy_claiming((10**9,), body=bytes(80)))
    with pytest.raises(InputError, match="damaged"):
        read_record(path)


def test_object_arrays_in_npz_are_refused(tmp_path):
    """Reading a pickled array would run what it says."""
    path = tmp_path / "rec.npz"
    np.savez(path, u=U, y=np.array([{"a": 1}] * len(U), dtype=object), fs_hz=250.0)
    with pytest.raises(InputError, match=r"y does not hold real numbers.*object"):
        read_record(path)


def test_a_string_array_in_npz_is_bad_input(tmp_path):
    path = tmp_path / "rec.npz"
    for name in ("u", "y", "t_s", "valid"):
        np.savez(path, **{**arrays(), name: np.array(["1.0"] * len(U))})
        with pytest.raises(InputError, match=f"{name} does not hold"):
            read_record(path)


def test_a_key_that_is_an_array_of_texts_is_no_column(tmp_path):
    """A bug: it was taken for a column of the record, and ended as a usage error."""
    np.savez(tmp_path / "rec.npz", **{**arrays(), "u_unit": np.array(["volt"] * len(U)), "hold": U * 1j})
    record = read_record(tmp_path / "rec.npz")
    assert (record.u_unit, record.hold, record.columns) == ("", None, {})


# ---------------------------------------------------------------- the worker


def test_one_worker_serves_all_files(tmp_path):
    workers = set()
    for kind in KINDS * 2:
        write(tmp_path / kind)
        read_record(tmp_path / kind, **names(tmp_path / kind))
        workers.add(foreign._worker.pid)
    assert len(workers) == 1


def test_the_worker_imports_little(sound):
    """Its start is paid by every command that reads a binary file."""
    script = [sys.executable, "-P", "-X", "importtime", foreign.__file__.replace("foreign.py", "child.py")]
    request = b'{"kind":"npz","path":"%s","arrays":["u","y"],"keys":[],"memory":1000000000,"seconds":9}\n'
    done = subprocess.run(script, input=request % str(sound).encode(), capture_output=True, check=True)
    assert len(done.stdout) > 16 * len(U)
    for heavy in (b"matplotlib", b"scipy", b"pandas", b"gsid"):
        assert heavy not in done.stderr


def stopped_worker(path):
    """A worker that does not answer."""
    read_record(path)
    os.kill(foreign._worker.pid, signal.SIGSTOP)
    return foreign._worker


def test_a_reader_that_takes_too_long_is_ended(sound, monkeypatch):
    stopped_worker(sound)
    monkeypatch.setattr(foreign, "SECONDS", 0.3)
    with pytest.raises(InputError, match=r"takes too long.*sound\.npz") as caught:
        read_record(sound)
    assert caught.value.hint
    monkeypatch.undo()
    assert len(read_record(sound)) == len(U)


def test_a_reader_that_crashes_names_the_file_and_the_signal(sound):
    worker = stopped_worker(sound)
    crash = threading.Timer(
        0.2, lambda: (worker.send_signal(signal.SIGSEGV), worker.send_signal(signal.SIGCONT))
    )
    crash.start()
    with pytest.raises(InputError, match=r"crashed its reader.*sound\.npz: signal SIGSEGV") as caught:
        read_record(sound)
    assert caught.value.hint
    assert len(read_record(sound)) == len(U)


def test_a_reader_short_of_memory_reports_it(sound, monkeypatch):
    read_record(sound)
    monkeypatch.setattr(foreign, "MEMORY_BYTES", 20_000_000)
    n = 4_000_000
    np.savez_compressed(sound, u=np.zeros(n), y=np.zeros(n), fs_hz=250.0)
    with pytest.raises(InputError, match=r"too large"):
        read_record(sound)
    monkeypatch.undo()
    assert len(read_record(sound)) == n


def test_the_interrupt_of_a_terminal_does_not_reach_the_worker(sound):
    read_record(sound)
    assert os.getpgid(foreign._worker.pid) != os.getpgid(0)


def test_threads_share_the_worker(tmp_path):
    paths, wrong = [], []
    for i in range(8):
        paths.append(tmp_path / f"{i}.npz")
        np.savez(paths[i], u=U + i, y=Y - i, fs_hz=250.0)

    def read(i):
        for _ in range(10):
            record = read_record(paths[i])
            if not (np.array_equal(record.u, U + i) and np.array_equal(record.y, Y - i)):
                wrong.append(i)

    threads = [threading.Thread(target=read, args=(i,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_a_fork_starts_a_worker_of_its_own(tmp_path, sound):
    """Two processes on one pipe would take each other's answers; a lock held at the fork would stay held."""
    stop = threading.Event()

    def busy():
        while not stop.is_set():
            read_record(sound)

    thread = threading.Thread(target=busy)
    thread.start()
    codes = []
    for _ in range(10):
        child = os.fork()
        if child == 0:
            signal.alarm(20)
            good = np.array_equal(read_record(sound).u, U)
            foreign._stop()
            os._exit(0 if good else 1)
        codes.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    stop.set()
    thread.join()
    assert codes == [0] * 10
    assert np.array_equal(read_record(sound).u, U)


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "rec.npz")
    with pytest.raises(InputError, match="not a regular file"):
        read_record(tmp_path / "rec.npz")
