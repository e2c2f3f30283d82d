"""Further iterations, which count for nothing: messages are recorded, or compared with the truth.

They are played after the measurement, with a second subscription, by the observer. Copying whole
messages takes time from the machine, so that the measured iterations are left alone, and nothing of
these is timed.

One records every input and output, with the latency of each output. Another plays every step of the
recording once more, at the lowest rate of the plan. An output answers a step, and the messages of a
step have the stamps of the recording in the buffers; the ground truth is filed under these.
"""

from __future__ import annotations

import contextlib
import heapq
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from r2bspec.bags.bag_writer import LATENCY_TYPE, latency_message, write_output_bag
from r2bspec.bags.recording import RecordedMessage
from r2bspec.datasets.ground_truth import GroundTruth, read_disparity, read_ground_truth
from r2bspec.execute.measurement.segments import (
    PLAYBACK_ROWS,
    SegmentHeading,
    SegmentPlayer,
    titled,
)
from r2bspec.execute.processes.supervisor import ProcessSupervisor
from r2bspec.execute.run_context import RunContext
from r2bspec.ipc import protocol
from r2bspec.ipc.arrivals import ArrivalReader
from r2bspec.ipc.buffers import read_index, read_stamps
from r2bspec.ipc.playback_file import PlaybackReader
from r2bspec.ipc.sample_files import read_messages
from r2bspec.ipc.schedule import CyclicSchedule, Schedule
from r2bspec.judge.measure.matching import NO_MATCH, match, ratio_of, select_expected_steps
from r2bspec.judge.measure.truth_accuracy import DisparityAccuracy, TagAccuracy, TagPose
from r2bspec.language.spec import Truth
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.record.run_record import AccuracyRecord, Segment
from r2bspec.record.sample_arrays import MONITOR_FIELDS, PLAYBACK_FIELDS, Rows

OUTPUT_BAG = "outputs"
"""The name of the bag in the run folder."""

_MATCH_TIMEOUT_S = 5.0
_POLL_S = 0.05


def record_outputs(
    plan: Plan, context: RunContext, segment_player: SegmentPlayer, rows_dir: Path
) -> dict[str, int]:
    """Play one iteration and record it; returns the number of messages by topic in the bag.

    Args:
        plan: of the run.
        context: of the run.
        segment_player: of the start that runs.
        rows_dir: receives the rows and the messages.

    Raises:
        RunError: a process does not respond, or exited.
    """
    recorded = {source.topic: source.type for source in plan.inputs}
    recorded |= {monitor.topic: monitor.type for monitor in plan.monitors}
    watches = _subscriptions("record", recorded)
    play = max(plan.play, key=lambda each: each.rate_hz)
    title = titled(play.rate_hz, "recording the messages")
    with recorded_messages(context.supervisor, watches, rows_dir):
        observation = segment_player.play_for(
            SegmentHeading("recorded", "recorded-001", title), play.rate_hz, play.duration_ns
        )
    segment, playback = segment_player.segments[-1], observation.playback
    offset_ns = began_ns = 0
    if playback.size:
        # Publishers that keep messages for late subscriptions send those of earlier segments.
        began_ns = int(playback["published_ns"][0])
        offset_ns = int(np.median(playback["stamp_ns"] - playback["published_ns"]))
    monitors = {monitor_plan.topic: monitor_plan for monitor_plan in plan.monitors}
    types: dict[str, str] = {}
    streams = []
    for watch in watches:
        path = rows_dir / f"{watch.name}.rows"
        if not path.exists():
            continue
        rows = ArrivalReader(path, MONITOR_FIELDS).read(0)
        types[watch.topic] = watch.type
        latency_topic = ""
        latencies = np.full(rows.size, NO_MATCH, dtype=np.int64)
        if (monitor := monitors.get(watch.topic)) is not None and playback.size:
            latency_topic = f"/r2bspec/{monitor.name}/latency"
            types[latency_topic] = LATENCY_TYPE
            latencies = _latencies(plan, monitor, segment, playback, rows)
        streams.append(
            _messages(
                watch.topic,
                latency_topic,
                rows,
                latencies,
                rows_dir / f"{watch.name}.messages",
                began_ns=began_ns,
                offset_ns=offset_ns,
            )
        )
    merged = heapq.merge(*streams, key=lambda each: each.time_ns)
    return write_output_bag(context.folder.path / OUTPUT_BAG, types, merged)


def _subscriptions(name: str, types: Mapping[str, str]) -> tuple[MonitorPlan, ...]:
    """A subscription for each topic of these types; the name of no monitor begins with a dot."""
    return tuple(
        MonitorPlan(name=f".{name}-{number}", topic=topic, type=kind, match="order", qos=None)
        for number, (topic, kind) in enumerate(types.items())
    )


