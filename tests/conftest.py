"""What all tests share: programs that a test starts obey signals, however the tests were started."""

import signal


def _ignore_here_alone(number, frame):
    """Do nothing."""


# A shell's background job ignores SIGINT and SIGQUIT, nohup SIGHUP, and a program inherits that. It does not
# inherit a handler: with one, this process goes on ignoring the signal, and what it starts does not.
for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, _ignore_here_alone)
