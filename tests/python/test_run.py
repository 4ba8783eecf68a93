"""Whole runs over a pseudo-terminal, as they are typed."""

import contextlib
import json
import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from line import GSID, multisine, quiet_axis, simulator

from gsid.records.files import read_record
from gsid.response.estimate import frf
from gsid.rig.link import Link, LinkError
from gsid.rig.run import run
from gsid.rig.server import Damage, Server, pseudo_terminal, serve_line
from gsid.spectrum.realisation import spectra

pytestmark = pytest.mark.xdist_group("clock")  # CONTRIBUTING.md
EXCITE = ("--period", "600", "--band", "5:600", "--lines", "odd", "--amplitude", "8")


def gsid(*arguments: str, timeout: float = 60) -> subprocess.CompletedProcess:
    return subprocess.run([*GSID, *arguments], capture_output=True, text=True, timeout=timeout)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def noiseless_response(u: np.ndarray, line: np.ndarray) -> np.ndarray:
    """What the axis without noise answers to the same command after 8 s; it decays with 5.5 1/s."""
    n_periods = -(-24000 // len(u)) + 1
    u_applied, y, _ = quiet_axis().step(np.tile(u.astype(np.float32), n_periods))
    return (np.fft.rfft(y[-len(u) :]) / np.fft.rfft(u_applied[-len(u) :]))[line]


def chi_square(record, u: np.ndarray) -> tuple[float, float]:
    """Squared error over variance, mean over the lines, and what 5 sigma of chance allow.

    With P periods it is F(2, 2 (P - 1)) distributed: mean (P - 1) / (P - 2), standard deviation near 1.
    """
    measured = frf(record)
    error = np.abs(measured.g - noiseless_response(u, measured.line)) ** 2 / measured.var_g
    mean = (measured.n_periods - 1) / (measured.n_periods - 2)
    return error.mean() / mean, 5 * 1.2 / np.sqrt(len(error))


def test_a_run_in_volts_is_the_run_in_numbers_of_the_drive(folder):
    """179 on the line is 10 V: the same command, the same output; only the record's command is in volts."""
    axis = ("--simulate", "--linear --noise-scale 0")
    rest = ("--period", "600", "--band", "5:600", "--lines", "odd", "--periods", "2")
    for name, more in (
        ("numbers", ("--amplitude", "3.58")),
        ("volts", ("--amplitude", "0.2", "--scale", "179=10V", "--limit-command", "4.5")),
    ):
        made = gsid("run", *axis, *rest, *more, "-o", f"{name}.csv", "--json")
        assert made.returncode == 0, made.stderr
    numbers, volts = (read_record(f"{name}.csv") for name in ("numbers", "volts"))
    np.testing.assert_allclose(
        volts.u * 17.9, numbers.u, rtol=1e-5, atol=1e-5
    )  # single precision on the line
    np.testing.assert_allclose(volts.y, numbers.y, atol=1e-5)
    assert (volts.u_unit, numbers.u_unit) == ("V", "command")
    assert json.loads(made.stdout)["g_re"][3] == pytest.approx(17.9 * frf(numbers).g.real[3], rel=1e-4)
    assert gsid("cut", "numbers.csv", "--scale", "179=10V", "-o", "cut.csv").returncode == 0
    cut = read_record("cut.csv")
    np.testing.assert_allclose(cut.u, numbers.u / 17.9, rtol=1e-8, atol=1e-9)
    assert (cut.u_unit, len(cut)) == ("V", len(numbers))
    refused = gsid("run", *axis, *rest, "--amplitude", "3.58", "--scale", "179=10V", "--limit-command", "4.5")
    assert refused.returncode == 3
    assert "the planned command exceeds its limit" in refused.stderr


@pytest.mark.parametrize("scale", ["179", "179=10", "0=1V", "179=0V", "a=1V", "inf=1V"])
def test_a_scale_that_is_none_is_refused(folder, scale):
    refused = gsid("run", "--simulate", "", "--scale", scale)
    assert refused.returncode == 2
    assert "is not like 179=10V" in refused.stderr


def test_a_run_in_lock_step_measures_the_axis(folder):
    with simulator("--set", "fan_amplitude=0", "--truth", "truth.json", "--link", "axis") as (_, path):
        assert os.readlink("axis") == path
        done = gsid(
            "run", "--port", "axis", *EXCITE, "--periods", "12", "--settle", "10p", "-o", "a.npz", "--json"
        )
    assert done.returncode == 0, done.stderr
    assert not os.path.lexists("axis")
    summary = json.loads(done.stdout)
    record = read_record("a.npz")
    assert (summary["n_periods"], summary["n_spoiled"], summary["lost_samples"]) == (12, 0, 0)
    assert (record.period_samples, record.settle_samples, record.hold) == (600, 6000, "zoh")
    batch = frf(record)
    g = np.array(summary["g_re"]) + 1j * np.array(summary["g_im"])
    np.testing.assert_allclose(g, batch.g, rtol=1e-9, atol=1e-12)  # streamed while it ran, and from the file
    np.testing.assert_allclose(summary["var_g"], batch.var_g, rtol=1e-6)
    assert json.loads((folder / "truth.json").read_text())["delay_s"] == 0.0054


def test_a_damaged_line_loses_periods_but_not_the_truth(folder):
    """One frame in 20 000, periods of 6000: a quarter of them is lost, and no bias comes in."""
    u = multisine(6000, 400, 3.0)
    with simulator("--damage", "5e-5", "--seed", "11", "--set", "fan_amplitude=0") as (_, port):
        record = run(port, u, periods=40)
    good, spoiled = int(record.meta["good_periods"]), int(record.meta["spoiled_periods"])
    assert good == 40
    assert 3 <= spoiled <= 26  # 13 expected of 53, 4 standard deviations
    assert spectra(record).n_spoiled == spoiled
    ratio, chance = chi_square(record, u)
    assert abs(ratio - 1) < chance


def test_garbage_on_the_line_at_the_start(folder):
    with simulator("--set", "fan_amplitude=0") as (_, port):
        fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
        os.write(fd, b"\xa5\x5a\x01 what an earlier host left \xa5\x5a")
        time.sleep(0.1)
        os.close(fd)
        record = run(port, multisine(600), periods=4)
    assert record.valid.all()


def test_a_line_too_bad_stops_the_run_and_keeps_what_there_is(folder):
    with simulator("--damage", "0.01", "--seed", "2") as (_, port):
        done = gsid("run", "--port", port, "--period", "6000", "--periods", "12", "-o", "bad.csv")
    assert done.returncode == 3
    assert "too many periods are lost" in done.stderr
    assert "hint:" in done.stderr
    record = read_record("bad.csv")
    assert len(record) == 12000 + 8 * 6000
    assert 0 < np.count_nonzero(~record.valid) < len(record)


def test_paced_runs_by_the_clock(folder):
    with simulator("--paced") as (process, port):
        start = time.monotonic()
        record = run(port, multisine(600), periods=4, settle=600)
        took = time.monotonic() - start
        process.terminate()
        words = process.stderr.read()
    assert record.meta["good_periods"] == "4"
    assert 3000 / 3000 <= took < 3000 / 3000 + 4  # 3000 ticks at 3 kHz, and a machine that is busy
    assert "ms behind the clock" in words


def started(port: str, *options: str) -> subprocess.Popen:
    """`gsid run` for a long while."""
    return subprocess.Popen(
        [*GSID, "run", "--port", port, *EXCITE, "--periods", "1000", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell's background job ignores Ctrl-C, and so would what it starts.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def has_open(process: subprocess.Popen, path: str) -> bool:
    for fd in Path(f"/proc/{process.pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed since it was listed
            if os.readlink(fd) == path:
                return True
    return False


def wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < end, "waited for 30 s"
        time.sleep(0.01)


def test_ctrl_c_leaves_the_command_at_zero_and_the_record(folder):
    server = Server(quiet_axis(), paced=True)
    with pseudo_terminal() as (axis_fd, host_fd, port):
        line = Thread(target=serve_line, args=(server, axis_fd, host_fd, Damage(0), Damage(0), True))
        line.start()
        process = started(port, "-o", "half.csv")
        wait_until(lambda: server.served.ticks > 3000)
        process.send_signal(signal.SIGINT)
        _, words = process.communicate(timeout=120)
        line.join()
    assert not server.running
    assert process.returncode == 130
    assert "stopped" in words
    record = read_record("half.csv")
    assert len(record) >= 2400  # whole periods
    assert record.meta["command_zero_confirmed"] == "yes"


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGQUIT"])
def test_a_signal_leaves_the_command_at_zero_and_the_record(folder, name):
    """SIGHUP and Ctrl-\\ sent no STOP, and lost everything."""
    server = Server(quiet_axis(), paced=True)
    with pseudo_terminal() as (axis_fd, host_fd, port):
        line = Thread(target=serve_line, args=(server, axis_fd, host_fd, Damage(0), Damage(0), True))
        line.start()
        process = started(port, "-o", "half.csv")
        wait_until(lambda: server.served.ticks > 3000)
        process.send_signal(getattr(signal, name))
        _, words = process.communicate(timeout=120)
        line.join()
    assert not server.running
    assert process.returncode == 130
    assert f"{name}: the run is stopped" in words
    assert len(read_record("half.csv")) >= 2400
    assert not Path("half.csv.journal").exists()


def test_a_second_ctrl_c_loses_nothing(folder):
    """It came while STOP was under way or the record was written: both were in vain."""
    with simulator("--paced") as (_, port):
        process = started(port, "-o", "half.csv")
        wait_until(
            lambda: Path("half.csv.journal").is_file() and Path("half.csv.journal").stat().st_size > 30_000
        )
        for _ in range(40):
            process.send_signal(signal.SIGINT)
            time.sleep(0.01)
        process.communicate(timeout=120)
    assert process.returncode == 130
    assert len(read_record("half.csv")) >= 2400
    assert read_record("half.csv").meta["command_zero_confirmed"] == "yes"
    assert os.listdir() == ["half.csv"]


def test_a_killed_run_is_recovered_from_its_journal(folder):
    with simulator("--paced", "--log", "applied.csv") as (axis, port):
        process = started(port, "-o", "half.csv")
        wait_until(  # nine periods: a busy computer may spoil some
            lambda: Path("half.csv.journal").is_file() and Path("half.csv.journal").stat().st_size > 60_000
        )
        process.kill()
        killed_s = time.monotonic()
        process.communicate(timeout=120)
        time.sleep(0.5)
        axis.terminate()
        axis.wait()
    t_s, _, u = np.loadtxt("applied.csv", delimiter=",", skiprows=1).T
    assert t_s[u != 0].max() < killed_s + 0.25
    assert t_s.max() > killed_s + 0.3
    again = gsid("run", "--port", "nowhere", "-o", "half.csv")
    assert (again.returncode, "journal of an earlier run" in again.stderr) == (3, True)
    assert "gsid run --recover half.csv.journal" in again.stderr
    done = gsid("run", "--recover", "half.csv.journal", "--json")
    assert done.returncode == 0, done.stderr
    record = read_record("half.csv")
    assert json.loads(done.stdout)["n_periods"] == int(record.meta["good_periods"]) >= 1
    assert (len(record) - record.settle_samples) % 600 == 0
    assert record.meta["recovered_from"] == "half.csv.journal"
    twice = gsid("run", "--recover", "half.csv.journal")
    assert (twice.returncode, "name the record with -o" in twice.stderr) == (3, True)


def test_a_record_that_cannot_be_written_leaves_the_journal(folder):
    """A disk that is full at the end: the record is five times as large as the journal."""
    limited = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (60000, -1));"
        "from gsid.cli.main import main; sys.exit(main())"
    )
    with simulator() as (_, port):
        done = subprocess.run(
            [sys.executable, "-c", limited, "run", "--port", port, *EXCITE, "--periods", "6", "-o", "a.csv"],
            capture_output=True,
            text=True,
        )
    assert done.returncode == 3, done.stderr
    assert "the record cannot be written" in done.stderr
    assert "gsid run --recover a.csv.journal -o REC" in done.stderr
    assert os.listdir() == ["a.csv.journal"]
    assert gsid("run", "--recover", "a.csv.journal", "-o", "b.npz").returncode == 0
    record = read_record("b.npz")
    assert (record.meta["good_periods"], len(record)) == ("6", 8 * 600)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--recover", "none.journal"), 3, "none.journal"),
        (("--recover", "text.journal"), 3, "not a journal of gsid run"),
        (("--recover", "text.journal", "--period", "600"), 2, "leave out --period"),
        (("--recover", "text.journal", "--port", "nowhere"), 2, "leave out --port"),
        (("--recover", "text.journal", "-o", "text.journal"), 3, "text"),
    ],
)
def test_what_cannot_be_recovered_is_refused(folder, arguments, code, words):
    Path("text.journal").write_text("u,y\n")
    done = gsid("run", *arguments)
    assert (done.returncode, words in done.stderr) == (code, True), done.stderr
    assert Path("text.journal").read_text() == "u,y\n"


