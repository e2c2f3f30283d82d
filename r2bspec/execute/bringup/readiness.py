"""Readiness probes: the conditions under `ready` that must be met before anything is played."""

from __future__ import annotations

import os
import time
from pathlib import Path

from r2bspec.execute.errors import NotReadyError
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.language.line_pattern import LinePattern, PatternError, compile_line_pattern
from r2bspec.plan.plan import ProbePlan
from r2bspec.record.run_folder import RunFolder

_POLL_S = 0.05
_REPLY_TIMEOUT_S = 10.0
_CHUNK_BYTES = 1 << 16
_MAX_LINE_BYTES = 1 << 16
"""The end of an unfinished line that is searched again with what follows."""


def wait_for_probe(
    plan: ProbePlan,
    supervisor: ProcessSupervisor,
    observer: ManagedProcess,
    folder: RunFolder,
    base_dir: Path,
) -> None:
    """Wait until the condition of a probe is met.

    Args:
        plan: the condition and its timeout.
        supervisor: all processes; the wait ends if one of them exits.
        observer: a harness process that can query the graph.
        folder: contains the logs.
        base_dir: to which the path of a file is relative.

    Raises:
        NotReadyError: it was not met in time.
    """
    deadline = time.monotonic() + plan.timeout_ns / 1e9
    search = _log_search(plan, folder, supervisor) if plan.kind == "log" else None
    while not (
        search.finds(deadline)
        if search is not None
        else _is_ready(plan, supervisor, observer, base_dir)
    ):
        if time.monotonic() > deadline:
            what = (
                f"the log of {plan.target}" if plan.kind == "log" else f"{plan.kind} {plan.target}"
            )
            wanted = (
                f" has no line with {plan.pattern!r}" if plan.kind == "log" else " does not exist"
            )
            raise NotReadyError(
                f"ready.{plan.name}: {what}{wanted} after {plan.timeout_ns / 1e9:g} s",
                hint=f"The logs are in {folder.path / 'logs'}",
                code="R2B646",
            )
        supervisor.pump(_POLL_S)


def _log_search(plan: ProbePlan, folder: RunFolder, supervisor: ProcessSupervisor) -> LogSearch:
    try:
        pattern = compile_line_pattern(plan.pattern)
    except PatternError as error:
        raise NotReadyError(
            f"ready.{plan.name}: {plan.pattern!r} is not a valid regular expression: {error}",
            code="R2B646",
        ) from None
    # What the process of an earlier start wrote says nothing about this one.
    begin = next((each.log_start for each in supervisor if each.name == plan.target), 0)
    return LogSearch(folder.log_path(plan.target), pattern, begin)


def _is_ready(
    plan: ProbePlan,
    supervisor: ProcessSupervisor,
    observer: ManagedProcess,
    base_dir: Path,
) -> bool:
    match plan.kind:
        case "file":
            return (base_dir / plan.target).exists()
        case "log":
            raise AssertionError("a log is searched by LogSearch")
        case "service":
            survey = supervisor.request(
                observer, protocol.ListGraph(), protocol.GraphSnapshot, _REPLY_TIMEOUT_S
            )
            return plan.target in survey.services
        case "topic":
            command = protocol.Discover(topics=(plan.target,))
            found = supervisor.request(observer, command, protocol.Discovered, _REPLY_TIMEOUT_S)
            return bool(found.writers[plan.target] and found.readers[plan.target])


class LogSearch:
    """Searches a log for a line, reading only what was added since the last time.

    Args:
        log: the file.
        pattern: what a line must contain.
        begin: where the search begins, in bytes.
    """

    def __init__(self, log: Path, pattern: LinePattern, begin: int = 0) -> None:
        self._log = log
        self._pattern = pattern
        self._at = begin
        self._last_line = b""

    def finds(self, deadline: float) -> bool:
        """Whether a line has it; at the deadline what is left is not read."""
        try:
            with self._log.open("rb") as stream:
                if stream.seek(0, os.SEEK_END) < self._at:  # the log was cut
                    self._at, self._last_line = 0, b""
                stream.seek(self._at)
                while chunk := stream.read(_CHUNK_BYTES):
                    self._at += len(chunk)
                    if self._is_in(chunk):
                        return True
                    if time.monotonic() > deadline:
                        return False
        except OSError:
            return False
        return False

    def _is_in(self, chunk: bytes) -> bool:
        lines = (self._last_line + chunk).split(b"\n")
        self._last_line = lines[-1][-_MAX_LINE_BYTES:]
        return any(
            self._pattern.is_in(part)
            for line in lines
            for part in line.decode(errors="replace").splitlines()
        )
