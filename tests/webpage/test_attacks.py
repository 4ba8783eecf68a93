"""What strangers and broken pages may try: each is refused, and the server still runs."""

import contextlib
import io
import json
import os
import re
import socket
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

DEADLINE_S = 60


@pytest.fixture(autouse=True)
def still_running(server, ask):
    yield
    assert server.process.poll() is None
    assert ask("GET", "/state").code == 200


def test_the_token_is_exchanged_for_a_cookie_that_other_sites_cannot_send(server, ask):
    answer = ask("GET", f"/?token={server.token}", cookie=None)
    assert answer.code == 200
    assert 'content="0;url=/"' in answer.text
    cookie = answer.headers["Set-Cookie"]
    assert cookie.startswith(f"gsid_studio_{server.port}=")
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert ask("GET", "/").code == 200


def test_the_token_is_no_cookie(server, ask):
    assert server.token not in server.cookie
    assert ask("GET", "/state", cookie=f"gsid_studio_{server.port}={server.token}").code == 403


@pytest.mark.parametrize("other", ['x={"a": 1}', "x=[1,2]", "=;;=", 'x="', "a/b=c"])
def test_a_cookie_of_another_program_does_not_lock_the_page(server, ask, other):
    assert ask("GET", "/state", cookie=f"{other}; {server.cookie}; {other}").code == 200


@pytest.mark.parametrize("value", [None, "wrong", "ü"])
@pytest.mark.parametrize(
    "path", ["/", "/state", "/plotly.min.js", "/files/session.json", "/static/studio.js"]
)
def test_without_the_token_nothing_is_shown(server, ask, path, value):
    name = server.cookie.split("=")[0]
    answer = ask("GET", path, cookie=value and f"{name}={value}".encode().decode("latin-1"))
    assert answer.code == 403
    assert "gsid studio printed" in answer.text


def test_a_wrong_token_is_refused(ask):
    assert ask("GET", "/?token=wrong", cookie=None).code == 403


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1", "[::1]:80", "127.0.0.1:1"])
def test_a_foreign_host_is_refused(ask, host):
    assert ask("GET", "/state", host=host).code == 403


@pytest.mark.parametrize(
    "origin", [None, "null", "http://evil.example", "https://127.0.0.1", "http://127.0.0.1:1"]
)
@pytest.mark.parametrize("path", ["/steps", "/stop", "/records?name=a.csv"])
def test_a_post_of_another_page_is_refused(ask, path, origin):
    assert ask("POST", path, {}, origin=origin).code == 403


@pytest.mark.parametrize("origin", ["http://evil.example", None])
def test_a_websocket_of_another_page_is_refused(server, origin):
    answer = handshake(server, origin)
    assert answer.split()[1] == b"403"


def test_the_own_page_gets_its_websocket(server):
    answer = handshake(server, f"http://127.0.0.1:{server.port}")
    assert answer.split()[1] == b"101"


def handshake(server, origin, path="/changes"):
    lines = [
        f"GET {path} HTTP/1.1",
        f"Host: 127.0.0.1:{server.port}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
        "Sec-WebSocket-Version: 13",
        f"Cookie: {server.cookie}",
    ]
    lines += [f"Origin: {origin}"] if origin else []
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as connection:
        connection.sendall("\r\n".join([*lines, "", ""]).encode())
        return connection.recv(4096)


@pytest.mark.parametrize(
    "path",
    [
        "/files/../secret",
        "/files/%2e%2e/secret",
        "/files//etc/hostname",
        "/static/../server.py",
        "/files/a%00b",
        "/static/a%00b",
        "/files/" + "a" * 5000,
        "/files/records",
    ],
)
def test_files_outside_the_study_are_not_served(server, ask, path):
    (server.folder.parent / "secret").write_text("the secret")
    answer = ask("GET", path)
    assert answer.code in (400, 404)
    assert "the secret" not in answer.text


def test_a_link_out_of_the_study_is_not_followed(server, ask):
    (server.folder.parent / "secret").write_text("the secret")
    (server.folder / "records/link.csv").symlink_to(server.folder.parent / "secret")
    assert ask("GET", "/files/records/link.csv").code == 400


def test_a_file_is_sent_to_be_saved_and_never_as_a_page(ask):
    page = b"<script>alert(1)</script>"
    assert ask("POST", "/records?name=page.html", page).code == 200
    answer = ask("GET", "/files/records/page.html")
    assert answer.headers["Content-Disposition"] == "attachment"
    assert answer.headers["Content-Type"] == "application/octet-stream"
    assert answer.headers["X-Content-Type-Options"] == "nosniff"


def test_scripts_come_from_this_server_only(ask):
    policy = ask("GET", "/").headers["Content-Security-Policy"]
    assert "script-src 'self';" in policy
    assert "default-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy


def test_an_upload_over_the_limit_is_refused_and_leaves_nothing(server, ask):
    answer = ask("POST", "/records?name=big.csv", b"0" * (1 << 20) + b"0")
    assert answer.code == 400
    assert "larger than 1 MB" in answer.text
    assert not (server.folder / "records/big.csv").exists()


