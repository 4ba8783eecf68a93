"""What all tests share: one thread for small matrices, programs that obey signals, a fixture for pages.

With more threads they wait for each other: some tests take five times the processor time on busy cores.
"""

import os
import signal

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded


def _ignore_here_alone(number, frame):
    """Do nothing."""


# A shell's background job ignores SIGINT and SIGQUIT, nohup SIGHUP, and a program inherits that. It does not
# inherit a handler: with one, this process goes on ignoring the signal, and what it starts does not.
for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, _ignore_here_alone)


@pytest.fixture
def undrawn(monkeypatch):
    """Write pages without drawing their figures, which takes most of the time: for tests of a page's text."""
    from gsid.report import pictures  # not before the folders' own conftest.py

    def empty(_figure, prefix, label, kind):
        return pictures.Markup('<svg id="{}" class="{}" aria-label="{}"></svg>').format(prefix, kind, label)

    monkeypatch.setattr(pictures, "inline_svg", empty)
