"""Run the corpus of bad input through the command, each run in a process with limits: status, time, memory.

python tests/hostile/hostile_runs.py --verbs 2 --out runs.jsonl         # forks of one process: quick
python tests/hostile/hostile_runs.py --processes --out runs.jsonl       # a process of its own each

Each finished run is a line of the file. A call that finds lines there goes on: it leaves out what has ended
well, and runs again what was at fault.
"""

import argparse
import collections
import importlib
import json
import os
import pkgutil
import resource
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[1] / "false_alarms"))
from hostile_corpus import corpus
from sound_files import SEED, sound_files
from study import current_commit

from gsid.base.tables import Table

SECONDS, MEGABYTES = 10.0, 500.0
PATIENCE = 60  # s of the processor until a run is ended; ten times as long by the clock, on a busy computer
CONTROL = bytes([*range(9), *range(11, 32), 127])


def run(argv, folder, own_process):
    """Run one command in a folder: exit code (negative: signal), seconds of the processor, memory, output."""
    out = folder / "printed"
    start = time.monotonic()
    child = os.fork()
    if child == 0:
        _in_child(argv, folder, out, own_process)
    _, status, used = os.wait4(child, 0)
    wall, seconds = time.monotonic() - start, used.ru_utime + used.ru_stime
    code = os.waitstatus_to_exitcode(status)
    printed = out.read_bytes()
    return {
        "code": code,
        "seconds": seconds,
        "wall": wall,
        "megabytes": used.ru_maxrss / 1024,
        "printed": printed,
    }


def _in_child(argv, folder, out, own_process):
    code = 99
    try:
        signal.alarm(10 * PATIENCE)
        resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE))
        os.chdir(folder)
        fd = os.open(out, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(fd, 1)
        os.dup2(fd, 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if own_process:
            os.execv(sys.executable, [sys.executable, "-m", "gsid.cli.main", *argv])
        from gsid.cli.main import main

        code = main(argv)
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def faults(result):
    """What a run did that no bad input may cause."""
    found = []
    if result["code"] not in (0, 3):
        found.append(f"exit {result['code']}")
    if result["code"] == 3 and b"hint:" not in result["printed"]:
        found.append("no hint")
    if b"Traceback" in result["printed"]:
        found.append("traceback")
    if any(byte in CONTROL for byte in result["printed"]):
        found.append("control characters")
    if result["seconds"] > SECONDS:
        found.append(f"{result['seconds']:.0f} s")
    if result["megabytes"] > MEGABYTES:
        found.append(f"{result['megabytes']:.0f} MB")
    return found


def run_corpus(entries, n_verbs, own_process, ended=()):
    """Run every entry through some of its commands but those that have `ended`; yields one result each."""
    if not own_process:  # what every fork then has
        import h5py  # noqa: F401
        import matplotlib.figure  # noqa: F401
        import scipy.optimize
        import scipy.signal
        import scipy.stats  # noqa: F401

        import gsid

        for module in pkgutil.walk_packages(gsid.__path__, "gsid."):
            importlib.import_module(module.name)
    with tempfile.TemporaryDirectory() as place:
        for n, entry in enumerate(entries, 1):
            if n % 50 == 0:
                print(f"-- {n} of {len(entries)}", file=sys.stderr, flush=True)
            commands = [argv for argv in entry.commands[:n_verbs] if key(entry.name, argv) not in ended]
            if not commands:
                continue
            folder = Path(place) / "run"
            folder.mkdir()
            for name, content in (sound_files() | entry.files).items():
                (folder / name).parent.mkdir(exist_ok=True)
                (folder / name).write_bytes(content)
            for argv in commands:
                result = run(argv, folder, own_process)
                wrong = faults(result)
                printed = result.pop("printed").decode(errors="backslashreplace")[-600:]
                what = {"kind": entry.kind, "name": entry.name, "argv": argv, "faults": wrong}
                yield what | result | ({"printed": printed} if wrong else {})
            shutil.rmtree(folder)


def key(name, argv):
    """What tells a run from all others; the files of an entry bear its number."""
    return " ".join([*argv, "|", name])


def load(path):
    """The runs in a file that have ended well; the others, and a line that was cut, are removed from it."""
    lines = path.read_text().splitlines(keepends=True) if path.exists() else []
    runs = [json.loads(line) for line in lines if line.endswith("\n")]
    good = [one for one in runs if not one["faults"]]
    path.write_text("".join(json.dumps(one) + "\n" for one in good))
    return good


def show(result):
    """A run at fault, for people."""
    words = [result["kind"], result["name"][:60], " ".join(result["argv"]), result["faults"]]
    print(*words, result["printed"][-300:], sep=" | ", file=sys.stderr, flush=True)


def table(results):
    """One row for each class of fault, as Markdown."""
    head = ["class", "inputs", "runs", "exit 0", "exit 3", "others", "longest [s]", "largest [MB]"]
    rows = []
    by_kind = collections.defaultdict(list)
    for result in results:
        by_kind[result["kind"]].append(result)
    for kind, runs in [*by_kind.items(), ("all", results)]:
        codes = collections.Counter(r["code"] if r["code"] in (0, 3) else "other" for r in runs)
        inputs = len({(r["kind"], r["name"]) for r in runs})
        longest, largest = (max(r[key] for r in runs) for key in ("seconds", "megabytes"))
        counts = [len(runs), codes[0], codes[3], codes["other"], f"{longest:.1f}", f"{largest:.0f}"]
        rows.append(list(map(str, [kind, inputs, *counts])))
    return Table(head, rows, left=head).markdown()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--verbs", type=int, default=99, help="commands of each entry, at most")
    parser.add_argument("--processes", action="store_true", help="each run is a process of its own")
    parser.add_argument("--short", action="store_true", help="some entries of each class")
    parser.add_argument("--part", default="0/1", help="I/N: every N-th entry from I on")
    parser.add_argument("--only", default="", help="entries of this class")
    parser.add_argument(
        "--out", type=Path, default=os.devnull, help="write each run as a line of JSON, and go on there"
    )
    arguments = parser.parse_args()
    part, parts = map(int, arguments.part.split("/"))
    entries = [e for e in corpus(short=arguments.short) if arguments.only in ("", e.kind)][part::parts]
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    results, commit = load(arguments.out), current_commit()
    ended = {key(one["name"], one["argv"]) for one in results}
    print(f"seed {SEED}, {len(entries)} inputs, {len(ended)} runs made before", file=sys.stderr)
    with arguments.out.open("a") as file:
        for result in run_corpus(entries, arguments.verbs, arguments.processes, ended):
            results.append(result | {"commit": commit})
            file.write(json.dumps(results[-1]) + "\n")
            file.flush()
            if result["faults"]:
                show(result)
    print(f"seed {SEED}, code {', '.join(sorted({one['commit'] for one in results}))}\n\n{table(results)}")
    return any(r["faults"] for r in results)


if __name__ == "__main__":
    sys.exit(main())