def test_a_record_to_the_standard_output(folder):
    """The name - was tried out as a file, and refused."""
    with simulator() as (_, port):
        done = gsid("run", "--port", port, *EXCITE, "--periods", "2", "-o", "-")
    assert done.returncode == 0, done.stderr
    (folder / "a.csv").write_text(done.stdout)
    assert read_record("a.csv").meta["good_periods"] == "2"
    assert os.listdir() == ["a.csv"]


def test_a_signal_while_the_record_is_written_does_not_lose_it(folder):
    """The run is whole by then; the exit code tells of the signal all the same."""
    signalled = (
        "import os, signal, sys; from gsid.records import files; write = files.write_record\n"
        "def slow(path, record):\n"
        "    os.kill(os.getpid(), signal.SIGTERM) if str(path) == 'a.csv' else None\n"
        "    os.kill(os.getpid(), signal.SIGINT) if str(path) == 'a.csv' else None\n"
        "    write(path, record)\n"
        "files.write_record = slow\n"
        "from gsid.cli.main import main; sys.exit(main())"
    )
    with simulator() as (_, port):
        done = subprocess.run(
            [
                sys.executable,
                "-c",
                signalled,
                "run",
                "--port",
                port,
                *EXCITE,
                "--periods",
                "2",
                "-o",
                "a.csv",
            ],
            capture_output=True,
            text=True,
        )
    assert done.returncode == 130, done.stderr
    assert read_record("a.csv").meta["good_periods"] == "2"
    assert os.listdir() == ["a.csv"]


