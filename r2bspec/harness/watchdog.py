"""The watchdog: cleans up a run whose controller has exited without doing so.

It reads lines from standard input: ``session N STARTED`` for every session that the controller
opens, ``collected N HELD`` when it has collected the first process of one
(`r2bspec.ipc.process_cleanup`), and ``done`` when the controller has cleaned up. If the input ends
without ``done``, the controller was killed: the watchdog then ends every process of the run, and
removes their shared memory and the folders of the run, its scratch folder first. It runs in its own
session, so that it does not receive signals to the terminal or process group of the controller.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

from r2bspec.errors import ExitStatus
from r2bspec.ipc.process_cleanup import ProcessSession, clean_up, now_ticks
from r2bspec.record.files import LOCK_FILE
from r2bspec.safe_io.private_files import remove_folder

_GRACE_S = 1.0


def main() -> int:
    """Read until the input ends, and return the exit status."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    run_id, scratch, *others = sys.argv[1], *map(Path, sys.argv[2:])
    # Shared memory may be as old as the run; the second allows for coarse time stamps.
    since_s = time.time() - 1.0
    sessions: dict[int, ProcessSession] = {}
    for line in sys.stdin:
        word, *numbers = line.split()
        if word == "done":
            return ExitStatus.OK
        if word == "session":
            pid, started = map(int, numbers)
            sessions[pid] = ProcessSession(pid, started)
        if word == "collected":
            pid, held = map(int, numbers)
            sessions[pid] = replace(sessions[pid], held=held)
    # From now on, the watchdog is not told when the others are collected.
    sessions = {
        pid: session if session.held is not None else replace(session, held=now_ticks())
        for pid, session in sessions.items()
        if pid != os.getpid()
    }
    clean_up(run_id, sessions.values(), grace_s=_GRACE_S, since_s=since_s)
    for folder in (scratch, *others):
        remove_folder(folder)
    # The kernel has freed the lock; no run takes a folder with files in it.
    with contextlib.suppress(OSError):
        (scratch.parent / LOCK_FILE).unlink()
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
