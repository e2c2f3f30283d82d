"""The anatomies of a run: of each segment that was observed from inside."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from r2bspec.judge.measure.anatomy import Anatomy, anatomy
from r2bspec.judge.measure.anatomy_summary import AnatomySummary, summarised
from r2bspec.judge.measure.times import Seconds
from r2bspec.plan.plan import Plan
from r2bspec.record.comparison_folder import MergedRun
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import AnatomyRecord, Segment
from r2bspec.record.sample_arrays import Rows


@dataclass(frozen=True)
class ObservedRows:
    """The events that were observed from inside in a segment.

    Attributes:
        rows: of type `ANATOMY_DTYPE`.
        record: the record of its start.
    """

    rows: Rows
    record: AnatomyRecord

    def joined(self, plan: Plan, segment: Segment) -> Anatomy:
        """Return the anatomy of the segment."""
        return anatomy(self.record, self.rows, plan, (segment.began_ns, segment.ended_ns))


def observed_values(joined: Anatomy) -> dict[str, Seconds]:
    """Return the observed values of each node and topic; see `SegmentSamples.anatomy`."""
    # Requirements name topics without the slash that they begin with.
    return {
        name.replace("path./", "path.").removeprefix("/"): values
        for name, values in joined.series.items()
    }


def anatomy_summaries(
    run: Run, known: Mapping[str, AnatomySummary] | None = None
) -> tuple[AnatomySummary, ...]:
    """Return the anatomy of the last observed iteration at each rate.

    With several runs, that of the last run.

    A start in which no iteration could be observed has one without paths, which says why.

    Args:
        run: the run.
        known: those that were made before, by segment.

    Raises:
        RecordError: a file of the run is missing or damaged.
    """
    run, known = last_run(run), known or {}
    found = [
        known.get(segment.id)
        or summarised(join_segment(run, segment, record), segment, record, run.plan)
        for segment, record in observed_segments(run)
    ]
    starts = {segment.start for segment in run.record.segments if run.has_anatomy(segment)}
    for record in run.record.anatomies:
        if record.error and record.start not in starts:
            error = f"No iteration of start {record.start} was observed from inside: {record.error}"
            found.append(AnatomySummary(segment="", rate_hz=0, paths=(), nodes=(), error=error))
    return tuple(found)


def last_run(run: Run) -> Run:
    """Return the last of several joined runs; any other run unchanged."""
    return run.runs[-1] if isinstance(run, MergedRun) and run.runs else run


def observed_segments(run: Run) -> Iterator[tuple[Segment, AnatomyRecord]]:
    """Yield the summarised iterations of a run with the events observed in their start."""
    records = {record.start: record for record in run.record.anatomies}
    last = {
        segment.rate_hz: segment
        for segment in run.record.segments
        if segment.kind in {"iteration", "anatomy"}
        and segment.start in records
        and run.has_anatomy(segment)
    }
    for segment in last.values():
        yield segment, records[segment.start]


def join_segment(run: Run, segment: Segment, record: AnatomyRecord) -> Anatomy:
    """Return the anatomy of a segment of a run.

    Raises:
        RecordError: a file of it is missing or damaged.
    """
    return ObservedRows(run.anatomy(segment), record).joined(run.plan, segment)
