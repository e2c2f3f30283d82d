"""The profilers that a run can use, the commands that start them, and whether they work here.

perf and py-spy attach to running processes. nsys, and any other program that runs a command given
after its own words, has to start the process that it observes.

A profiler that attaches is tried on a process of our own before anything is measured: whether the
system permits it depends on its settings, on the container, and on the kernel for which perf was
built.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from r2bspec.errors import UsageError
from r2bspec.execute.errors import ProfilerError

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
        raise UsageError(f"--profile {text!r} cannot be split into words: {error}") from error
    if not words:
        raise UsageError("--profile needs perf, py-spy, nsys, or the words of a command")
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
    with tempfile.TemporaryDirectory() as folder, _observed_process() as pid:
        try:
            done = subprocess.run(
                _trial(profiler, pid, Path(folder) / "trial"),
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
