"""What every test starts from."""

from __future__ import annotations

import signal


def pytest_configure() -> None:
    """Let signals do what they usually do.

    Under nohup, and in a background job of a shell, they are ignored, by children of the tests as
    well: r2bspec respects that, and what is promised of them could not be seen.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
