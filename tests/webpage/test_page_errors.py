"""Errors of the server: a bad request is told from a disk that is full."""

import asyncio
import errno
import json

import pytest

from gsid.webpage import server


@pytest.mark.parametrize(
    ("error", "code", "what"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), 500, "the study cannot be read or written"),
        (PermissionError(errno.EACCES, "Permission denied"), 500, "the study cannot be read or written"),
        (OSError(errno.ENAMETOOLONG, "File name too long"), 400, "the request is not valid"),
        (ValueError("embedded null byte"), 400, "the request is not valid"),
    ],
)
def test_bug_a_full_disk_was_called_an_invalid_request(error, code, what):
    answer = asyncio.run(server._invalid(None, error))
    assert answer.status_code == code
    assert json.loads(answer.body)["error"] == what