@pytest.mark.parametrize(
    "name", ["", "..", "%2e%2e%2fsecret", ".hidden", "a%00b", "a%0ab", "a%e2%80%a8b", "a%c2%85b"]
)
def test_names_of_uploads_stay_in_the_study(server, ask, name):
    ask("POST", f"/records?name={name}", b"u,y\n")
    outside = {path.name for path in server.folder.parent.iterdir()}
    assert outside <= {"st", "secret", "server.log"}  # the second is of other tests
    kept = {path.name for path in (server.folder / "records").iterdir()}
    assert not any(one.startswith(".") or not one.isprintable() for one in kept)


REQUESTS = [
    {},
    {"verb": "doctor"},
    {"verb": "look", "records": ["--library=./evil.so:f"]},
    {"verb": "look", "records": ["../secret"]},
    {"verb": "look", "records": "records/a.csv"},
    {"verb": "look", "records": ["records/a.csv"], "options": {"--library": "./evil.so:f"}},
    {"verb": "look", "records": ["records/a.csv"], "options": {"--fs": "1e999"}},
    {"verb": "look", "records": ["records/a.csv"], "options": {"--u": "a\u0000b"}},
    {"verb": "look", "records": ["records/a.csv"], "options": {"--u": "a\u2028b"}},
    {"verb": "look", "records": ["records/a.csv"], "options": ["--u"]},
    {"verb": "compare", "records": ["records/a.csv"], "model": "../secret"},
    {"verb": "\ud800"},
    {"verb": ["look"]},
    {"verb": {"look": 1}},
    {"verb": "look", "records": ["records/a\u0000b"]},
    {"verb": "look", "records": ["records/\ud800"]},
    {"verb": "look", "records": ["records/" + "a" * 5000]},
    {"verb": "look", "records": ["records/a.csv"], "options": {"--period": 1e999}},
    {"verb": "look", "records": ["records/a.csv"], "options": {"--hold": ["zoh"]}},
    {"verb": "add", "records": ["records/a.csv"], "effect": ["friction"]},
    {"verb": "add", "records": ["records/a.csv"], "effect": "--undo"},
    {"verb": "add", "records": ["records/a.csv"], "effect": "__import__('os')"},
]


MODEL = json.dumps(
    {"gsid_model": 1, "fs_hz": 1000.0, "effects": [{"effect": "rigid_body", "params": {"gain": 7.4}}]}
)
CALL = "__import__('os').system('touch owned')"
REQUESTS += [
    {"verb": "add", "records": ["records/a.csv"], "model": "models/m.json", "law": CALL},
    {"verb": "add", "records": ["records/a.csv"], "model": "models/m.json", "law": ["w"]},
    {
        "verb": "add",
        "records": ["records/a.csv"],
        "model": "models/m.json",
        "law": "c*w",
        "params": {"c": CALL},
    },
    {"records": ["records/a.csv"], "model": "models/m.json", "edit": {"added": [{"law": CALL}]}},
    {"records": ["records/a.csv"], "model": "../m.json", "edit": {}},
    {"records": ["records/a.csv"], "model": "models/m.json", "edit": [CALL]},
]


@pytest.mark.parametrize("wanted", REQUESTS, ids=range(len(REQUESTS)))
def test_steps_that_are_not_offered_are_refused(server, ask, wanted):
    (server.folder.parent / "secret").write_text("")
    ask("POST", "/records?name=a.csv", b"u,y\n1,2\n")
    (server.folder / "models/m.json").write_text(MODEL)
    answer = ask("POST", "/steps", wanted)
    assert answer.code == 400
    assert "error" in answer.text
    assert not any("owned" in path.name for path in server.folder.parent.rglob("*"))


@pytest.mark.parametrize(
    "law", [CALL, "w.__class__", "(lambda: 1)()", "[1 for _ in w]", "open(w)", "9^9^9^9"]
)
def test_a_formula_is_parsed_and_never_run(server, ask, law):
    answer = ask("POST", "/law", {"law": law})
    assert answer.code == 200
    assert ("error" in json.loads(answer.text)) == (law != "9^9^9^9")
    assert not any("owned" in path.name for path in server.folder.parent.rglob("*"))


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b'{"law": ["w"]}', b'{"law": {"w": 1}}', b"0" * 100_000])
def test_a_law_that_is_no_text_is_refused(ask, body):
    assert ask("POST", "/law", body).code == 400


def test_the_workbench_of_another_page_is_refused(server):
    for origin in ("http://evil.example", None):
        assert handshake(server, origin, "/workbench").split()[1] == b"403"
    assert handshake(server, f"http://127.0.0.1:{server.port}", "/workbench").split()[1] == b"101"


WORKBENCH = [
    "",
    "[]",
    "{",
    "[" * 50_000,
    {"model": "../secret", "record": "records/a.csv"},
    {"model": "models/m.json", "record": "/etc/passwd"},
    {"model": "models/m.json", "record": "records/../../secret"},
    {"model": "models/m.json", "record": "records/a.csv", "options": {"--library": "./evil.so:f"}},
    {"model": "models/m.json", "record": "records/a.csv", "added": [{"law": CALL}]},
    {"model": "models/m.json", "record": "records/a.csv", "values": {"__class__": 1}},
    {"model": ["models/m.json"], "record": {"a": 1}},
]


