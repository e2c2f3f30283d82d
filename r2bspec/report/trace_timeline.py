"""The timeline of a run: phases, messages and loads, for the formats with a time axis.

All times are CLOCK_MONOTONIC nanoseconds, as in the run folder.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from r2bspec.measure.host_usage import MACHINE_INDEX, spaced_indices
from r2bspec.measure.matching import match_segment
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import Segment

WHOLE_MACHINE = "whole machine"


@dataclass(frozen=True, slots=True)
class ExpectedAnswer:
    """An expected output at one monitor; `received_ns` is None if it never arrived."""

    segment: Segment
    step: int
    published_ns: int
    received_ns: int | None


@dataclass(frozen=True, slots=True)
class LoadSample:
    """The load of a process since the sample before; one core is 1."""

    process: str
    at_ns: int
    cpu: float
    memory_bytes: int


def phases(run: Run) -> list[tuple[str, int, int]]:
    """Each phase with its beginning and its end; the last one ends with the last segment."""
    begun = [
        (text.removeprefix("phase "), at_ns)
        for at_ns, text in run.record.events
        if text.startswith("phase ")
    ]
    last = max(
        [each.ended_ns for each in run.record.segments] + [at_ns for at_ns, _ in run.record.events],
        default=0,
    )
    ends = [*(at_ns for _, at_ns in begun[1:]), last]
    # Without any recorded phase, the last end is left over.
    return [(name, at_ns, max(end, at_ns)) for (name, at_ns), end in zip(begun, ends, strict=False)]


def expected_answers(run: Run, monitor: str) -> Iterator[ExpectedAnswer]:
    """Every expected output, in the order of playing, of the segments where pairs are known."""
    (plan,) = (each for each in run.plan.monitors if each.name == monitor)
    for segment in run.record.segments:
        playback, rows, matched = match_segment(run, segment, plan)
        if not matched.pairs_known:
            continue
        for step, row in zip(
            matched.trigger_steps.tolist(), matched.first_row.tolist(), strict=True
        ):
            yield ExpectedAnswer(
                segment=segment,
                step=step,
                published_ns=int(playback["published_ns"][step]),
                received_ns=int(rows["received_ns"][row]) if row >= 0 else None,
            )


def load_samples(run: Run) -> Iterator[LoadSample]:
    """Every sample except the first of each process, by process."""
    rows = run.resources()
    names = {number: each.name for number, each in enumerate(run.record.processes)}
    for index, name in {**names, MACHINE_INDEX: WHOLE_MACHINE}.items():
        of_one = rows[rows["process"] == index]
        of_one = of_one[np.argsort(of_one["time_ns"], kind="stable")]
        of_one = of_one[spaced_indices(of_one["time_ns"])]
        spans = np.diff(of_one["time_ns"])
        used = np.diff(of_one["cpu_s"])
        for at, (span, cpu_s) in enumerate(zip(spans.tolist(), used.tolist(), strict=True), 1):
            if span > 0:
                yield LoadSample(
                    process=name,
                    at_ns=int(of_one["time_ns"][at]),
                    cpu=cpu_s / (span / 1e9),
                    memory_bytes=int(of_one["memory_bytes"][at]),
                )
