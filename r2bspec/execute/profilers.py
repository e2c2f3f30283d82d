"""The profilers that a run can use: words before the command of a process, which they run.

``perf``, ``py-spy`` and ``nsys`` stand for such words. Whether the system permits perf or py-spy to
observe a process is tried before anything is measured: it depends on settings of the system, on the
container, and on the kernel for which perf was built.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from r2bspec.errors import UsageError
from r2bspec.execute.errors import ProfilerError
from r2bspec.extras import install_command
from r2bspec.safe_io.private_files import temporary_folder

OUTPUT: Final = "$(profile)"
"""In the words: the path, without a suffix, of the file that the profiler should write."""

# 199 samples a second: a prime does not keep step with a node that works at a round rate.
_WORDS: Final = {
    "perf": "perf record --quiet -F 199 --call-graph dwarf --max-size 512M "
    f"-o {OUTPUT}.perf.data --",
    "py-spy": f"py-spy record --rate 199 --subprocesses --output {OUTPUT}.svg --",
    "nsys": f"nsys profile --trace=cuda,nvtx,osrt --force-overwrite=true --output {OUTPUT}",
}
_INSTALL: Final = {
    "perf": "Install it (Debian: apt install linux-perf; Ubuntu: apt install linux-tools-generic), "
    "or use '--profile py-spy' for Python nodes.",
    "py-spy": install_command("profile"),
    "nsys": "Install NVIDIA Nsight Systems, and see that its folder is in PATH.",
}
_PERMIT: Final = {
    "perf": "Allow it with 'sudo sysctl kernel.perf_event_paranoid=1'; in a container, start that "
    "with --cap-add PERFMON and a seccomp profile that allows perf_event_open.",
    "py-spy": "In a container, start that with --cap-add SYS_PTRACE.",
}
_TRIAL: Final = "import time; time.sleep(0.5)"
_TRIAL_TIMEOUT_S: Final = 20.0
_SHOWN_LINES: Final = 4


@dataclass(frozen=True)
class Profiler:
    """A profiler as a run uses it.

    Attributes:
        name: ``perf``, ``py-spy``, ``nsys``, or the first word of the command.
        words: before the command of the process to be observed.
    """

    name: str
    words: tuple[str, ...]

    def prefix(self, base: Path) -> tuple[str, ...]:
        """The words, for a file `base` without suffix."""
        return tuple(word.replace(OUTPUT, str(base)) for word in self.words)


def find_profiler(text: str) -> Profiler:
    """The profiler that a user names: ``perf``, ``py-spy``, ``nsys``, or words of a command.

    Raises:
        UsageError: the text has no words, or cannot be split into words.
    """
    try:
        words = shlex.split(_WORDS.get(text.strip(), text))
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
    # What was installed with this interpreter is found even if its environment is not activated.
    own = os.fspath(Path(sys.executable).parent)
    program = shutil.which(words[0]) or shutil.which(words[0], path=own) or words[0]
    return Profiler(Path(words[0]).name, (program, *words[1:]))


def require_usable(profiler: Profiler) -> None:
    """Check that a profiler is installed and, of perf and py-spy, that it may observe a process.

    Raises:
        ProfilerError: it is not, or may not.
    """
    program = profiler.words[0]
    if "/" not in program or not Path(program).exists():
        raise ProfilerError(
            f"--profile: the program {program!r} is not installed",
            hint=_INSTALL.get(profiler.name, "Install it, or give its full path."),
        )
    if profiler.name not in _PERMIT:
        return
    with temporary_folder("profile") as folder:
        try:
            done = subprocess.run(
                [*profiler.prefix(folder / "trial"), sys.executable, "-S", "-c", _TRIAL],
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
            hint=_PERMIT[profiler.name],
        )
