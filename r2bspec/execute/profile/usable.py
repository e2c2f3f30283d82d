"""Whether a profiler can be used on this machine, seen before anything is measured.

A profiler that attaches is tried on a process of our own: whether the system permits it depends on
its settings, on the container, and on the kernel for which perf was built.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from r2bspec.execute.errors import ProfilerError
from r2bspec.execute.profile.profilers import Profiler

_TIMEOUT_S = 20.0
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
                timeout=_TIMEOUT_S,
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