def test_ctrl_c_without_a_reply_from_the_axis(folder):
    with pseudo_terminal() as (_, _, port):
        process = started(port, "-o", "none.csv")
        wait_until(lambda: has_open(process, port))
        process.send_signal(signal.SIGINT)
        start = time.monotonic()
        process.communicate(timeout=120)
    assert process.returncode == 130
    assert time.monotonic() - start < 5  # STOP is sent three times
    assert not os.listdir()


def test_a_terminal_that_is_closed_does_not_lose_the_record(folder):
    """Its end sends SIGHUP, and every word to it fails from then on."""
    with simulator("--paced") as (_, port):
        terminal, end = pty.openpty()
        process = subprocess.Popen(
            [*GSID, "run", "--port", port, *EXCITE, "--periods", "1000", "-o", "half.csv"],
            stdin=end,
            stdout=end,
            stderr=end,
            start_new_session=True,
        )
        os.close(end)
        wait_until(
            lambda: Path("half.csv.journal").is_file() and Path("half.csv.journal").stat().st_size > 30_000
        )
        os.close(terminal)
        process.send_signal(signal.SIGHUP)
        assert process.wait(timeout=60) == 130
    assert read_record("half.csv").meta["command_zero_confirmed"] == "yes"
    assert os.listdir() == ["half.csv"]


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        (("--limit-command", "5"), "the planned command exceeds its limit"),
        (("--limit-rate", "2"), "rate "),
        (("--limit-travel-deg", "0.05"), "travel [deg] "),
    ],
)
def test_a_limit_ends_the_run(folder, limit, words):
    with simulator("--log", "applied.csv") as (axis, port):
        done = gsid("run", "--port", port, *EXCITE, "--periods", "4", "-o", "a.csv", *limit)
        axis.terminate()
        axis.wait()
    assert (done.returncode, words in done.stderr) == (3, True), done.stderr
    assert "limit" in done.stderr
    u = np.array([line.split(",")[2] for line in Path("applied.csv").read_text().splitlines()[1:]], float)
    assert np.count_nonzero(u) < 3000
    assert Path("a.csv").exists() == (limit[0] != "--limit-command")
    assert not Path("a.csv.journal").exists()


