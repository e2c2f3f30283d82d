"""Where player and monitors ran, in words."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.judge.result import Result
from r2bspec.measure.units import show
from r2bspec.record.run_record import HarnessOverheadRecord


def overhead_placement(harness_overhead: tuple[HarnessOverheadRecord, ...]) -> str:
    """Between how many processes the overhead was measured; empty in records without it."""
    processes = max((each.processes for each in harness_overhead), default=0)
    return {1: "within one process", 2: "between two processes"}.get(processes, "")


def joined_notes(result: Result) -> Iterator[str]:
    """In which processes of the graph player and monitors ran."""
    seen = dict.fromkeys((each.name, each.parts) for each in result.processes if each.parts)
    for name, parts in seen:
        yield (
            f"Process {name} contains the {' and the '.join(parts)} of the harness: its processor "
            "time, memory and page faults include theirs"
        )


def overhead_notes(result: Result) -> Iterator[str]:
    """With which placement of the harness the overhead was measured, and how large it is."""
    where = overhead_placement(result.harness_overhead)
    known = [
        each.latency_p50_ns for each in result.harness_overhead if each.latency_p50_ns is not None
    ]
    if where and known:
        placement = result.harness_overhead[0].placement
        yield (
            f"The harness overhead is at most {show(max(known) / 1e9, 's')} at p50, {where} "
            f"(harness.placement: {placement}); the latencies contain it"
        )