def test_requests_to_the_workbench_that_are_not_valid_are_errors_in_words(server, ask):
    from websockets.sync.client import connect

    (server.folder.parent / "secret").write_text("the secret")
    (server.folder / "models/m.json").write_text(MODEL)
    ask("POST", "/records?name=a.csv", b"u,y\n1,2\n")
    own = f"127.0.0.1:{server.port}"
    headers = {"Cookie": server.cookie, "Origin": f"http://{own}"}
    with connect(f"ws://{own}/workbench", additional_headers=headers) as connection:
        for wanted in WORKBENCH:
            connection.send(wanted if isinstance(wanted, str) else json.dumps(wanted))
            answer = connection.recv(timeout=DEADLINE_S)
            assert json.loads(answer)["error"], wanted
            assert "the secret" not in answer
    assert not any("owned" in path.name for path in server.folder.parent.rglob("*"))


@pytest.mark.parametrize(
    "body", [b"", b"[]", b"{", b"\xff", b"0" * 100_000, b"[" * 50_000, b'{"a":' * 10_000, b"9" * 5000]
)
def test_a_body_that_is_no_step_is_refused(ask, body):
    assert ask("POST", "/steps", body).code == 400


def test_a_pickled_array_is_not_loaded(server, ask, tmp_path):
    class Evil:
        def __reduce__(self):
            return os.system, (f"touch {tmp_path}/owned",)

    np.savez(tmp_path / "evil.npz", u=np.array([Evil()], dtype=object), y=np.zeros(1))
    ask("POST", "/records?name=evil.npz", (tmp_path / "evil.npz").read_bytes())
    assert looked_at(ask, "records/evil.npz")["failed"]
    assert not (tmp_path / "owned").exists()


def looked_at(ask, record):
    """The step, when it has ended."""
    assert ask("POST", "/steps", {"verb": "look", "records": [record]}).code == 200
    end = time.monotonic() + DEADLINE_S
    while (state := json.loads(ask("GET", "/state").text))["job"]:
        assert time.monotonic() < end
        time.sleep(0.1)
    return state["steps"][-1]


# ---- size ------------------------------------------------------------------------------------------------

GB = 1 << 30


def peak_memory(server):
    """Of the process [bytes]."""
    status = Path(f"/proc/{server.process.pid}/status")
    if not status.exists():
        pytest.skip("the peak memory of a process is read from /proc, which this system lacks")
    return int(re.search(r"VmHWM:\s+(\d+) kB", status.read_text())[1]) * 1024


def test_a_small_archive_of_large_arrays_is_refused_by_its_size(server, ask, tmp_path):
    """Two members of 4 MB state 800 GB each."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**11,)})
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name in "uy":
            archive.writestr(f"{name}.npy", head.getvalue() + bytes(4 << 20))
    assert (tmp_path / "bomb.npz").stat().st_size < 1 << 16
    ask("POST", "/records?name=bomb.npz", (tmp_path / "bomb.npz").read_bytes())
    assert looked_at(ask, "records/bomb.npz")["failed"]


def test_a_small_archive_that_unpacks_to_much_costs_the_server_nothing(server, ask, tmp_path):
    """Two arrays of 128 MB: the command may read them, in its own process."""
    with zipfile.ZipFile(tmp_path / "zeros.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in "uy":
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                head = {"descr": "<i8", "fortran_order": False, "shape": (16 << 20,)}
                np.lib.format.write_array_header_1_0(member, head)
                for _ in range(128):
                    member.write(bytes(1 << 20))
    assert (tmp_path / "zeros.npz").stat().st_size < 1 << 20
    before = peak_memory(server)
    assert ask("POST", "/records?name=zeros.npz", (tmp_path / "zeros.npz").read_bytes()).code == 200
    assert looked_at(ask, "records/zeros.npz")["failed"]  # an output of zeros
    assert peak_memory(server) - before < 20 << 20


def test_an_upload_of_a_gigabyte_costs_neither_memory_nor_disk(server):
    """A browser reads the refusal after it has sent everything: the rest is read and dropped."""
    before, sent, block = peak_memory(server), 0, bytes(1 << 20)
    head = [
        "POST /records?name=large.csv HTTP/1.1",
        f"Host: 127.0.0.1:{server.port}",
        f"Origin: http://127.0.0.1:{server.port}",
        f"Cookie: {server.cookie}",
        f"Content-Length: {GB}",
    ]
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as connection:
        connection.sendall("\r\n".join([*head, "", ""]).encode())
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            while sent < GB:
                sent += connection.send(block[: GB - sent])
        assert connection.recv(4096).split()[1] == b"400"
    assert peak_memory(server) - before < 20 << 20
    assert not [path for path in server.folder.rglob("*") if "large" in path.name or ".upload" in path.name]
