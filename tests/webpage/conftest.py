"""A server of the page in a process of its own, and requests to it."""

import http.client
import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

START_S = 60


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """A running `gsid studio`: its port, token, folder and process."""
    command = [
        sys.executable,
        "-m",
        "gsid.cli.main",
        "studio",
        "--no-browser",
        "--folder",
        "st",
        "--max-upload",
        "1",
    ]
    tmp_path = tmp_path_factory.mktemp("page")
    with open(tmp_path / "server.log", "w") as log:
        process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=log, text=True)
    try:
        port, token = re.search(r"127\.0\.0\.1:(\d+)/\?token=(\S+)", process.stdout.readline()).groups()
        cookie = cookie_of(int(port), token)
        yield SimpleNamespace(
            port=int(port), token=token, cookie=cookie, folder=Path(tmp_path) / "st", process=process
        )
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def cookie_of(port, token):
    """The cookie that the server gives for its token, as name=value."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=START_S)
    connection.request("GET", f"/?token={token}")
    cookie = connection.getresponse().headers["Set-Cookie"]
    connection.close()
    return cookie.split(";")[0]


@pytest.fixture
def ask(server):
    """A request as a browser of the page makes it; with changes as another page or program may try."""

    def ask(method, path, body=None, *, host=None, origin="own", cookie="own"):
        own = f"127.0.0.1:{server.port}"
        headers = {"Host": host or own}
        if origin:
            headers["Origin"] = f"http://{own}" if origin == "own" else origin
        if cookie:
            headers["Cookie"] = server.cookie if cookie == "own" else cookie
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=START_S)
        body = json.dumps(body) if isinstance(body, dict) else body
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        text = answer.read()
        connection.close()
        return SimpleNamespace(
            code=answer.status, text=text.decode("utf-8", "replace"), headers=answer.headers
        )

    return ask


@pytest.fixture
def studio(tmp_path):
    """Begin servers on the study `st`, each with its stderr in a file; all are ended with the test."""
    begun = []

    def studio(*more, waits=True, browser=False):
        words = [*more] if browser else ["--no-browser", *more]
        command = [sys.executable, "-m", "gsid.cli.main", "studio", "--folder", "st", *words]
        log = tmp_path / f"server-{len(begun)}.log"
        with open(log, "w") as errors:
            process = subprocess.Popen(
                command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=errors, text=True
            )
        begun.append(process)
        if waits:
            process.address = re.search(r"http://\S+", process.stdout.readline()).group()
        return process, log

    yield studio
    for process in begun:
        process.kill()
        process.communicate()
