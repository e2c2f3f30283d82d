"""A command of a build or a setup, with a limit of its output; it ends with all its children."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, NamedTuple

from r2bspec.diagnostics.quote import clip
from r2bspec.safe_io.limits import MAX_COMMAND_OUTPUT_BYTES

_POLL_S = 0.02
_TAIL_LINES = 20
_TAIL_BYTES = 16_384
_MAX_LINE = 200


class EndedCommand(NamedTuple):
    """A command that has ended.

    Attributes:
        problem: why it did not end well, such as ``ended with 3``; empty if it did.
        printed: to its standard output.
        last_lines: the last lines of its standard error.
    """

    problem: str
    printed: bytes
    last_lines: str


def run_bounded(
    command: Sequence[str],
    *,
    timeout_s: float,
    folder: Path | None = None,
    check: Callable[[], None] = lambda: None,
) -> EndedCommand:
    """Run a command in a session of its own, which is killed when the command has ended.

    Args:
        command: a program with its arguments.
        timeout_s: how long it may take.
        folder: in which it runs.
        check: is called meanwhile; what it raises ends the command.
    """
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as log:
        try:
            process = subprocess.Popen(
                list(command),
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=log,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            return EndedCommand(f"cannot be started: {error}", b"", "")
        deadline_s = time.monotonic() + timeout_s
        problem = ""
        try:
            while process.poll() is None and not problem:
                check()
                if time.monotonic() > deadline_s:
                    problem = f"did not end within {timeout_s:g} s"
                elif _size(out) + _size(log) > MAX_COMMAND_OUTPUT_BYTES:
                    problem = f"printed more than {MAX_COMMAND_OUTPUT_BYTES >> 20} MiB"
                else:
                    time.sleep(_POLL_S)
        finally:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        if process.returncode and not problem:
            problem = f"ended with {process.returncode}"
        out.seek(0)
        return EndedCommand(problem, b"" if problem else out.read(), _tail(log) or _tail(out))


def _size(file: IO[bytes]) -> int:
    return os.fstat(file.fileno()).st_size


def _tail(log: IO[bytes]) -> str:
    log.seek(max(0, _size(log) - _TAIL_BYTES))
    lines = log.read().decode(errors="replace").splitlines()[-_TAIL_LINES:]
    return "\n".join(clip(line, _MAX_LINE) for line in lines)
