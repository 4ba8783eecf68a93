"""End `gsid run` in eight ways at random moments, beside `gsid simulate --paced`, and judge what is left.

Two things are judged, both by the log of the axis (`gsid simulate --log`: the command as applied, with its
time), which shares nothing with the host's end of the line. The command is zero 0.25 s after the end. Every
period whose last sample the axis had sent 0.1 s before the end is in the record or in the journal, with the
command that the axis applied.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from gsid.base.tables import Table
from gsid.records.files import read_record
from gsid.records.record import Record
from gsid.rig.journal import recover

GSID = [sys.executable, "-m", "gsid.cli.main"]
PERIOD = 300
SETTLE = PERIOD
EXCITE = ["--period", str(PERIOD), "--band", "10:600", "--amplitude", "5", "--settle", str(SETTLE)]
ZERO_WITHIN_S = 0.25
KEPT_BEFORE_S = 0.1
LONGEST_S = 1.5  # from the first sample to the end of a run
RECORD, JOURNAL = Path("rec.csv"), Path("rec.csv.journal")

#: Ways to end a run, and the exit code of each.
WAYS = {
    "SIGINT": 130,
    "SIGINT twice": 130,
    "SIGTERM": 130,
    "SIGHUP": 130,
    "SIGQUIT": 130,
    "SIGKILL": -signal.SIGKILL,
    "full disk": 3,
    "pulled cable": 3,
}


@dataclass
class Trial:
    """What one run left.

    Attributes
    ----------
    way : str
    seed : int
    after_s : float
        From the first sample to the end.
    zero_s : float
        From the end to the last command other than zero; negative when it was earlier.
    n_due : int
        Periods whose last sample was sent 0.1 s before the end.
    n_kept : int
        Periods in the record or the journal.
    n_spoiled : int
        Of them, periods with lost samples.
    same_command : bool
        Whether the command in them is the one that the axis applied.
    kept_in : str
        "record" or "journal".
    exit_code : int
    told : bool
        Whether the message names the journal where it is what is left, and the process could speak.
    silence_s : float
        Longest silence of the host, by the record; 0 without one.
    """

    way: str
    seed: int
    after_s: float
    zero_s: float
    n_due: int
    n_kept: int
    n_spoiled: int
    same_command: bool
    kept_in: str
    exit_code: int
    told: bool
    silence_s: float

    @property
    def is_good(self) -> bool:
        """Whether the trial fulfils what is promised."""
        return (
            self.zero_s <= ZERO_WITHIN_S
            and self.n_kept >= self.n_due
            and self.same_command
            and self.exit_code == WAYS[self.way]
            and self.told
        )


@contextlib.contextmanager
def cable(port: str) -> Iterator[tuple[str, Callable[[], None]]]:
    """A line to the axis that can be pulled out: the host's path of it, and what pulls."""
    axis = os.open(port, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(axis)
    master, slave = os.openpty()
    tty.setraw(slave)
    path = os.ttyname(slave)
    pulled = threading.Event()

    def carry() -> None:
        while not pulled.is_set():
            ready, _, _ = select.select([axis, master], [], [], 0.01)
            for source in ready:
                with contextlib.suppress(OSError):
                    os.write(master if source == axis else axis, os.read(source, 4096))

    carrier = threading.Thread(target=carry)
    carrier.start()

    def pull() -> None:
        if not pulled.is_set():
            pulled.set()
            carrier.join()
            for file in (master, slave, axis):
                os.close(file)

    try:
        yield path, pull
    finally:
        pull()


def wait_for(condition: Callable[[], bool], timeout_s: float = 60.0) -> None:
    """Wait, and fail after a time."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"nothing happened within {timeout_s:g} s")
        time.sleep(0.005)


def size_of(path: Path) -> int:
    """Bytes of a file, 0 when there is none."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def start_host(port: str, folder: Path, file_bytes: int | None) -> subprocess.Popen:
    """`gsid run` for a long while, with a limit on the size of its files."""

    def prepare() -> None:
        # A shell's background job ignores SIGINT and SIGQUIT, nohup SIGHUP; `gsid run` keeps that.
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
            signal.signal(number, signal.SIG_DFL)
        if file_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, resource.RLIM_INFINITY))

    return subprocess.Popen(
        [*GSID, "run", "--port", port, *EXCITE, "--periods", "600", "-o", RECORD],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        preexec_fn=prepare,
    )


def end_host(
    way: str, host: subprocess.Popen, folder: Path, rng: np.random.Generator, pull: Callable
) -> float:
    """End the run; the time of it."""
    if way == "full disk":  # the last write that there was room for
        host.wait(timeout=120)
        return (folder / JOURNAL).stat().st_mtime - time.time() + time.monotonic()
    wait_for(lambda: host.poll() is not None or size_of(folder / JOURNAL) > 1500)
    time.sleep(rng.uniform(0, LONGEST_S))
    end_s = time.monotonic()
    if way == "pulled cable":
        pull()
    else:
        host.send_signal(getattr(signal, way.split()[0]))
        if way.endswith("twice"):
            time.sleep(rng.uniform(0, 0.4))
            host.send_signal(signal.SIGINT)
    return end_s


