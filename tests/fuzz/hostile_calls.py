"""Calls of r2bspec in a process with little address space, and the files that they get.

A reader that takes in too much fails here and not on somebody's machine. No time is asserted; the
limit of time only ends what would not end.
"""

from __future__ import annotations

import os
import resource
import sqlite3
import subprocess
import sys
from pathlib import Path

MEMORY_BYTES = 900_000_000
LONGEST_S = 60

LIVE = """\
r2bspec: 1
name: hostile
playback: {mode: live}
graph: {nodes: {n: {PLACE}}}
monitors: {output: {topic: output, format: std_msgs/msg/String}}
benchmark: {rates: [30 Hz]}
"""
"""A spec of one node, whose keys take the place of PLACE."""

_LINKS = {
    "zeros": "/dev/zero",
    "terminal": "/dev/ptmx",
    "kernel log": "/proc/kmsg",
    "environment": "/proc/self/environ",
}
INSERT_RUN = "INSERT INTO runs VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, 1, '')"
"""Adds a run to a history."""
ENDLESS = ("pipe", "itself", *_LINKS)


def make_special(path: Path, kind: str) -> None:
    """Make what is no regular file, or no usual one: `ENDLESS`, ``folder`` or ``terabyte``."""
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
        case "terabyte":
            with path.open("wb") as stream:
                stream.truncate(10**12)
        case _:
            path.symlink_to(_LINKS.get(kind, path.name))


def r2bspec(
    *arguments: str | Path, cwd: Path, memory_bytes: int = MEMORY_BYTES, stdin: bytes = b""
) -> tuple[int, str]:
    """The exit status and all output; a traceback or a signal is a failure."""
    done = subprocess.run(
        [sys.executable, "-P", "-m", "r2bspec", *map(str, arguments)],
        capture_output=True,
        input=stdin,
        timeout=LONGEST_S,
        check=False,
        cwd=cwd,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes)),
    )
    said = (done.stdout + done.stderr).decode()
    assert "Traceback" not in said
    assert done.returncode in (0, 1, 2, 3, 4), said
    return done.returncode, said


def answered(
    *arguments: str | Path, cwd: Path, status: int | tuple[int, ...] = 2, says: str = ""
) -> str:
    """What r2bspec says, which ends with that status or with one of several."""
    ended, said = r2bspec(*arguments, cwd=cwd)
    assert ended in (status if isinstance(status, tuple) else (status,)), said
    assert says in said, said[:2000]
    return said


def change_database(file: Path, script: str, *values: str | bytes) -> None:
    """Execute statements in a database, or one of them with values."""
    with sqlite3.connect(file) as database:
        database.execute(script, values) if values else database.executescript(script)
    database.close()


def make_history(folder: Path) -> Path:
    """An empty history of runs."""
    from r2bspec.compare.history import open_history

    file = folder / "history.sqlite"
    with open_history(file, create=True):
        return file
