"""How many hostile inputs of every family are answered cleanly; 100 % is what is required.

An answer is clean if it has a documented exit status other than that of an internal error, and a
message if it is no success; if it has no traceback, no control character and no secret; and if it
took less than 500 MB of memory, and few seconds of CPU. Each call is made in a process of its own,
so that a crash or a hang is one, too. `readers` has what is a file of one reader.
"""

from __future__ import annotations

import faulthandler
import os
import random
import re
import resource
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import psutil
from hostile_inputs import SECRET, SECRET_NAME, Prototypes, families

MEMORY_BYTES = 500_000_000
_IDLE_BYTES = 100_000_000
"""What a process of r2bspec needs that reads nothing."""
LONGEST_CPU_S = 30
"""Ends what would not end."""

_CONTROL = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]|\xc2[\x80-\x9f]|\xe2\x80[\xaa-\xae]")
_PIECE = 8
"""A piece of a secret of this length must not be shown: enough to guess by."""


@dataclass
class Tally:
    """The answers of a run.

    Attributes:
        unclean: a line for each answer that is not clean.
    """

    calls: Counter[str] = field(default_factory=Counter)
    clean: Counter[str] = field(default_factory=Counter)
    unclean: list[str] = field(default_factory=list)

    def lines(self) -> Iterator[str]:
        """The shares of clean answers."""
        for family, number in self.calls.items():
            yield f"{family:<26} {self.clean[family]:>6} of {number:>6}"
        clean, calls = self.clean.total(), self.calls.total()
        yield f"clean answers: {clean} of {calls} ({100 * clean / max(calls, 1):.1f} %)"


def run_inputs(folder: Path, numbers: Iterator[int], seed: int, cpu_s: float) -> Tally:
    """Give r2bspec inputs of each family; `numbers` says which, and when to stop."""
    (folder / "prototypes").mkdir()
    known = families(Prototypes(folder / "prototypes"))
    tally = Tally()
    import_everything()
    for number in numbers:
        for family, make in known.items():
            # Not the hash of a tuple, which is another in each process.
            rng = random.Random(f"{seed} {number} {family}")  # noqa: S311 - nothing is secret
            place = folder / f"{number} {family}"
            place.mkdir()
            made = make(rng, place)
            for arguments in made.calls:
                tally.calls[family] += 1
                wrong = call(arguments, place, cpu_s)
                if wrong:
                    words = " ".join(arguments)
                    tally.unclean.append(f"{family} {number} ({made.name}): {words}: {wrong}")
                else:
                    tally.clean[family] += 1
    return tally


def import_everything() -> None:
    """Import what the verbs need once, and not in each process."""
    import importlib

    for name in ("api", "cli.validate", "check.engine", "datasets.catalogue", "judge.judge_run"):
        importlib.import_module(f"r2bspec.{name}")
    for name in ("numpy", "scipy.stats", "rosbags.rosbag2", "rosbags.typesys", "rich.console"):
        importlib.import_module(name)


def call(arguments: tuple[str, ...], folder: Path, cpu_s: float) -> str:
    """Why an answer is not clean; empty if it is."""
    output = folder / ".said"
    # A forked process begins with the memory of this one, which may be a whole run of tests.
    before = psutil.Process().memory_info().rss
    child = os.fork()
    if not child:
        _answer(arguments, folder, output)
    _, status, usage = os.wait4(child, 0)
    said = output.read_bytes()
    code = os.waitstatus_to_exitcode(status)
    cpu = usage.ru_utime + usage.ru_stime
    used = _IDLE_BYTES + usage.ru_maxrss * 1024 - before
    wrong = [
        *faults(code, said),
        (used > MEMORY_BYTES, f"{used / 1e6:.0f} MB"),
        (cpu > cpu_s, f"{cpu:.1f} s of CPU"),
    ]
    return ", ".join(what for is_wrong, what in wrong if is_wrong)


def faults(code: int, said: bytes) -> list[tuple[bool, str]]:
    """What may be wrong with an answer by its status and output, each with whether it is."""
    return [
        (code not in (0, 1, 2, 3, 4), f"exit status {code}"),
        (b"Traceback" in said or b"R2B69" in said, "a crash"),
        (code != 0 and not said.strip(), "no message"),
        (_CONTROL.search(said) is not None, "control characters"),
        (_shows_secret(said), "a secret"),
    ]


def _shows_secret(said: bytes) -> bool:
    pieces = {SECRET[at : at + _PIECE] for at in range(len(SECRET) - _PIECE + 1)}
    return any(each.encode() in said for each in pieces)


def _answer(arguments: tuple[str, ...], folder: Path, output: Path) -> None:
    """Be the process of one call; never returns."""
    code = 70
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_CPU_S, LONGEST_CPU_S + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        faulthandler.disable()  # that of pytest would write to the terminal
        signal.alarm(10 * LONGEST_CPU_S)
        os.chdir(folder)
        os.environ.update({SECRET_NAME: SECRET, "XDG_CACHE_HOME": str(folder), "NO_COLOR": "1"})
        tempfile.tempdir = str(folder)
        target = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for stream in (1, 2):
            os.dup2(target, stream)
        sys.stdin, sys.stdout, sys.stderr = (open(n, m) for n, m in ((0, "r"), (1, "w"), (2, "w")))  # noqa: PTH123, SIM115
        from r2bspec.cli.main import main

        code = int(main(list(arguments)))
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        import traceback

        os.write(2, traceback.format_exc().encode("utf-8", "replace"))
    finally:
        os._exit(code)
