"""Readiness probes: the conditions under `ready` that must be met before anything is played."""

from __future__ import annotations

import re
import time
from pathlib import Path

from r2bspec.execute.errors import NotReadyError
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.plan.plan import ProbePlan
from r2bspec.record.run_folder import RunFolder

_POLL_S = 0.05
_REPLY_TIMEOUT_S = 10.0


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
    while not _is_ready(plan, supervisor, observer, folder, base_dir):
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


def _is_ready(
    plan: ProbePlan,
    supervisor: ProcessSupervisor,
    observer: ManagedProcess,
    folder: RunFolder,
    base_dir: Path,
) -> bool:
    match plan.kind:
        case "file":
            return (base_dir / plan.target).exists()
        case "log":
            return _log_matches(folder.log_path(plan.target), plan.pattern)
        case "service":
            survey = supervisor.request(
                observer, protocol.Survey(), protocol.Surveyed, _REPLY_TIMEOUT_S
            )
            return plan.target in survey.services
        case "topic":
            command = protocol.Discover(topics=(plan.target,))
            found = supervisor.request(observer, command, protocol.Discovered, _REPLY_TIMEOUT_S)
            return bool(found.writers[plan.target] and found.readers[plan.target])


def _log_matches(log: Path, pattern: str) -> bool:
    try:
        text = log.read_text(errors="replace")
    except OSError:
        return False
    return any(re.search(pattern, line) for line in text.splitlines())