def _latencies(
    plan: Plan, monitor: MonitorPlan, segment: Segment, playback: Rows, rows: Rows
) -> Rows:
    """The latency of each message in ns; `NO_MATCH` for one that answers no step."""
    steps = select_expected_steps(playback, plan.inputs, monitor)
    steps_of = match(steps, rows, monitor.match, ratio_of(monitor, segment.played_before))
    latencies = np.full(rows.size, NO_MATCH, dtype=np.int64)
    is_known = steps_of.step != NO_MATCH
    latencies[is_known] = (
        rows["received_ns"][is_known] - steps["published_ns"][steps_of.step[is_known]]
    )
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
) -> Iterator[RecordedMessage]:
    """The messages of a topic from `began_ns` on, each followed by its latency."""
    for received_ns, latency_ns, data in zip(
        rows["received_ns"].tolist(), latencies.tolist(), read_messages(content), strict=False
    ):
        if received_ns < began_ns:
            continue
        time_ns = received_ns + offset_ns
        yield RecordedMessage(topic=topic, time_ns=time_ns, data=data)
        if latency_topic and latency_ns != NO_MATCH:
            yield RecordedMessage(
                topic=latency_topic, time_ns=time_ns, data=latency_message(latency_ns)
            )


@contextlib.contextmanager
def recorded_messages(
    supervisor: ProcessSupervisor, monitors: tuple[MonitorPlan, ...], folder: Path
) -> Iterator[None]:
    """A second subscription to some topics, some of which may have no publisher.

    The files are complete afterwards.

    Args:
        supervisor: all processes.
        monitors: the topics, with the names of their files.
        folder: receives the files.

    Raises:
        RunError: a process does not respond, or exited, or the messages could not be written.
    """

    def ask(message: Any) -> protocol.Matched:
        return supervisor.ask_observer(message, protocol.Matched)

    def are_matched() -> bool:
        counts = ask(protocol.CountMatches()).counts
        return all(counts.get(monitor.topic) for monitor in monitors)

    ask(protocol.RecordMessages(monitors=monitors, folder=str(folder)))
    supervisor.pump_until(are_matched, _MATCH_TIMEOUT_S, _POLL_S)
    yield
    ask(protocol.EndRecording())


def compare_with_truth(
    plan: Plan,
    context: RunContext,
    segment_player: SegmentPlayer,
    rows_dir: Path,
    datasets: Sequence[Path],
) -> tuple[AccuracyRecord, ...]:
    """Play one more iteration, and compare its outputs.

    Args:
        plan: of the run.
        context: of the run.
        segment_player: of the start that runs.
        rows_dir: has the rows of the player, and receives what is recorded.
        datasets: the folders of the recordings, of which some may have a ground truth.

    Raises:
        RunError: a process does not respond, or exited.
    """
    monitors = [(monitor, monitor.truth) for monitor in plan.monitors if monitor.truth is not None]
    watches = _subscriptions("truth", {monitor.topic: monitor.type for monitor, _ in monitors})
    paths = {watch.topic: rows_dir / f"{watch.name}.rows" for watch in watches}
    schedule = segment_player.schedule
    first = PlaybackReader(rows_dir / PLAYBACK_ROWS, PLAYBACK_FIELDS).count()
    rates = [play.rate_hz for play in plan.play] + list(plan.sustained_hz)
    rates += [plan.search.min_hz] if plan.search is not None else []
    # The lowest one; 0 where the recording sets it.
    rate_hz = min(rates, default=0.0)
    heading = SegmentHeading("recorded", "truth-001", titled(rate_hz, "comparing with the truth"))
    with recorded_messages(context.supervisor, watches, rows_dir):
        playback = segment_player.play(heading, rate_hz, len(schedule.steps)).playback
    by_place = _recorded_stamps(plan, context.buffer_dir, schedule)
    # A timeline begins anew with each playback, a cyclic schedule goes on.
    begin = first if isinstance(schedule, CyclicSchedule) else 0
    stamps = [by_place[(begin + number) % len(by_place)] for number in range(playback.size)]
    records = []
    for monitor, truth in monitors:
        steps = select_expected_steps(playback, plan.inputs, monitor)
        record = AccuracyRecord(
            monitor=monitor.name,
            kind=truth.kind,
            of=truth.name,
            outputs=0,
            steps=int(steps.size),
            values={},
        )
        path = paths[monitor.topic]
        if not path.exists():
            records.append(_with_problem(record, f"{monitor.topic} had no publisher."))
            continue
        rows = ArrivalReader(path, MONITOR_FIELDS).read(0)
        ratio = ratio_of(monitor, segment_player.segments[-1].played_before)
        step_of = match(steps, rows, monitor.match, ratio).step
        places = np.searchsorted(playback["stamp_ns"], steps["stamp_ns"])
        messages = read_messages(path.with_suffix(".messages"))
        outputs = [
            (stamps[int(places[step])], data)
            for step, data in zip(step_of.tolist(), messages, strict=False)
            if step != NO_MATCH
        ]
        records.append(compare_outputs(record, monitor, truth, outputs, datasets))
    return tuple(records)


