"""Calls of r2bspec in a process with little address space, and the files that they get.

A reader that takes in too much fails here and not on somebody's machine. No time is asserted; the
limit of time only ends what would not end.
"""

from __future__ import annotations

import faulthandler
import importlib
import os
import resource
import signal
import sqlite3
import sys
import tempfile
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import psutil

MEMORY_BYTES = 900_000_000
LONGEST_S = 60
LONGEST_CPU_S = 30
"""Ends what would not end."""

_IDLE_BYTES = 100_000_000
"""What a process of r2bspec needs that reads nothing."""
_IDLE_ADDRESS_SPACE = 250_000_000
"""The address space of the same, with its libraries."""

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


@dataclass(frozen=True)
class Answer:
    """What a call came to.

    Attributes:
        status: the exit status; negative for a signal.
        said: all output, standard error last.
        cpu_s: processor time.
        memory_bytes: the largest resident set, without what this process had before.
    """

    status: int
    said: bytes
    cpu_s: float
    memory_bytes: int


@cache
def import_everything() -> None:
    """Import what the verbs need once, and not in each process."""
    for name in ("api", "cli.validate", "check.engine", "datasets.catalogue", "judge.judge_run"):
        importlib.import_module(f"r2bspec.{name}")
    for name in ("numpy", "scipy.stats", "rosbags.rosbag2", "rosbags.typesys", "rich.console"):
        importlib.import_module(name)


def call(
    *arguments: str | Path,
    cwd: Path,
    environ: Mapping[str, str] = {},
    stdin: bytes = b"",
    address_space: int | None = None,
) -> Answer:
    """The answer of r2bspec in a forked process, which saves its start.

    Args:
        arguments: of the command line.
        cwd: the folder in which it is called.
        environ: added to the environment.
        stdin: what it can read.
        address_space: in bytes, with what the interpreter takes; None for no limit.
    """
    import_everything()
    before = psutil.Process().memory_info()
    more = None if address_space is None else before.vms + address_space - _IDLE_ADDRESS_SPACE
    with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as output:
        given.write(stdin)
        given.seek(0)
        child = os.fork()
        if not child:
            for place, stream in ((0, given), (1, output), (2, output)):
                os.dup2(stream.fileno(), place)
            _answer([str(word) for word in arguments], cwd, environ, more)
        _, status, usage = os.wait4(child, 0)
        output.seek(0)
        said = output.read()
    memory = _IDLE_BYTES + usage.ru_maxrss * 1024 - before.rss
    return Answer(os.waitstatus_to_exitcode(status), said, usage.ru_utime + usage.ru_stime, memory)


def _answer(
    arguments: list[str], folder: Path, environ: Mapping[str, str], address_space: int | None
) -> None:
    """Be the process of one call; never returns."""
    code = 70
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_CPU_S, LONGEST_CPU_S + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if address_space is not None:
            resource.setrlimit(resource.RLIMIT_AS, (address_space, address_space))
        faulthandler.disable()  # that of pytest would write to the terminal
        signal.alarm(10 * LONGEST_CPU_S)
        os.chdir(folder)
        os.environ.update(environ)
        sys.stdin, sys.stdout, sys.stderr = (open(n, m) for n, m in ((0, "r"), (1, "w"), (2, "w")))  # noqa: PTH123, SIM115
        from r2bspec.cli.main import main

        code = int(main(arguments))
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        os.write(2, traceback.format_exc().encode("utf-8", "replace"))
    finally:
        os._exit(code)


def r2bspec(
    *arguments: str | Path, cwd: Path, memory_bytes: int = MEMORY_BYTES, stdin: bytes = b""
) -> tuple[int, str]:
    """The exit status and all output; a traceback or a signal is a failure."""
    answer = call(*arguments, cwd=cwd, stdin=stdin, address_space=memory_bytes)
    said = answer.said.decode()
    assert "Traceback" not in said, said
    assert "R2B678" not in said, said  # the limit is ours
    assert answer.status in (0, 1, 2, 3, 4), said
    return answer.status, said


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


def small_run(folder: Path, segments: int = 1) -> Path:
    """The folder of a good run with one objective."""
    from run_simulation import Played, Simulation, objective

    Simulation(
        segments=[Played(10, [0.01, 0.02])] * segments,
        objectives={"fast": objective("latency.p99 < 60 ms", at="10 Hz")},
    ).write(folder)
    return folder
