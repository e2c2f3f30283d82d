"""The profilers that a run can use, the commands that start them, and whether they work here.

perf and py-spy attach to running processes. nsys, and any other program that runs a command given
after its own words, has to start the process that it observes.

A profiler that attaches is tried on a process of our own before anything is measured: whether the
system permits it depends on its settings, on the container, and on the kernel for which perf was
built.

py-spy writes folded stacks. Those of perf are made of what ``perf script`` prints.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Literal

import psutil

from r2bspec.errors import UsageError
from r2bspec.execute.errors import ProfilerError, RunError
from r2bspec.execute.processes.environment import inherited_environment
from r2bspec.execute.processes.process import describe_exit
from r2bspec.execute.processes.resources import family
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.record.run_folder import Stacks, write_stacks
from r2bspec.safe_io.private_files import temporary_folder

OUTPUT = "$(profile)"
"""In the words of a prefix: the path, without a suffix, of the file that it should write."""

_SAMPLES_PER_SECOND = "199"
"""A prime, so that the samples do not keep step with a node that works at a round rate."""

_MAX_PERF_DATA = "512M"

_NSYS = ("profile", "--trace=cuda,nvtx,osrt", "--force-overwrite=true", "--output", OUTPUT)

_TRIAL_TIMEOUT_S = 20.0
_SHOWN_LINES = 4

_INSTALL = {
    "perf": "Install it (Debian: apt install linux-perf; Ubuntu: apt install linux-tools-generic), "
    "or use '--profile py-spy' for Python nodes.",
    "py-spy": "pip install 'r2bspec[profile]'",
    "nsys": "Install NVIDIA Nsight Systems, and see that its folder is in PATH.",
}
_PERMIT = {
    "perf": "Allow it with 'sudo sysctl kernel.perf_event_paranoid=1'; in a container, start that "
    "with --cap-add PERFMON and a seccomp profile that allows perf_event_open.",
    "py-spy": "Allow it with 'sudo sysctl kernel.yama.ptrace_scope=0'; in a container, start that "
    "with --cap-add SYS_PTRACE.",
}
_OBSERVED = "print(flush=True); input()"


@dataclass(frozen=True)
class Profiler:
    """A profiler as a run uses it.

    Attributes:
        name: ``perf``, ``py-spy``, or the first word of the command.
        words: its command, up to the options that depend on the process.
        kind: ``perf`` and ``py-spy`` attach to a process that runs, a ``prefix`` starts it.
    """

    name: str
    words: tuple[str, ...]
    kind: Literal["perf", "py-spy", "prefix"]

    @property
    def attaches(self) -> bool:
        """Whether it observes processes that run already."""
        return self.kind != "prefix"

    def attach_argv(self, pids: Sequence[int], base: Path) -> list[str]:
        """The command that observes processes until SIGINT; `base` is its file without suffix."""
        if self.kind == "py-spy":
            sampling = ("--rate", _SAMPLES_PER_SECOND, "--format", "raw", "--output")
            return [*self.words, "record", *sampling, str(stacks_file(base)), "--pid", str(pids[0])]
        words = ("-F", _SAMPLES_PER_SECOND, "--call-graph", "dwarf", "--max-size", _MAX_PERF_DATA)
        observed = ",".join(map(str, pids))
        return [*self.words, "record", *words, "-o", str(perf_file(base)), "-p", observed]

    def prefix(self, base: Path) -> tuple[str, ...]:
        """The words before the command of the process to be observed."""
        return tuple(word.replace(OUTPUT, str(base)) for word in self.words)


def perf_file(base: Path) -> Path:
    """The file that perf writes."""
    return base.with_name(f"{base.name}.perf.data")


def stacks_file(base: Path) -> Path:
    """The file with the folded stacks."""
    return base.with_name(f"{base.name}.folded")


def find_profiler(text: str) -> Profiler:
    """The profiler that a user names: ``perf``, ``py-spy``, ``nsys``, or words of a command.

    Raises:
        UsageError: the text has no words, or cannot be split into words.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise UsageError(
            f"--profile {text!r} cannot be split into words: {error}",
            hint="Quote the words as for a shell.",
        ) from error
    if not words:
        raise UsageError(
            "--profile needs perf, py-spy, nsys, or the words of a command",
            hint="For example --profile perf.",
        )
    if words == ["perf"]:
        return Profiler("perf", (find_program("perf"),), "perf")
    if words == ["py-spy"]:
        return Profiler("py-spy", (find_program("py-spy"),), "py-spy")
    if words == ["nsys"]:
        words += _NSYS
    return Profiler(Path(words[0]).name, (find_program(words[0]), *words[1:]), "prefix")


def find_program(name: str) -> str:
    """The full path of a program, or its name if it is not installed.

    What was installed with this interpreter is found even if its environment is not activated.
    """
    own = Path(sys.executable).parent
    return shutil.which(name) or shutil.which(name, path=os.fspath(own)) or name