def _recorded_stamps(plan: Plan, folder: Path, schedule: Schedule) -> list[frozenset[int]]:
    """For each step of a round, the stamps that its messages had in the recording."""
    if not isinstance(schedule, CyclicSchedule):
        return [frozenset({step.stamp_ns}) for step in schedule.steps]
    recorded = []
    for column in schedule.columns or range(len(plan.inputs)):
        index = read_index(folder, plan.inputs[column].source)
        if index.has_header is None:
            index = read_stamps(folder, index)
        recorded.append(index.stamps_ns)
    return [
        frozenset(stamps[position] for stamps, position in zip(recorded, step, strict=True))
        for step in schedule.steps
    ]


def compare_outputs(
    record: AccuracyRecord,
    monitor: MonitorPlan,
    truth: Truth,
    outputs: Sequence[tuple[frozenset[int], bytes]],
    datasets: Sequence[Path],
) -> AccuracyRecord:
    """Compare outputs, each with the recorded stamps of its step, with the truth of a recording."""
    found = [(folder, known) for folder in datasets if (known := read_ground_truth(folder))]
    if not found:
        return _with_problem(record, "The recording has no ground truth.")
    from r2bspec.bags.message_types import typestore

    compare = _compare_disparity if truth.kind == "disparity" else _compare_tag
    store = typestore()
    messages = [(stamps, store.deserialize_cdr(data, monitor.type)) for stamps, data in outputs]
    for folder, known in found:
        try:
            accuracy = compare(folder, known, truth.name, messages)
        except KeyError:
            continue
        except (OSError, ValueError) as error:
            return _with_problem(record, f"The ground truth cannot be read: {error}.")
        if outputs and not accuracy.images:
            return _with_problem(record, "The ground truth has none of the stamps of the outputs.")
        return msgspec.structs.replace(
            record, outputs=accuracy.images, values=accuracy.values, text=accuracy.text
        )
    return _with_problem(record, f"The ground truth has no {truth.kind} of {truth.name}.")


def _with_problem(record: AccuracyRecord, problem: str) -> AccuracyRecord:
    return msgspec.structs.replace(record, problem=problem)


Outputs = Sequence[tuple[frozenset[int], Any]]


def _compare_disparity(
    folder: Path, known: GroundTruth, pair: str, outputs: Outputs
) -> DisparityAccuracy:
    """Compare DisparityImage messages.

    Raises:
        KeyError: the ground truth has no such pair.
    """
    stamps_ns = frozenset(known.stereo[pair].stamps_ns)
    accuracy = DisparityAccuracy()
    for stamps, message in outputs:
        image = message.image
        if (at := stamps & stamps_ns) and image.encoding == "32FC1":
            values = np.frombuffer(image.data, ">f4" if image.is_bigendian else "<f4")
            pixels = values.reshape(image.height, image.step // 4)[:, : image.width]
            true = read_disparity(folder, pair, min(at))
            accuracy.add(pixels.astype(np.float32), message.min_disparity, true)
    return accuracy


def _compare_tag(folder: Path, known: GroundTruth, topic: str, outputs: Outputs) -> TagAccuracy:
    """Compare PoseArray messages.

    Raises:
        KeyError: the ground truth has no such image topic.
    """
    del folder
    sightings: Mapping[str, Any] = known.tag.sightings if known.tag is not None else {}
    by_stamp = {
        sighting.stamp_ns: sighting for sighting in sightings[f"/{topic.removeprefix('/')}"]
    }
    accuracy = TagAccuracy()
    for stamps, message in outputs:
        at = stamps & by_stamp.keys()
        if not at:
            continue
        seen = by_stamp[min(at)]
        true = TagPose(seen.position_m, seen.orientation_xyzw) if seen.visible else None
        accuracy.add([_tag_pose(pose) for pose in message.poses], true)
    return accuracy


def _tag_pose(pose: Any) -> TagPose:
    at, turned = pose.position, pose.orientation
    return TagPose((at.x, at.y, at.z), (turned.x, turned.y, turned.z, turned.w))