def test_an_axis_that_disappears_is_a_clear_error(folder):
    with simulator("--paced") as (axis, port):
        process = started(port, "-o", "half.npz")
        wait_until(lambda: has_open(process, port))
        time.sleep(1)  # 3000 ticks
        axis.terminate()
        _, words = process.communicate(timeout=120)
    assert process.returncode == 3
    assert "the port is gone" in words
    assert "hint:" in words
    assert len(read_record("half.npz")) > 0


def test_once_ends_when_the_host_leaves(folder):
    with simulator("--once") as (process, port):
        with Link.open(port) as host:
            host.hello()
        assert process.wait(timeout=10) == 0


def test_json_of_the_simulator(folder):
    with simulator("--json", "--linear", "--coulomb", "2", "--noise-scale", "0.5", "--seed", "9") as (
        _,
        line,
    ):
        made = json.loads(line)
    assert os.path.dirname(made["port"]) == "/dev/pts"
    parameters = made["parameters"]
    assert (parameters["coulomb_level"], parameters["command_limit"], parameters["seed"]) == (2.0, 0.0, 9)
    assert parameters["noise_rms"] == pytest.approx(0.005)


def test_an_excitation_from_a_file(folder):
    assert gsid("design", "multisine", "--fs", "3000", *EXCITE, "-o", "u.csv").returncode == 0
    with simulator("--noise-scale", "0") as (_, port):
        done = gsid("run", "--port", port, "--u", "u.csv", "--periods", "2", "-o", "a.csv", "--json")
        assert done.returncode == 0, done.stderr
        again = gsid("run", "--port", port, *EXCITE, "--periods", "2", "-o", "b.csv", "--json")
    np.testing.assert_array_equal(read_record("a.csv").y, read_record("b.csv").y)
    one, two = json.loads(done.stdout), json.loads(again.stdout)
    assert one["f_hz"] == two["f_hz"]


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--port", "nowhere"), 3, "the port cannot be opened"),
        (("--port", "nowhere", "--band", "5:4"), 2, "below HI"),
        (("--port", "nowhere", "--band", "5:2000"), 2, "the nearest valid request is 5:1499.5 Hz"),
        (("--port", "nowhere", "--settle", "2q"), 2, "neither a number of samples"),
        (("--port", "nowhere", "-o", "rec.xyz"), 3, "cannot write this kind of file"),
        (("--port", "nowhere", "-o", "no/such/rec.csv"), 3, "the folder does not exist"),
        (("--port", "nowhere", "--u", "u.csv", "--band", "1:2"), 2, "leave out --band"),
        (("--port", "nowhere", "--u", "none.csv"), 3, "none.csv"),
        (("--port", "nowhere", "--plot", "a.txt"), 2, "--plot draws .png, .svg, .pdf, .json only"),
        (("--port", "nowhere", "--plot", "a.png", "--periods", "1"), 2, "give --periods 2 or more"),
        (("--port", "nowhere", "--limit-rate", "inf"), 2, "inf is not a finite number"),
        (("--port", "nowhere", "--limit-command", "nan"), 2, "nan is not a finite number"),
        (("--port", "nowhere", "--periods", "1000000000000"), 3, "6e+15 samples with settling, limit 1e+08"),
        (("--port", "nowhere", "--period", "1000000000000"), 3, "the run is too long"),
        (("--port", "nowhere", "--settle", "1000000000000"), 3, "the run is too long"),
        ((), 2, "--port"),
    ],
)
def test_errors_are_reported_before_the_axis_moves(folder, arguments, code, words):
    done = gsid("run", *arguments)
    assert (done.returncode, words in done.stderr) == (code, True), done.stderr
    assert "hint:" in done.stderr
    assert not list(folder.iterdir())