def run_trial(way: str, seed: int, folder: Path) -> Trial:
    """Run one trial in an empty folder."""
    rng = np.random.default_rng([seed, list(WAYS).index(way)])
    file_bytes = int(rng.integers(5_000, 50_000)) if way == "full disk" else None
    axis = subprocess.Popen(
        [*GSID, "simulate", "--paced", "--seed", str(seed + 1), "--log", "applied.csv"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=folder,
    )
    try:
        port = axis.stdout.readline().strip()
        with cable(port) if way == "pulled cable" else contextlib.nullcontext((port, None)) as (path, pull):
            host = start_host(path, folder, file_bytes)
            try:
                end_s = end_host(way, host, folder, rng, pull)
                words = host.communicate(timeout=60)[1]
            finally:
                host.kill()
                host.wait()
        time.sleep(max(0.0, end_s + 2 * ZERO_WITHIN_S - time.monotonic()))
    finally:
        axis.send_signal(signal.SIGTERM)
        axis.wait(timeout=60)
    return judge(way, seed, folder, end_s, host.returncode, words)


def judge(way: str, seed: int, folder: Path, end_s: float, exit_code: int, words: str) -> Trial:
    """Compare what is left with the log of the axis."""
    t_s, tick, u = np.loadtxt(folder / "applied.csv", delimiter=",", skiprows=1).T
    moving = u != 0
    sent = np.flatnonzero(moving & (t_s <= end_s - KEPT_BEFORE_S))
    n_sent = int(tick[sent].max()) + 1 if len(sent) else 0
    record = what_is_left(folder)
    first = np.flatnonzero(tick == 0)[-1]  # behind the line of HELLO
    applied = u[first : first + len(record.u)].astype(np.float32)
    kept = record.valid[: len(applied)]
    is_record = (folder / RECORD).exists()
    could_speak = way != "SIGKILL"
    return Trial(
        way=way,
        seed=seed,
        after_s=round(float(end_s - t_s[moving].min()), 3) if moving.any() else 0.0,
        zero_s=round(float(t_s[moving].max() - end_s), 3) if moving.any() else 0.0,
        n_due=max(0, n_sent - SETTLE) // PERIOD,
        n_kept=max(0, len(record.u) - SETTLE) // PERIOD,
        n_spoiled=int(record.meta["spoiled_periods"]),
        same_command=bool(np.array_equal(record.u[: len(applied)].astype(np.float32)[kept], applied[kept])),
        kept_in="record" if is_record else "journal",
        exit_code=exit_code,
        told=is_record or not could_speak or f"gsid run --recover {JOURNAL}" in words,
        silence_s=float(record.meta.get("longest_host_silence_s", 0)),
    )


def what_is_left(folder: Path) -> Record:
    """The record, or that of the journal."""
    if (folder / RECORD).exists():
        if (folder / JOURNAL).exists():
            raise AssertionError("record and journal are left both")
        return read_record(folder / RECORD)
    return recover(folder / JOURNAL).record


def table(trials: list[Trial]) -> str:
    """Markdown, a row for each way."""
    head = [
        "ended by", "runs", "command zero [ms]: median, latest", "periods due", "of them kept", "spoiled",
        "record / journal", "exit code", "fulfilled",
    ]  # fmt: skip
    rows = []
    for way, code in WAYS.items():
        of = [trial for trial in trials if trial.way == way]
        if not of:
            continue
        zero_ms = [1e3 * max(0.0, trial.zero_s) for trial in of]
        due = sum(trial.n_due for trial in of)
        kept = sum(min(trial.n_due, trial.n_kept) for trial in of)
        in_record = sum(trial.kept_in == "record" for trial in of)
        codes = sum(trial.exit_code == code for trial in of)
        rows.append(
            [
                way,
                f"{len(of)}",
                f"{np.median(zero_ms):.0f}, {max(zero_ms):.0f}",
                f"{due}",
                f"{kept}",
                f"{sum(trial.n_spoiled for trial in of)}",
                f"{in_record} / {len(of) - in_record}",
                f"{code}: {codes} of {len(of)}",
                f"{sum(trial.is_good for trial in of)} of {len(of)}",
            ]
        )
    return Table(head, rows, left=head[:1]).markdown()


def write_page(page: Path, text: str) -> None:
    """Put the table between the marks of the page."""
    before, _, rest = page.read_text().partition("<!-- table -->\n")
    _, _, after = rest.partition("<!-- end table -->")
    page.write_text(f"{before}<!-- table -->\n{text}\n<!-- end table -->{after}")


def main() -> int:
    """Run what is missing of the study; 1 when a trial does not fulfil what is promised."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="of each way")
    parser.add_argument(
        "--results", type=Path, required=True, help="one trial a line; those there are not run again"
    )
    parser.add_argument("--page", type=Path, help="whose table is written")
    options = parser.parse_args()
    lines = options.results.read_text().splitlines() if options.results.exists() else []
    trials = [Trial(**json.loads(line)) for line in lines]
    done = {(trial.way, trial.seed) for trial in trials}
    for seed in range(options.runs):
        for way in [way for way in WAYS if (way, seed) not in done]:
            with tempfile.TemporaryDirectory() as folder:
                trial = run_trial(way, seed, Path(folder))
            trials.append(trial)
            with options.results.open("a") as file:
                file.write(json.dumps(asdict(trial)) + "\n")
            print(f"{way}, seed {seed}: {'good' if trial.is_good else trial}", file=sys.stderr)
    print(text := table(trials))
    if options.page:
        write_page(options.page, text)
    return 0 if all(trial.is_good for trial in trials) else 1


if __name__ == "__main__":
    sys.exit(main())
