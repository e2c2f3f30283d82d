"""The watchdog: cleans up a run whose controller has exited without doing so.

It reads lines from standard input: ``session N`` for every session that the controller opens, and
``done`` when the controller has cleaned up. If the input ends without ``done``, the controller was
killed: the watchdog then ends every process of the run, and removes their shared memory and the
scratch folder of the run. It runs in its own session, so that it does not receive signals to the
terminal or process group of the controller.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
import time
from pathlib import Path

from r2bspec.exit_status import ExitStatus
from r2bspec.ipc.process_cleanup import clean_up

_GRACE_S = 1.0


def main() -> int:
    """Read until the input ends; returns the exit status."""
    for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(each, signal.SIG_IGN)
    run_id, scratch = sys.argv[1], Path(sys.argv[2])
    # Shared memory may be as old as the run; the second allows for coarse time stamps.
    since_s = time.time() - 1.0
    sessions: set[int] = set()
    for line in sys.stdin:
        word, _, number = line.strip().partition(" ")
        if word == "done":
            return ExitStatus.OK
        if word == "session":
            sessions.add(int(number))
    clean_up(run_id, sessions - {os.getpid()}, grace_s=_GRACE_S, since_s=since_s)
    shutil.rmtree(scratch, ignore_errors=True)
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
