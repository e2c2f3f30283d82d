"""More shared memory than this machine has."""

from __future__ import annotations

import shutil

from r2bspec.check.rule_api import Context, Finding, Findings, Rule
from r2bspec.language.quantities import Size

_FOLDER = "/dev/shm"  # noqa: S108 -- looked at, not written to


def _find(context: Context) -> Findings:
    segment = context.spec.segment
    if segment is None or context.spec.transport != "shared_memory":
        return
    try:
        available_bytes = shutil.disk_usage(_FOLDER).total
    except OSError:
        return
    processes = len(context.processes)
    wanted = segment.bytes * processes
    if wanted > available_bytes:
        yield Finding(
            message=f"{processes} processes with a segment of "
            f"{segment} each need {Size(wanted)}, but {_FOLDER} has "
            f"{Size(available_bytes // 2**20 * 2**20)}",
            path=("transport", "segment"),
            help=f"make it smaller, or {_FOLDER} larger (docker run --shm-size)",
            machine_dependent=True,
        )


RULE = Rule(
    code="R2B629",
    title="more shared memory than this machine has",
    severity="warning",
    why="Every process that uses the transport makes a segment of that size. Where there is no "
    "more room, messages take the way over UDP.",
    find=_find,
)
