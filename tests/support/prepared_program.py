"""Start `r2bspec` without importing it anew: a third of the processor time of a short run.

A fork server of the standard library imports the modules once for each worker of the tests, and
each program is a fork of it, with its own folder, environment and output.
"""

from __future__ import annotations

import multiprocessing
import os
import pkgutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import r2bspec

FIXED = ("PYTHONPATH", "LD_PRELOAD")
"""Variables that an interpreter reads when it begins: with others, a program cannot be forked."""

_server = multiprocessing.get_context("forkserver")
_server.set_forkserver_preload(
    [
        *("jsonschema", "networkx", "numpy.ma", "sqlite3"),
        *(
            module.name
            for module in pkgutil.walk_packages(r2bspec.__path__, "r2bspec.")
            if not module.name.startswith(("r2bspec.harness", "r2bspec.nodes", "r2bspec.__main__"))
        ),
    ]
)


def _fixed() -> list[str]:
    return [os.environ.get(name, "") for name in FIXED]


_AT_START = _fixed()


class ForkedProgram:
    """A program that was forked; what `subprocess.Popen` calls the same is the same."""

    def __init__(self, arguments: Sequence[str], folder: Path, output: tuple[Path, Path]) -> None:
        self._process = _server.Process(
            target=_run, args=(list(arguments), folder, dict(os.environ), output), daemon=False
        )
        self._process.start()
        pid = self._process.pid
        assert pid is not None
        self.pid = pid

    def poll(self) -> int | None:
        """Return the exit status, negative for a signal; None while the program runs."""
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end.

        Raises:
            subprocess.TimeoutExpired: the program still runs after `timeout` seconds.
        """
        self._process.join(timeout)
        if (status := self.poll()) is None:
            raise subprocess.TimeoutExpired("r2bspec", timeout or 0.0)
        return status

    def send_signal(self, number: int) -> None:
        """Send a signal, unless the program has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Send SIGTERM, unless the program has ended."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """Send SIGKILL, unless the program has ended."""
        self.send_signal(signal.SIGKILL)


Program = ForkedProgram | subprocess.Popen[bytes]


def start(arguments: Sequence[str], folder: Path, output: tuple[Path, Path]) -> Program:
    """Start ``r2bspec`` in a folder and a session of its own.

    Args:
        arguments: those of the command line.
        folder: the working directory.
        output: the files for standard output and standard error.
    """
    for path in output:
        path.touch()
    if _fixed() == _AT_START:
        return ForkedProgram(arguments, folder, output)
    return start_anew([sys.executable, "-m", "r2bspec", *arguments], folder, output)


def start_anew(
    command: Sequence[str], folder: Path, output: tuple[Path, Path]
) -> subprocess.Popen[bytes]:
    """Start a command as `start` does, as a program of its own."""
    with output[0].open("wb") as stdout, output[1].open("wb") as stderr:
        return subprocess.Popen(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=stdout,
            stderr=stderr,
            start_new_session=True,
        )


def _run(
    arguments: list[str], folder: Path, environment: dict[str, str], output: tuple[Path, Path]
) -> None:
    """Become the program: the body of a fork."""
    from r2bspec.__main__ import start

    os.setsid()
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for descriptor, name in ((0, Path(os.devnull)), (1, output[0]), (2, output[1])):
        opened = os.open(name, os.O_RDONLY if descriptor == 0 else os.O_WRONLY | os.O_CREAT)
        os.dup2(opened, descriptor)
        os.close(opened)
    sys.argv = ["r2bspec", *arguments]
    sys.exit(start())
