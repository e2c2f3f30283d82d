"""Recording the messages of one iteration, with the latency of each output.

After the measurement one more iteration is played, which counts for nothing, with a second
subscription to every input and output, by the observer. Copying whole messages takes time from the
machine, so that the measured iterations are left alone, and nothing of this one is timed.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from r2bspec.bags.bag_writer import (
    LATENCY_TYPE,
    latency_message,
    write_output_bag,
)
from r2bspec.bags.recording import Message
from r2bspec.execute.measurement.segments import SegmentHeading, SegmentPlayer
from r2bspec.execute.processes.supervisor import ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.arrivals import ArrivalReader
from r2bspec.ipc.sample_files import read_messages
from r2bspec.measure.matching import NO_MATCH, match, ratio_of, select_expected_steps
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import MONITOR_FIELDS, Segment
from r2bspec.record.sample_arrays import Rows

OUTPUT_BAG = "outputs"
"""The name of the bag in the run folder."""

_MATCH_TIMEOUT_S = 5.0
_POLL_S = 0.05


@dataclass(frozen=True)
class OutputRecorder:
    """Records one iteration of a session.

    Attributes:
        rows_dir: receives the rows and the messages.
    """

    plan: Plan
    supervisor: ProcessSupervisor
    segment_player: SegmentPlayer
    rows_dir: Path
    folder: RunFolder

    def record(self) -> dict[str, int]:
        """Play and record; returns the number of messages by topic in the bag.

        Raises:
            RunError: a process does not respond, or exited.
        """
        watches = recorded_topics(self.plan)
        recording = MessageRecording(self.supervisor, watches, self.rows_dir)
        recording.begin()
        play = max(self.plan.play, key=lambda each: each.rate_hz)
        at = f"{play.rate_hz:g} Hz, " if play.rate_hz else ""
        observation = self.segment_player.play_for(
            SegmentHeading("recorded", "recorded-001", f"{at}recording the messages"),
            play.rate_hz,
            play.duration_ns,
        )
        recording.end()
        return self._write_bag(watches, self.segment_player.segments[-1], observation.playback)

    def _write_bag(
        self, watches: Sequence[MonitorPlan], segment: Segment, playback: Rows
    ) -> dict[str, int]:
        offset_ns = began_ns = 0
        if playback.size:
            # Publishers that keep messages for late subscriptions send those of earlier segments.
            began_ns = int(playback["published_ns"][0])
            offset_ns = int(np.median(playback["stamp_ns"] - playback["published_ns"]))
        monitors = {each.topic: each for each in self.plan.monitors}
        types: dict[str, str] = {}
        streams = []
        for watch in watches:
            path = self.rows_dir / f"{watch.name}.rows"
            if not path.exists():
                continue
            rows = ArrivalReader(path, MONITOR_FIELDS).read(0)
            types[watch.topic] = watch.type
            latency_topic = ""
            latencies = np.full(rows.size, NO_MATCH, dtype=np.int64)
            if (monitor := monitors.get(watch.topic)) is not None and playback.size:
                latency_topic = f"/r2bspec/{monitor.name}/latency"
                types[latency_topic] = LATENCY_TYPE
                latencies = _latencies(self.plan, monitor, segment, playback, rows)
            content = self.rows_dir / f"{watch.name}.messages"
            streams.append(
                _messages(
                    *(watch.topic, latency_topic, rows, latencies, content),
                    began_ns=began_ns,
                    offset_ns=offset_ns,
                )
            )
        merged = heapq.merge(*streams, key=lambda each: each.time_ns)
        return write_output_bag(self.folder.path / OUTPUT_BAG, types, merged)


def recorded_topics(plan: Plan) -> tuple[MonitorPlan, ...]:
    """A subscription for each topic that is played or monitored; no monitor begins with a dot."""
    types = {each.topic: each.type for each in plan.inputs}
    types |= {each.topic: each.type for each in plan.monitors}
    return tuple(
        MonitorPlan(name=f".record-{number}", topic=topic, type=kind, match="order", qos=None)
        for number, (topic, kind) in enumerate(types.items())
    )


def _latencies(
    plan: Plan, monitor: MonitorPlan, segment: Segment, playback: Rows, rows: Rows
) -> Rows:
    """The latency of each message in ns; `NO_MATCH` for one that answers no step."""
    steps = select_expected_steps(playback, plan.inputs, monitor)
    found = match(steps, rows, monitor.match, ratio_of(monitor, segment.played_before))
    latencies = np.full(rows.size, NO_MATCH, dtype=np.int64)
    known = found.step != NO_MATCH
    latencies[known] = rows["received_ns"][known] - steps["published_ns"][found.step[known]]
    return latencies


def _messages(
    topic: str,
    latency_topic: str,
    rows: Rows,
    latencies: Rows,
    content: Path,
    *,
    began_ns: int,
    offset_ns: int,
) -> Iterator[Message]:
    """The messages of a topic from `began_ns` on, each followed by its latency."""
    for received_ns, latency_ns, data in zip(
        rows["received_ns"].tolist(), latencies.tolist(), read_messages(content), strict=False
    ):
        if received_ns < began_ns:
            continue
        time_ns = received_ns + offset_ns
        yield Message(topic=topic, time_ns=time_ns, data=data)
        if latency_topic and latency_ns != NO_MATCH:
            yield Message(topic=latency_topic, time_ns=time_ns, data=latency_message(latency_ns))


@dataclass(frozen=True)
class MessageRecording:
    """A second subscription to some topics, from `begin` to `end`.

    Attributes:
        supervisor: all processes.
        monitors: the topics, with the names of their files.
        folder: receives the files.
    """

    supervisor: ProcessSupervisor
    monitors: tuple[MonitorPlan, ...]
    folder: Path

    def begin(self) -> None:
        """Subscribe, and wait until the publishers are found; some topics may have none.

        Raises:
            RunError: a process does not respond, or exited.
        """
        self._ask(protocol.Record(monitors=self.monitors, folder=str(self.folder)))
        deadline = time.monotonic() + _MATCH_TIMEOUT_S
        while time.monotonic() < deadline:
            found = self._ask(protocol.CountMatches())
            if all(found.counts.get(each.topic) for each in self.monitors):
                return
            self.supervisor.pump(_POLL_S)

    def end(self) -> None:
        """Unsubscribe; the files are complete when this returns.

        Raises:
            RunError: a process does not respond, or the messages could not be written.
        """
        self._ask(protocol.EndRecording())

    def _ask(self, message: Any) -> protocol.Matched:
        observer = self.supervisor.observer()
        return self.supervisor.request(observer, message, protocol.Matched)
