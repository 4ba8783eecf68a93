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
    process = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        port, token = re.search(r"127\.0\.0\.1:(\d+)/\?token=(\S+)", process.stdout.readline()).groups()
        yield SimpleNamespace(port=int(port), token=token, folder=Path(tmp_path) / "st", process=process)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


@pytest.fixture
def ask(server):
    """A request as a browser of the page makes it; with changes as another page or program may try."""

    def ask(method, path, body=None, *, host=None, origin="own", cookie="own"):
        own = f"127.0.0.1:{server.port}"
        headers = {"Host": host or own}
        if origin:
            headers["Origin"] = f"http://{own}" if origin == "own" else origin
        if cookie:
            headers["Cookie"] = f"gsid_studio={server.token if cookie == 'own' else cookie}"
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