def test_a_run_draws_the_response_that_it_measured(folder):
    with simulator() as (_, port):
        done = gsid("run", "--port", port, *EXCITE, "--periods", "2", "-o", "a.csv", "--plot", "a.png")
    assert done.returncode == 0, done.stderr
    assert "wrote a.png" in done.stderr
    assert (folder / "a.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("output", ["rec.csv", "-"])
def test_bug_a_text_that_csv_cannot_store_was_found_after_the_run(folder, output):
    """The excitation's file name and the port are texts of the record."""
    (folder / "u.csv").write_text("t_s,u\n" + "".join(f"{n / 3000:.9f},{n}\n" for n in range(600)))
    (folder / "u.csv").rename(folder / "u\n2.csv")
    before = sorted(folder.iterdir())
    for arguments, key in (
        (("--port", "nowhere", "--u", "u\n2.csv"), "excitation"),
        (("--port", "no\nwhere", *EXCITE), "port"),
    ):
        done = gsid("run", *arguments, "-o", output)
        assert done.returncode == 3
        assert f"CSV cannot store the value of {key}" in done.stderr
        assert "hint: rename it, or write .npz, .mat or .h5" in done.stderr
    assert sorted(folder.iterdir()) == before
    done = gsid("run", "--port", "nowhere", "--u", "u\n2.csv", "-o", "rec.npz")
    assert "the port cannot be opened" in done.stderr


def test_bug_a_command_beyond_single_precision_was_a_usage_error(folder):
    """Its spectrum is not finite, and no line of it was found."""
    (folder / "u.csv").write_text("t_s,u\n" + "".join(f"{n / 3000:.9f},1e308\n" for n in range(600)))
    done = gsid("run", "--port", "nowhere", "--u", "u.csv", "-o", "rec.csv")
    assert done.returncode == 3
    assert "u is too large for the line" in done.stderr
    assert "Warning" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--set", "gian=3"), 2, "did you mean gain?"),
        (("--set", "gain"), 2, "not NAME=VALUE"),
        (("--set", "gain=x"), 2, "is not a number"),
        (("--coulomb", "-1"), 2, "out of its range"),
        (("--link", "."), 3, "a file of that name exists"),
        (("--link", "mine"), 3, "a link of that name exists, which this simulation did not create"),
    ],
)
def test_faults_of_the_simulator_are_reported(folder, arguments, code, words):
    """A link of another was deleted."""
    os.symlink("/dev/pts/999999", "mine")
    done = gsid("simulate", *arguments)
    assert (done.returncode, words in done.stderr) == (code, True), done.stderr
    assert done.stdout == ""
    assert os.readlink("mine") == "/dev/pts/999999"


def test_one_port_is_for_one_host(folder):
    with simulator() as (_, port), Link.open(port), pytest.raises(LinkError, match="cannot be opened"):
        Link.open(port)
