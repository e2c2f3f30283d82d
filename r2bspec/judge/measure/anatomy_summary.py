"""A few numbers of an anatomy for reports: each path by its parts, and each node.

For each rate an iteration is shown, the last that was observed from inside: a table or a drawing is
of messages that belong together.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import msgspec
import numpy as np

from r2bspec.judge.measure.anatomy import Anatomy, NodeAnatomy, anatomy
from r2bspec.judge.measure.anatomy_blockers import Blocker, find_blockers
from r2bspec.judge.measure.anatomy_paths import Part, PartName, Path
from r2bspec.judge.measure.times import Seconds, percentile
from r2bspec.plan.plan import Plan
from r2bspec.record.comparison_folder import MergedRun
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import AnatomyRecord, Segment
from r2bspec.record.sample_arrays import Rows


class PartSummary(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the latency on a path; times are seconds.

    Attributes:
        owner: the node or topic that it belongs to.
        of: which of the two.
        name: what the time passed with; see `r2bspec.judge.measure.anatomy_paths`.
        n: of how many messages it was seen.
        share: of the latency of all messages.
        slowest: of the slowest message; None where it was not seen.
    """

    owner: str
    of: Literal["node", "topic"]
    name: PartName
    n: int
    p50: float | None
    p99: float | None
    mean: float | None
    share: float
    slowest: float | None


class PathSummary(msgspec.Struct, frozen=True, kw_only=True):
    """A path to a monitor; times are seconds.

    Attributes:
        monitor: its name.
        hops: nodes and topics by turns, from the player to the last topic.
        n: how many messages took it.
        last: how many of them came on this path after the other inputs that they needed.
        by_timer: of how many a node of the path sent the message without being caused to.
        slowest: the latency of the slowest message.
        parts: in the order of time.
    """

    monitor: str
    hops: tuple[str, ...]
    n: int
    last: int
    by_timer: int
    p50: float | None
    p99: float | None
    mean: float | None
    slowest: float | None
    parts: tuple[PartSummary, ...]


class NodeSummary(msgspec.Struct, frozen=True, kw_only=True):
    """The activity of a node; times are seconds.

    Attributes:
        name: as in the spec.
        process: the process that it is in.
        threads: how many threads called its callbacks.
        load: the time in callbacks of the node, all threads together, over that of the iteration.
        taken: how many messages it took.
        published: how many it published.
        overtaken: how many were sent to it and never taken.
    """

    name: str
    process: str
    threads: int
    load: float
    taken: int
    published: int
    overtaken: int
    callback_p50: float | None
    callback_p99: float | None
    wait_p50: float | None
    wait_p99: float | None


class AnatomySummary(msgspec.Struct, frozen=True, kw_only=True):
    """The anatomy of one iteration.

    Attributes:
        segment: its id; empty if none could be observed.
        rate_hz: at which it was played; 0 for that of the recording or of the graph's own source.
        paths: to all monitors, of each those first that most messages took last.
        nodes: in the order of the paths, then of their names.
        blockers: the callbacks for which messages waited, where that takes a tenth of a path.
        received: how many messages the monitors received, by name; those whose path is not known
            are in none of the paths.
        lost: events for which there was no room.
        only: the nodes that the spec names, where it has these alone observed: a path is known if
            it leads through no others.
        error: why something is missing; empty if nothing is.
    """

    segment: str
    rate_hz: float
    paths: tuple[PathSummary, ...]
    nodes: tuple[NodeSummary, ...]
    blockers: tuple[Blocker, ...] = ()
    received: dict[str, int] = {}
    lost: int = 0
    only: tuple[str, ...] = ()
    error: str = ""


def summarised(
    found: Anatomy, segment: Segment, record: AnatomyRecord, plan: Plan
) -> AnatomySummary:
    """Return a summary of the anatomy of a segment."""
    paths = [path for paths in found.paths.values() for path in paths]
    on_paths = dict.fromkeys(owner for path in paths for owner in path.hops)
    names = [*(name for name in on_paths if name in found.nodes)]
    names += sorted(found.nodes.keys() - set(names))
    return AnatomySummary(
        segment=segment.id,
        rate_hz=segment.rate_hz,
        paths=tuple(map(_path, paths)),
        nodes=tuple(_node(found.nodes[name]) for name in names),
        blockers=tuple(find_blockers(found.events, record, plan, _waiting(paths))),
        received=dict(found.monitored),
        lost=found.lost,
        # One more iteration, of '--anatomy', observes all of them.
        only=plan.anatomy if isinstance(plan.anatomy, tuple) and segment.kind != "anatomy" else (),
        error=record.error,
    )


_LONG_WAIT: Final = 0.1
"""The share of the latency of a path, or of its 99th percentile, from which a wait is explained."""


def _waiting(paths: list[Path]) -> list[tuple[str, str]]:
    """Return the nodes at which messages of a path wait long, with the topic of the messages."""
    found: dict[tuple[str, str], None] = {}
    for path in paths:
        topic_of = dict(zip(path.hops[2::2], path.hops[1::2], strict=False))
        for part in path.parts:
            if part.name == "wait":
                waits = part.seconds[~np.isnan(part.seconds)]
                is_long = waits.sum() >= _LONG_WAIT * path.seconds.sum() or (
                    (percentile(waits, 0.99) or 0.0)
                    >= _LONG_WAIT * (percentile(path.seconds, 0.99) or 0.0)
                )
                if waits.any() and is_long:
                    found[part.owner, topic_of[part.owner]] = None
    return [*found]


def _path(path: Path) -> PathSummary:
    slowest = int(np.argmax(path.seconds))
    p50, p99, mean = _few(path.seconds)
    whole = float(path.seconds.sum())
    return PathSummary(
        monitor=path.monitor,
        hops=path.hops,
        n=path.seconds.size,
        last=int(np.count_nonzero(path.last)),
        by_timer=int(np.count_nonzero(path.by_timer)),
        p50=p50,
        p99=p99,
        mean=mean,
        slowest=float(path.seconds[slowest]),
        parts=tuple(_part(part, whole, slowest) for part in path.parts),
    )


def _part(part: Part, whole: float, slowest: int) -> PartSummary:
    known = part.seconds[~np.isnan(part.seconds)]
    p50, p99, mean = _few(known)
    of_slowest = float(part.seconds[slowest])
    return PartSummary(
        owner=part.owner,
        of=part.of,
        name=part.name,
        n=known.size,
        p50=p50,
        p99=p99,
        mean=mean,
        share=float(known.sum()) / whole if whole else 0.0,
        slowest=None if np.isnan(of_slowest) else of_slowest,
    )


def _node(node: NodeAnatomy) -> NodeSummary:
    callback, wait = _few(node.callback), _few(node.wait)
    return NodeSummary(
        name=node.name,
        process=node.process,
        threads=len(node.threads),
        load=node.load,
        taken=sum(node.taken.values()),
        published=sum(node.published.values()),
        overtaken=sum(node.overtaken.values()),
        callback_p50=callback[0],
        callback_p99=callback[1],
        wait_p50=wait[0],
        wait_p99=wait[1],
    )


def _few(times: Seconds) -> tuple[float | None, float | None, float | None]:
    """Median, 99th percentile and mean."""
    mean = float(times.mean()) if times.size else None
    return percentile(times, 0.5), percentile(times, 0.99), mean


# The anatomies of a run: of each segment that was observed from inside.


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
