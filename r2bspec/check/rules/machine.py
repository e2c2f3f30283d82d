"""Whether this machine is the required machine, and has enough shared memory."""

from __future__ import annotations

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, rule
from r2bspec.language.quantities import Size
from r2bspec.plan import this_machine as machine


@rule("R2B676")
def machine_not_as_required(context: Context) -> Findings:
    """Find requirements that this machine does not meet."""
    if lacks := machine.unmet(context.spec.requires, machine.this_machine()):
        yield Finding(
            message=f"this machine is not what the spec requires: {'; '.join(lacks)}",
            path=("requires",),
            help="run it on a host that fits, for example with 'run --on'; R2BSPEC_LABELS has the "
            "labels of this machine",
            machine_dependent=True,
        )


@rule("R2B629")
def shared_memory_insufficient(context: Context) -> Findings:
    """Find segments that need more shared memory than this machine has."""
    segment = context.spec.transport.segment
    if segment is None or context.spec.transport.kind != "shared_memory":
        return
    available_bytes = machine.shared_memory_bytes()
    if available_bytes is None:
        return
    processes = len(context.subjects.processes)
    required_bytes = segment.bytes * processes
    if required_bytes > available_bytes:
        yield Finding(
            message=f"{processes} processes with a segment of {segment} each need "
            f"{Size(required_bytes)}, but {machine.SHARED_MEMORY} has "
            f"{Size(available_bytes // 2**20 * 2**20)}",
            path=("transport", "segment"),
            help=f"reduce 'segment', or enlarge {machine.SHARED_MEMORY} (docker run --shm-size)",
            machine_dependent=True,
        )
