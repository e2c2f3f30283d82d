"""Segments that need more shared memory than this machine has."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule
from r2bspec.check.this_machine import SHARED_MEMORY, shared_memory_bytes
from r2bspec.language.quantities import Size


def _find(context: Context) -> Findings:
    segment = context.spec.transport.segment
    if segment is None or context.spec.transport.kind != "shared_memory":
        return
    available_bytes = shared_memory_bytes()
    if available_bytes is None:
        return
    processes = len(context.processes)
    wanted = segment.bytes * processes
    if wanted > available_bytes:
        yield Finding(
            message=f"{processes} processes with a segment of {segment} each need {Size(wanted)}, "
            f"but {SHARED_MEMORY} has {Size(available_bytes // 2**20 * 2**20)}",
            path=("transport", "segment"),
            help=f"reduce 'segment', or enlarge {SHARED_MEMORY} (docker run --shm-size)",
            machine_dependent=True,
        )


RULE = Rule(code="R2B629", find=_find)
