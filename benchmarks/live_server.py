"""An experiment of `gsid studio`: cost of the server while it runs, and time from a stop to the STOP frame.

    live_server.py [--seconds S] [--samples N] [--stops M]

A page that reads every message watches a run on the paced simulated axis at 3 kHz for S seconds: the
processor time of the server alone, as a share of one core, and the pictures a second that arrive. Then the
lock-step axis delivers N samples: the growth of the server's memory, from the first figures to the end of the
run. Both are read from /proc, so that this needs Linux. At last M runs on a pseudo-terminal are stopped: the
time from the request to the line of STOP in the log of the axis. Exit status 1 if a limit is exceeded.
"""

from __future__ import annotations

import argparse
import http.client
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from websockets.sync.client import connect

GSID = [sys.executable, "-m", "gsid.cli.main"]
CPU_MOST, GROWTH_MOST_MB, STOP_MOST_MS = 0.30, 20.0, 100.0
FORM = {
    "port": "simulated",
    "fs": "3000",
    "period": "6000",
    "low": "1",
    "high": "250",
    "peak": "20",
    "settle": "1",
    "limit_command": "179",
    "limit_travel_deg": "90",
    "limit_rate": "300",
}
TIMEOUT_S = 30


class Page:
    """A page of the server, which reads every message."""

    def __init__(self, address: str) -> None:
        found = re.search(r":(\d+)/\?token=(\S+)", address)
        assert found
        self.port, token = int(found.group(1)), found.group(2)
        self.cookie = self.request("GET", f"/?token={token}", cookie="").headers["Set-Cookie"].split(";")[0]
        headers = {"Cookie": self.cookie}
        own = f"127.0.0.1:{self.port}"
        self._context = connect(f"ws://{own}/live", origin=f"http://{own}", additional_headers=headers)
        self._socket = self._context.__enter__()
        self._socket.send("")
        self.state: dict[str, Any] = {}
        self.read()

    def request(self, method: str, path: str, body: str = "", cookie: str | None = None) -> Any:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=TIMEOUT_S)
        headers = {
            "Cookie": self.cookie if cookie is None else cookie,
            "Origin": f"http://127.0.0.1:{self.port}",
        }
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        answer.text = answer.read().decode()
        connection.close()
        return answer

    def read(self) -> list[dict]:
        """The figures of the next message."""
        self.state = json.loads(self._socket.recv(timeout=TIMEOUT_S))
        self._socket.send("read")
        return self.state["figures"]

    def start(self, **more: Any) -> None:
        self.wait_until_idle()
        answer = self.request("POST", "/live/run", json.dumps(FORM | {"token": self.state["token"]} | more))
        assert answer.status == 200, answer.text
        number = self.state["run"]
        while self.state["run"] == number or not self.state["figures"]:
            self.read()

    def stop(self) -> None:
        self.request("POST", "/stop")
        while self.state["running"]:
            self.read()

    def wait_until_idle(self) -> None:
        while json.loads(self.request("GET", "/state").text)["job"]:
            time.sleep(0.2)


def processor_s(pid: int) -> float:
    """Processor time of a process so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_mb(pid: int) -> float:
    """Resident memory of a process [MB]."""
    found = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    assert found
    return int(found.group(1)) / 1000


def paced(page: Page, pid: int, seconds: float) -> dict[str, float]:
    """Share of a core, and pictures a second."""
    page.start(periods="1000")
    begin_s, used_s, n_sets = time.monotonic(), processor_s(pid), 0
    while (now_s := time.monotonic()) < begin_s + seconds:
        n_sets += len(page.read())
    share = (processor_s(pid) - used_s) / (now_s - begin_s)
    page.stop()
    return {"cores": round(share, 4), "pictures_per_s": round(n_sets / (now_s - begin_s), 2)}


def lock_step(page: Page, pid: int, samples: int) -> dict[str, float]:
    """Growth of the memory over a run of so many samples."""
    page.start(periods=str(samples // int(FORM["period"])), lock_step=True)
    before = most = memory_mb(pid)
    ticks = 0
    while page.state["running"]:
        figures = page.read()
        ticks = figures[-1]["ticks"] if figures else ticks
        most = max(most, memory_mb(pid))
    return {"samples": ticks, "before_mb": round(before, 1), "growth_mb": round(most - before, 2)}


def stops(page: Page, number: int) -> dict[str, float]:
    """Time from the request of a stop to the STOP frame at the axis [ms]."""
    begun_s = []
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "axis.csv"
        words = [*GSID, "simulate", "--paced", "--log", str(log)]
        axis = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert axis.stdout
        port = axis.stdout.readline().strip()
        try:
            for _ in range(number):
                page.start(port=port, periods="1000")
                begun_s.append(time.monotonic())
                page.stop()
        finally:
            axis.terminate()
            axis.wait(timeout=TIMEOUT_S)
        t_s, u = np.loadtxt(log, delimiter=",", skiprows=1, usecols=(0, 2)).T
    is_last = (
        np.diff(t_s, append=np.inf) > 0.2
    )  # nothing follows STOP; the axis's own stop goes on with ticks
    ms = [1e3 * (t_s[(t_s > begin_s) & is_last & (u == 0)][0] - begin_s) for begin_s in begun_s]
    return {"stops": number, "median_ms": round(float(np.median(ms)), 1), "most_ms": round(max(ms), 1)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--samples", type=int, default=10_000_000)
    parser.add_argument("--stops", type=int, default=20)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        server = subprocess.Popen(
            [*GSID, "studio", "--no-browser"], cwd=folder, stdout=subprocess.PIPE, text=True
        )
        try:
            assert server.stdout
            page = Page(server.stdout.readline())
            load = os.getloadavg()[0]
            found = {"paced": paced(page, server.pid, options.seconds)}
            found["lock_step"] = lock_step(page, server.pid, options.samples)
            found["stop"] = stops(page, options.stops)
        finally:
            server.terminate()
            server.wait(timeout=TIMEOUT_S)
    print(json.dumps(found | {"load_before": round(load, 2)}, indent=1))
    if found["lock_step"]["samples"] < options.samples // int(FORM["period"]) * int(FORM["period"]):
        print("error: the run in lock step ended before all samples were taken", file=sys.stderr)
        return 1  # the growth is that of a part
    good = found["paced"]["cores"] <= CPU_MOST and found["lock_step"]["growth_mb"] < GROWTH_MOST_MB
    return 0 if good and found["stop"]["most_ms"] <= STOP_MOST_MS else 1


if __name__ == "__main__":
    sys.exit(main())
