"""From the samples of perf to folded stacks, by way of ``perf script``."""

from __future__ import annotations

import os
import subprocess
import threading
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePath

from r2bspec.execute.errors import RunError
from r2bspec.record.folded_stacks import Stacks

_FIELDS = "comm,ip,sym,dso"
_UNKNOWN = "[unknown]"
_TIMEOUT_S = 120.0


def read_perf_stacks(perf: str, data: Path) -> Stacks:
    """The stacks in a file of ``perf record``, each with the name of its thread as first frame.

    Raises:
        RunError: perf cannot read the file, or not in time.
        OSError: perf cannot be started.
    """
    # Without the names of inlined functions, which take minutes, and symbols from the network.
    command = [perf, "script", "--no-inline", "-F", _FIELDS, "-i", str(data)]
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"DEBUGINFOD_URLS": ""},
        errors="replace",
    ) as process:
        timer = threading.Timer(_TIMEOUT_S, process.kill)
        timer.start()
        try:
            found = Counter(stacks_of(process.stdout or ()))
        finally:
            timer.cancel()
    if process.returncode:
        raise RunError(f"'perf script' cannot read {data.name}")
    return found


def stacks_of(lines: Iterable[str]) -> Iterator[tuple[str, ...]]:
    """The stack of each sample in the text that ``perf script`` prints.

    A sample is a line with the name of its thread, then an indented line for each frame from the
    last called to the first, with address, symbol and, in parentheses, file. An empty line ends it.
    """
    thread = ""
    frames: list[str] = []
    for line in (*lines, ""):
        if line[:1].isspace() and line.strip():
            frames.append(_frame(line))
        elif line.strip():
            thread = line.strip()
        elif thread:
            if frames:
                yield (thread, *reversed(frames))
            thread, frames = "", []


def _frame(line: str) -> str:
    """The symbol, or the file of a frame that has none."""
    _, _, rest = line.strip().partition(" ")
    # Symbols of C++ and paths may have parentheses, too.
    start = max(rest.rfind(" (/"), rest.rfind(" (["))
    symbol, file = (rest[:start], rest[start + 2 :]) if start >= 0 else (rest, "")
    if symbol and symbol != _UNKNOWN:
        return symbol
    name = PurePath(file.removesuffix(")")).name
    return f"[{name}]" if name and name != _UNKNOWN else _UNKNOWN
