"""Calls of r2bspec in a forked process with little address space, and special files.

A reader that takes in too much fails here and not on somebody's machine. No time is asserted; the
limit of processor time only ends what would not end.
"""

from __future__ import annotations

import faulthandler
import importlib
import os
import resource
import signal
import sys
import tempfile
import traceback
from functools import cache
from pathlib import Path

import psutil

from run_simulation import Played, Simulation, objective

LONGEST_S = 60
_LONGEST_CPU_S = 30
_ADDRESS_SPACE = 600_000_000
"""What a call may use besides the interpreter with its libraries."""

LIVE = """\
r2bspec: 1
name: hostile
playback: {mode: live}
graph: {nodes: {n: {PLACE}}}
monitors: {output: {topic: output, format: std_msgs/msg/String}}
benchmark: {rates: [30 Hz]}
"""
"""A spec of one node, whose keys take the place of PLACE."""

ENDLESS = ("pipe", "itself", "zeros", "environment")
_LINKS = {"zeros": "/dev/zero", "environment": "/proc/self/environ"}


def make_special(path: Path, kind: str) -> None:
    """Make what is no usual regular file: one of `ENDLESS`, or ``terabyte``."""
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "terabyte":
            with path.open("wb") as stream:
                stream.truncate(10**12)
        case _:
            path.symlink_to(_LINKS.get(kind, path.name))


def small_run(folder: Path) -> Path:
    """Write the folder of a good run with one objective."""
    Simulation(
        segments=[Played(10, [0.01, 0.02])],
        objectives={"fast": objective("latency.p99 < 60 ms", at="10 Hz")},
    ).write(folder)
    return folder


@cache
def _import_everything() -> None:
    """Import what the verbs need once, and not in each process."""
    for name in ("api", "cli.validate", "check.engine", "datasets.catalogue", "judge.judge_run"):
        importlib.import_module(f"r2bspec.{name}")
    for name in ("numpy", "scipy.stats", "rosbags.rosbag2", "rosbags.typesys", "rich.console"):
        importlib.import_module(name)


def answered(
    *arguments: str | Path,
    cwd: Path,
    status: int | tuple[int, ...] = 2,
    says: str = "",
    stdin: bytes = b"",
) -> str:
    """Return what r2bspec prints; a traceback, a signal or another exit status is a failure."""
    _import_everything()
    with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as output:
        given.write(stdin)
        given.seek(0)
        child = os.fork()
        if not child:
            for place, stream in enumerate((given, output, output)):
                os.dup2(stream.fileno(), place)
            _answer([str(word) for word in arguments], cwd)
        _, ended = os.waitpid(child, 0)
        output.seek(0)
        said = output.read().decode()
    code = os.waitstatus_to_exitcode(ended)
    assert code in (status if isinstance(status, tuple) else (status,)), said[-2000:]
    assert "Traceback" not in said, said
    assert "\x1b" not in said
    assert says in said, said[:2000]
    return said


def _answer(arguments: list[str], folder: Path) -> None:
    """Be the process of one call; never returns."""
    code = 70
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CPU, (_LONGEST_CPU_S, _LONGEST_CPU_S + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        most = psutil.Process().memory_info().vms + _ADDRESS_SPACE
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        faulthandler.disable()  # that of pytest would write to the terminal
        signal.alarm(10 * _LONGEST_CPU_S)
        os.chdir(folder)
        sys.stdin, sys.stdout, sys.stderr = (open(n, m) for n, m in ((0, "r"), (1, "w"), (2, "w")))  # noqa: PTH123, SIM115
        from r2bspec.cli.main import main

        code = int(main(arguments))
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        os.write(2, traceback.format_exc().encode("utf-8", "replace"))
    finally:
        os._exit(code)
