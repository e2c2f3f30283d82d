"""Merging several runs to one, with the segments of all of them under unique names.

Runs on one machine share a clock (CLOCK_MONOTONIC since boot), so the merged run is equivalent to
one run with pauses. Each iteration keeps its samples; the indices are renumbered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from r2bspec.plan.plan import Plan
from r2bspec.record.graph_identity import common_identity
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import RunRecord, SearchRecord, Segment
from r2bspec.record.sample_arrays import INTERFERENCE_DTYPE, RESOURCE_DTYPE, Rows

Limit = Literal["graph", "player", "range", "interrupted", "interference"]

_SEPARATOR = "."


@dataclass(frozen=True)
class MergedRun(Run):
    """Several runs of one plan as a single run.

    Attributes:
        runs: in the order of their pairs.
        spec: the resolved spec of all of them.
    """

    runs: tuple[Run, ...] = ()
    spec: str = ""

    def playback(self, segment: Segment) -> Rows:
        """See `Run.playback`."""
        run, own = self._source_run(segment)
        return run.playback(own)

    def monitor(self, segment: Segment, name: str) -> Rows:
        """See `Run.monitor`."""
        run, own = self._source_run(segment)
        return run.monitor(own, name)

    def tap(self, segment: Segment, topic: str) -> Rows:
        """See `Run.tap`."""
        run, own = self._source_run(segment)
        return run.tap(own, topic)

    def resources(self) -> Rows:
        """See `Run.resources`; the processes of each run follow those of the previous one."""
        found: list[Rows] = []
        before = 0
        for run in self.runs:
            rows = run.resources().copy()
            rows["process"][rows["process"] >= 0] += before
            found.append(rows)
            before += len(run.record.processes)
        return np.concatenate(found) if found else np.empty(0, RESOURCE_DTYPE)

    def interference(self) -> Rows:
        """See `Run.interference`; runs without samples are skipped."""
        return np.concatenate(
            [np.empty(0, INTERFERENCE_DTYPE), *(run.interference() for run in self.runs)]
        )

    def spec_text(self) -> str:
        """See `Run.spec_text`."""
        return self.spec

    def _source_run(self, segment: Segment) -> tuple[Run, Segment]:
        number, _, own = segment.id.partition(_SEPARATOR)
        return self.runs[int(number) - 1], msgspec.structs.replace(segment, id=own)


def merge_runs(
    runs: Sequence[Run], *, folder: Path, plan: Plan, whole: RunRecord, spec: str = ""
) -> MergedRun:
    """Merge runs.

    Args:
        runs: may be empty.
        folder: contains all of them.
        plan: of all of them.
        whole: the record of the merged run, without the merged fields.
        spec: the resolved spec.
    """
    records = [run.record for run in runs]
    counts: dict[tuple[str, float], int] = {}
    segments: list[Segment] = []
    starts = 0
    for number, record in enumerate(records, start=1):
        for one in record.segments:
            key = (one.kind, one.rate_hz)
            # A repetition has the index of the segment that it replaces.
            counts[key] = counts.get(key, 0) + (not one.rerun_of)
            segments.append(
                msgspec.structs.replace(
                    one,
                    id=_prefixed_id(number, one.id),
                    index=counts[key],
                    rerun_of=_prefixed_id(number, one.rerun_of) if one.rerun_of else "",
                    start=starts + one.start,
                )
            )
        # Each run has processes of its own.
        starts += max((one.start for one in record.segments), default=0)
    merged = msgspec.structs.replace(
        whole,
        processes=tuple(each for record in records for each in record.processes),
        segments=tuple(segments),
        search=_search(records),
        sustained=tuple(
            msgspec.structs.replace(each, segment=_prefixed_id(number, each.segment))
            for number, record in enumerate(records, start=1)
            for each in record.sustained
        ),
        events=tuple(each for record in records for each in record.events),
        harness_overhead=records[0].harness_overhead if records else (),
        confirmation=None,
        output_gaps=tuple(each for record in records for each in record.output_gaps),
        differences=records[0].differences if records else (),
        left_out=tuple(dict.fromkeys(each for record in records for each in record.left_out)),
        unplayed=tuple(dict.fromkeys(each for record in records for each in record.unplayed)),
        # Every run compares the same images; the first one that did so speaks for all.
        accuracy=next((record.accuracy for record in records if record.accuracy), ()),
        identity=common_identity(record.identity for record in records or [whole]),
        gate=whole.gate,
    )
    return MergedRun(folder=folder, record=merged, plan=plan, runs=tuple(runs), spec=spec)


def _prefixed_id(number: int, own: str) -> str:
    return f"{number:03d}{_SEPARATOR}{own}"


def _search(records: Sequence[RunRecord]) -> SearchRecord | None:
    """The bracket that contains the brackets of all runs."""
    found = [record.search for record in records if record.search is not None]
    if not found:
        return None
    holds = [each.holds_hz for each in found if each.holds_hz is not None]
    fails = [each.fails_hz for each in found if each.fails_hz is not None]
    limits = {each.limited_by for each in found}
    proofs = {each.proof for each in found}
    order: tuple[Limit, ...] = ("interrupted", "player", "interference", "range", "graph")
    return SearchRecord(
        probes=tuple(
            msgspec.structs.replace(each, segment=_prefixed_id(number, each.segment))
            for number, record in enumerate(records, start=1)
            for each in (record.search.probes if record.search is not None else ())
        ),
        holds_hz=min(holds) if len(holds) == len(found) else None,
        fails_hz=max(fails) if len(fails) == len(found) else None,
        limited_by=next(each for each in order if each in limits),
        precision=max(each.precision for each in found),
        confidence=min(each.confidence for each in found),
        proof=next((each for each in ("open", "probes", "confirmed") if each in proofs), ""),
        proof_s=min(each.proof_s for each in found),
        lost_at_most=max((each.lost_at_most or 0.0 for each in found), default=None),
        max_lost=max((each.max_lost or 0.0 for each in found), default=None) or None,
        unsteady=tuple(dict.fromkeys(text for each in found for text in each.unsteady)),
        unsteady_ratio=max(each.unsteady_ratio for each in found),
        refuted=next((each.refuted for each in found if each.refuted), ""),
    )