def require_usable(profiler: Profiler) -> None:
    """See that a profiler is installed and may observe processes of this user.

    Raises:
        ProfilerError: it is not, or may not.
    """
    program = profiler.words[0]
    if "/" not in program or not Path(program).exists():
        raise ProfilerError(
            f"--profile: the program {program!r} is not installed",
            hint=_INSTALL.get(profiler.name, "Install it, or give its full path."),
        )
    if not profiler.attaches:
        return
    with temporary_folder("profile") as folder, _observed_process() as pid:
        try:
            done = subprocess.run(
                _trial(profiler, pid, folder / "trial"),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                timeout=_TRIAL_TIMEOUT_S,
                errors="replace",
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ProfilerError(f"--profile: {profiler.name} cannot be run: {error}") from error
    if done.returncode:
        said = [line for line in done.stdout.splitlines() if line.strip()][:_SHOWN_LINES]
        raise ProfilerError(
            f"--profile: {profiler.name} cannot observe a process:\n" + "\n".join(said),
            hint=_PERMIT[profiler.kind],
        )


def _trial(profiler: Profiler, pid: int, base: Path) -> list[str]:
    """A command that observes a process for a moment."""
    if profiler.kind == "py-spy":
        return [*profiler.words, "dump", "--pid", str(pid)]
    return [*profiler.attach_argv([pid], base), "--", sys.executable, "-S", "-c", ""]


@contextlib.contextmanager
def _observed_process() -> Iterator[int]:
    """The id of a process of Python that waits."""
    process = subprocess.Popen(
        [sys.executable, "-S", "-c", _OBSERVED],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    try:
        assert process.stdout is not None  # noqa: S101 - it is a pipe
        process.stdout.readline()
        yield process.pid
    finally:
        process.kill()
        process.communicate()


_READY_TIMEOUT_S = 20.0
_END_TIMEOUT_S = 60.0
_POLL_S = 0.02
_ENDED_BY_US = frozenset({0, -signal.SIGINT, 128 + signal.SIGINT})

_FIELDS = "comm,ip,sym,dso"
_UNKNOWN = "[unknown]"
_SCRIPT_TIMEOUT_S = 120.0


class AttachedProfiler:
    """A profiler that observes the process `observed` and all that it has started.

    Args:
        profiler: attaches to a process that runs.
        observed: the process.
        base: its file, without suffix.
        supervisor: of all processes.
        log: receives its output.

    Raises:
        RunError: it cannot observe the process, or from `ProcessSupervisor.pump`.
    """

    def __init__(
        self,
        profiler: Profiler,
        observed: ManagedProcess,
        base: Path,
        supervisor: ProcessSupervisor,
        log: Path,
    ) -> None:
        self._profiler, self._observed, self._base = profiler, observed, base
        self._supervisor = supervisor
        pids = family(observed.pid)
        if profiler.kind == "py-spy":
            pids = [pid for pid in pids if _runs_python(pid)]
            if not pids:
                raise RunError(f"process {observed.name} runs no Python")
        self._child = supervisor.start(
            f"profile.{observed.name}",
            "command",
            profiler.attach_argv(pids, base),
            inherited_environment(os.environ, ()),
            cwd=base.parent,
            log=log,
        )
        # It may end with any status: what it says is judged when it is stopped.
        self._child.exit_expected = True
        is_over = supervisor.pump_until(
            lambda: self._observes() or not self._child.is_running, _READY_TIMEOUT_S, _POLL_S
        )
        if not self._child.is_running:
            raise RunError(self._failure())
        if not is_over:
            raise RunError(f"{profiler.name} did not begin to observe in time")

    def _observes(self) -> bool:
        if self._profiler.kind == "py-spy":
            return "Sampling process" in self._child.log_tail()
        return _has_perf_events(self._child.pid)

    def stop(self) -> None:
        """Let the profiler write its file, and wait for its end.

        Raises:
            RunError: it failed, ended before, or does not end; or from `ProcessSupervisor.pump`.
        """
        ended_before = not self._child.is_running and self._observed.is_running
        self._child.signal(signal.SIGINT)
        if not self._supervisor.pump_until(
            lambda: not self._child.is_running, _END_TIMEOUT_S, _POLL_S
        ):
            raise RunError(f"{self._profiler.name} did not end within {_END_TIMEOUT_S:g} s")
        if ended_before or self._child.process.returncode not in _ENDED_BY_US:
            raise RunError(self._failure())

    def fold(self) -> Path:
        """Write the folded stacks, unless the profiler has; returns their file.

        Raises:
            RunError: there are none.
            RecordError: they cannot be written.
            OSError: what the profiler wrote cannot be read.
        """
        path = stacks_file(self._base)
        if self._profiler.kind == "perf":
            write_stacks(path, read_perf_stacks(self._profiler.words[0], perf_file(self._base)))
        if not path.exists() or not path.stat().st_size:
            path.unlink(missing_ok=True)
            raise RunError(f"no samples: process {self._observed.name} did not use the CPU")
        return path

    def _failure(self) -> str:
        lines = [line for line in self._child.log_tail().splitlines() if line.strip()]
        said = f": {' '.join(lines[-2:])}" if lines else ""
        return f"{self._profiler.name} {describe_exit(self._child.process.returncode)}{said}"


def _runs_python(pid: int) -> bool:
    """Whether a process is an interpreter, or has loaded one."""
    with contextlib.suppress(psutil.Error, OSError):
        process = psutil.Process(pid)
        return Path(process.exe()).name.startswith("python") or any(
            Path(memory_map.path).name.startswith("libpython")
            for memory_map in process.memory_maps()
        )
    return False


def _has_perf_events(pid: int) -> bool:
    """Whether a process has opened events of the kernel."""
    with contextlib.suppress(OSError):
        opened = Path(f"/proc/{pid}/fd").iterdir()
        return any("perf_event" in str(link.readlink()) for link in opened)
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
            stacks = Counter(stacks_of(process.stdout or ()))
        finally:
            timer.cancel()
    if process.returncode:
        raise RunError(f"'perf script' cannot read {data.name}")
    return stacks


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
