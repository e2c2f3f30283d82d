"""Probes of readiness: what the spec says must be so before the graph counts as standing."""

from __future__ import annotations

import re
import time
from pathlib import Path

from r2bspec.execute.errors import NotReadyError
from r2bspec.execute.processes.supervisor import Child, Children
from r2bspec.ipc import protocol
from r2bspec.plan.plan import ProbePlan
from r2bspec.record.run_folder import RunFolder

_POLL_S = 0.05
_ASK_S = 10.0


def wait_for_probe(
    plan: ProbePlan, children: Children, observer: Child, folder: RunFolder, base_dir: Path
) -> None:
    """Wait until what a probe looks for is so.

    Args:
        plan: what to look for, and for how long.
        children: all processes; one that dies meanwhile ends the wait.
        observer: a harness process that sees the graph.
        folder: where the logs are.
        base_dir: to which the path of a file is relative.

    Raises:
        NotReadyError: it was not so in time.
    """
    deadline = time.monotonic() + plan.timeout_ns / 1e9
    while not _holds(plan, children, observer, folder, base_dir):
        if time.monotonic() > deadline:
            what = (
                f"the log of {plan.target}" if plan.kind == "log" else f"{plan.kind} {plan.target}"
            )
            wanted = (
                f" has no line with {plan.pattern!r}" if plan.kind == "log" else " is not there"
            )
            raise NotReadyError(
                f"ready.{plan.name}: {what}{wanted} after {plan.timeout_ns / 1e9:g} s",
                hint=f"The logs are in {folder.path / 'logs'}",
                code="R2B646",
            )
        children.pump(_POLL_S)


def _holds(
    plan: ProbePlan, children: Children, observer: Child, folder: RunFolder, base_dir: Path
) -> bool:
    match plan.kind:
        case "file":
            return (base_dir / plan.target).exists()
        case "log":
            return _logged(folder.log_path(plan.target), plan.pattern)
        case "service":
            survey = children.ask(observer, protocol.Survey(), protocol.Surveyed, _ASK_S)
            return plan.target in survey.services
        case "topic":
            asked = protocol.Discover(topics=(plan.target,))
            seen = children.ask(observer, asked, protocol.Discovered, _ASK_S)
            return bool(seen.writers[plan.target] and seen.readers[plan.target])


def _logged(log: Path, pattern: str) -> bool:
    try:
        text = log.read_text(errors="replace")
    except OSError:
        return False
    return any(re.search(pattern, line) for line in text.splitlines())
