"""A profiler that is attached to a running process of the graph, and the stacks that it takes.

py-spy writes folded stacks. Those of perf are made of what ``perf script`` prints.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePath

import psutil

from r2bspec.execute.errors import RunError
from r2bspec.execute.host.kernel_counters import family
from r2bspec.execute.processes.environment import inherited_environment
from r2bspec.execute.processes.process import describe_exit
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.execute.profile.profilers import Profiler, perf_file, stacks_file
from r2bspec.record.run_folder import Stacks, write_stacks

_READY_TIMEOUT_S = 20.0
_END_TIMEOUT_S = 60.0
_POLL_S = 0.02
_ENDED_BY_US = frozenset({0, -signal.SIGINT, 128 + signal.SIGINT})

_FIELDS = "comm,ip,sym,dso"
_UNKNOWN = "[unknown]"
_SCRIPT_TIMEOUT_S = 120.0


@dataclass
class AttachedProfiler:
    """A profiler that observes the process `observed` and all that it has started.

    Attributes:
        base: its file, without suffix.
        child: its own process.
    """

    profiler: Profiler
    observed: ManagedProcess
    base: Path
    child: ManagedProcess

    @classmethod
    def start(
        cls,
        profiler: Profiler,
        observed: ManagedProcess,
        base: Path,
        supervisor: ProcessSupervisor,
        log: Path,
    ) -> AttachedProfiler:
        """Start the profiler, and wait until it observes.

        Raises:
            RunError: it cannot observe the process, or from `ProcessSupervisor.pump`.
        """
        pids = family(observed.pid)
        if profiler.kind == "py-spy":
            pids = [each for each in pids if _runs_python(each)]
            if not pids:
                raise RunError(f"process {observed.name} runs no Python")
        child = supervisor.start(
            f"profile.{observed.name}",
            "command",
            profiler.attach_argv(pids, base),
            inherited_environment(os.environ, ()),
            cwd=base.parent,
            log=log,
        )
        # It may end with any status: what it says is judged when it is stopped.
        child.exit_expected = True
        attached = cls(profiler, observed, base, child)
        attached._wait_until_ready(supervisor)
        return attached

    def _wait_until_ready(self, supervisor: ProcessSupervisor) -> None:
        deadline = time.monotonic() + _READY_TIMEOUT_S
        while not self._observes():
            if not self.child.is_running:
                raise RunError(self._failure())
            if time.monotonic() > deadline:
                raise RunError(f"{self.profiler.name} did not begin to observe in time")
            supervisor.pump(_POLL_S)

    def _observes(self) -> bool:
        if self.profiler.kind == "py-spy":
            return "Sampling process" in self.child.log_tail()
        return _has_perf_events(self.child.pid)

    def stop(self) -> None:
        """Let the profiler write its file, and wait for its end.

        Raises:
            RunError: it failed, ended before, or does not end.
        """
        ended_before = not self.child.is_running and self.observed.is_running
        self.child.signal(signal.SIGINT)
        deadline = time.monotonic() + _END_TIMEOUT_S
        while self.child.is_running:
            if time.monotonic() > deadline:
                raise RunError(f"{self.profiler.name} did not end within {_END_TIMEOUT_S:g} s")
            time.sleep(_POLL_S)
        if ended_before or self.child.process.returncode not in _ENDED_BY_US:
            raise RunError(self._failure())

    def fold(self) -> Path:
        """Write the folded stacks, unless the profiler has; returns their file.

        Raises:
            RunError: there are none.
            RecordError: they cannot be written.
            OSError: what the profiler wrote cannot be read.
        """
        found = stacks_file(self.base)
        if self.profiler.kind == "perf":
            write_stacks(found, read_perf_stacks(self.profiler.words[0], perf_file(self.base)))
        if not found.exists() or not found.stat().st_size:
            found.unlink(missing_ok=True)
            raise RunError(f"no samples: process {self.observed.name} did not use the CPU")
        return found

    def _failure(self) -> str:
        lines = [line for line in self.child.log_tail().splitlines() if line.strip()]
        said = f": {' '.join(lines[-2:])}" if lines else ""
        return f"{self.profiler.name} {describe_exit(self.child.process.returncode)}{said}"


def _runs_python(pid: int) -> bool:
    """Whether a process is an interpreter, or has loaded one."""
    with contextlib.suppress(psutil.Error, OSError):
        process = psutil.Process(pid)
        return Path(process.exe()).name.startswith("python") or any(
            Path(each.path).name.startswith("libpython") for each in process.memory_maps()
        )
    return False


def _has_perf_events(pid: int) -> bool:
    """Whether a process has opened events of the kernel."""
    with contextlib.suppress(OSError):
        opened = Path(f"/proc/{pid}/fd").iterdir()
        return any("perf_event" in str(each.readlink()) for each in opened)
    return False


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
        timer = threading.Timer(_SCRIPT_TIMEOUT_S, process.kill)
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
