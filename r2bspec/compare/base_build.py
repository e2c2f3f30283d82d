"""The base becomes what runs: its build commands, and the environment that its setup makes.

Which commands these are is the base's own matter: its version of ``benchmark.gate.base`` counts, so
that a change cannot decide how it is compared. The options of the pipeline are for a base that says
nothing.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO

from r2bspec.compare.base_environment import base_environment
from r2bspec.compare.base_tree import BaseTree
from r2bspec.diagnostics.quote import clip
from r2bspec.errors import R2bspecError
from r2bspec.execute.processes.environment import applied_environment, workspace_environment
from r2bspec.execute.progress import Progress
from r2bspec.execute.states import Interrupts
from r2bspec.exit_status import ExitStatus
from r2bspec.language.spec import GateBase

_POLL_S = 0.05
_TAIL_LINES = 20
_TAIL_BYTES = 16_384
_MAX_LINE = 200


class BaseBuildError(R2bspecError):
    """The base of a gate does not build."""

    code = "R2B695"
    exit_code = ExitStatus.USAGE


@dataclass
class BaseBuilds:
    """The builds of a base, each made once for all specs that ask for it."""

    tree: BaseTree
    _environments: dict[GateBase, Mapping[str, str]] = field(default_factory=dict)

    def environment(self, settings: GateBase, progress: Progress) -> Mapping[str, str]:
        """The variables of the base that differ from those of this process, once it is built.

        Raises:
            BaseBuildError: a command fails, or takes too long.
            BaseRevisionError: the base would run code of the head.
            WorkspaceError: the setup does not exist, or cannot be sourced.
        """
        if settings not in self._environments:
            self._environments[settings] = self._build(settings, progress)
        return self._environments[settings]

    def _build(self, settings: GateBase, progress: Progress) -> Mapping[str, str]:
        built = bool(settings.build or settings.setup)
        environment = base_environment(self.tree, built=built)
        with applied_environment(environment):
            for command in settings.build:
                progress.note(f"building {self.tree.name}: {' '.join(command)}")
                _run(command, self.tree, settings.timeout.ns / 1e9)
        # The build may have made the folders that entries of search paths lead to.
        environment = base_environment(self.tree, built=built)
        if settings.setup:
            with applied_environment(environment):
                environment |= workspace_environment(_setup(settings.setup, self.tree))
        return environment


def _setup(text: str, tree: BaseTree) -> str:
    """The setup of a base: a path below its top, or a variable."""
    place = tree.top / text
    name, equals, value = text.partition("=")
    if equals and not place.exists():
        # Such as PYTHONPATH=build/base: folders of the base.
        folders = (tree.top / entry for entry in value.split(os.pathsep))
        return f"{name}={os.pathsep.join(map(str, folders))}" if name == "PYTHONPATH" else text
    return str(place)


def _run(command: Sequence[str], tree: BaseTree, timeout_s: float) -> None:
    """Run one command of a build; what it started ends with it.

    Raises:
        BaseBuildError: it fails, or takes too long.
        InterruptedRunError: a signal arrived.
    """
    with tempfile.TemporaryFile() as log, Interrupts() as interrupts:
        try:
            process = subprocess.Popen(
                list(command),
                cwd=tree.top,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            raise _failed(command, tree, f"cannot be started: {error}") from error
        with _ended_group(process):
            deadline_s = time.monotonic() + timeout_s
            while process.poll() is None:
                interrupts.check()
                if time.monotonic() > deadline_s:
                    raise _failed(command, tree, f"did not end within {timeout_s:g} s", _tail(log))
                time.sleep(_POLL_S)
        if process.returncode:
            raise _failed(command, tree, f"ended with {process.returncode}", _tail(log))


@contextlib.contextmanager
def _ended_group(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """At the end, no process of the group of a command is left."""
    try:
        yield
    finally:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _failed(command: Sequence[str], tree: BaseTree, what: str, tail: str = "") -> BaseBuildError:
    return BaseBuildError(
        f"{tree.name} does not build: {clip(' '.join(command))} {what}"
        + (f"; its last output:\n{tail}" if tail else ""),
        hint="Mend the base, or judge the head alone: --allow base.",
    )


def _tail(log: IO[bytes]) -> str:
    """The last lines of a log."""
    size = log.seek(0, os.SEEK_END)
    log.seek(max(0, size - _TAIL_BYTES))
    lines = log.read().decode(errors="replace").splitlines()[-_TAIL_LINES:]
    return "\n".join(clip(line, _MAX_LINE) for line in lines)
