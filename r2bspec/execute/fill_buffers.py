"""The buffers of a run: the messages of its recordings, and the outputs of preprocessors.

The bags of a plan are located or synthesised, and their messages copied as bytes. Then the
preprocessors process these messages, and their outputs are buffered too. Preprocessors end before
the measurement, so that they take no CPU time from the graph under test.
"""

from __future__ import annotations

import contextlib
import hashlib
import heapq
from collections import Counter, deque
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any, Final

import msgspec

from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.integrity import hash_files
from r2bspec.bags.message_types import begins_with_header, read_stamp
from r2bspec.bags.recording import DataError, RecordedMessage, TimeWindow
from r2bspec.bags.service_events import NO_REQUESTS, SERVICE_EVENT, request_kind, request_side
from r2bspec.datasets.catalogue import locate
from r2bspec.datasets.synthesis import make
from r2bspec.execute.bringup.launcher import Launcher, message_packages
from r2bspec.execute.bringup.readiness import StartDeadline
from r2bspec.execute.diagnose.diagnosis import PhaseGraph
from r2bspec.execute.diagnose.first_fault import find_faults
from r2bspec.execute.errors import CertainRunError, NoOutputError
from r2bspec.execute.graph_matching import (
    expected_subscriptions,
    subscription_counts,
    wait_until_matched,
)
from r2bspec.execute.processes.supervisor import ManagedProcess
from r2bspec.execute.run_context import RunContext
from r2bspec.execute.states import Progress
from r2bspec.ipc import buffers, protocol
from r2bspec.ipc.protocol import STATIC
from r2bspec.plan.plan import DatasetPlan, Plan, ProcessPlan

_TIME_NS: Final = attrgetter("time_ns")


@dataclass(frozen=True)
class ResolvedDataset:
    """A bag on disk, and its provenance for the record."""

    path: Path
    provenance: dict[str, Any]


def obtain_dataset(plan: DatasetPlan, base_dir: Path, progress: Progress) -> ResolvedDataset:
    """Locate a bag, or synthesise it if it is a synthetic dataset that is not in the cache.

    Raises:
        DataError: it does not exist, or cannot be synthesised.
        CertainRunError: its hash differs from the one in the spec (R2B312).
    """
    location = locate(plan.source, base_dir)
    provenance: dict[str, Any] = {"source": plan.source, "kind": location.kind}
    if location.path is None:
        dataset = make(
            plan.source,
            [topic.bag_topic for topic in plan.topics],
            TimeWindow(start_ns=plan.start_ns, end_ns=plan.end_ns),
            progress=progress.step,
        )
        path, digest = dataset.path, dataset.content_sha256
        if dataset.damaged:
            progress.note(
                f"the dataset {plan.source} in the cache was damaged and is created again"
            )
    else:
        path = location.path
        digest = hash_files(path)
    if plan.sha256 and digest.removeprefix("sha256:") != plan.sha256.removeprefix("sha256:"):
        raise CertainRunError(
            f"the hash of {plan.source} is {digest}, not that in the spec",
            hint="Use the bag that the spec expects, or update data_loader.bag.sha256.",
            code="R2B312",
        )
    return ResolvedDataset(path, provenance | {"path": str(path), "sha256": digest})


def buffer_bags(
    bags: Sequence[Path],
    datasets: Sequence[DatasetPlan],
    folder: Path,
    progress: Progress,
    latched: Collection[str] = (),
) -> dict[str, int]:
    """Write a buffer for every topic of the plan, under its name in the graph.

    Messages of one topic may be in several bags; they are buffered in the order of their recording.
    Memory is bounded by a few messages of each bag. Windows are relative to the first message of
    all bags. If transforms are requested, /tf is buffered like other topics, and the complete
    /tf_static, regardless of the window, as one message. A `latched` topic of the graph gets what a
    subscription would get at the start of the window: the last message before it, or else the first
    message in it.

    Returns:
        The number of messages of each topic of the graph.

    Raises:
        DataError: a bag cannot be read.
        OSError: the disk is full.
    """
    types = {
        data_topic.topic: data_topic.type
        for dataset in datasets
        for data_topic in dataset.topics
        if data_topic.topic not in latched
    }
    if any(dataset.publish_tf for dataset in datasets):
        types[buffers.TF] = buffers.TF_TYPE
    stamped = {topic: begins_with_header(type_name) for topic, type_name in types.items()}
    windows = _windows(bags, datasets)
    streams = [
        _read_bag(dataset, bag, window, types.keys())
        for bag, dataset, window in zip(bags, datasets, windows, strict=True)
    ]
    expected = sum(data_topic.count for dataset in datasets for data_topic in dataset.topics)
    writers: dict[str, buffers.BufferWriter] = {}
    with contextlib.ExitStack() as stack:
        for topic, type_name in types.items():
            writer = buffers.BufferWriter(folder, topic, type_name, has_header=stamped[topic])
            stack.callback(writer.close)
            writers[topic] = writer
        # In order of time, each with its topic in the graph.
        merged = heapq.merge(*streams, key=itemgetter(0))
        for done, (_, topic, message) in enumerate(merged):
            stamp_ns = read_stamp(message.data) if stamped[topic] else message.time_ns
            writers[topic].append(stamp_ns, message.data, message.time_ns)
            if done % 16 == 0:
                progress.step(done, max(expected, done))
    counts = {topic: len(writer) for topic, writer in writers.items()}
    for event in (each for dataset in datasets for each in dataset.topics):
        if event.bag_topic.endswith(SERVICE_EVENT) and not counts.get(event.topic):
            said, hint = NO_REQUESTS
            raise DataError(f"{event.bag_topic} {said}", code="R2B242", hint=hint)
    for topic in latched:
        counts |= _buffer_latched(topic, bags, datasets, windows, folder)
    return counts | _buffer_static(bags, datasets, folder)


def _buffer_latched(
    topic: str,
    bags: Sequence[Path],
    datasets: Sequence[DatasetPlan],
    windows: Sequence[TimeWindow],
    folder: Path,
) -> dict[str, int]:
    """Buffer what a subscription to a latched topic gets at the start of the window."""
    before: list[RecordedMessage] = []
    inside: list[RecordedMessage] = []
    for bag, dataset, window in zip(bags, datasets, windows, strict=True):
        names = [each.bag_topic for each in dataset.topics if each.topic == topic]
        if window.start_ns:
            earlier = TimeWindow(end_ns=window.start_ns)
            before += deque(read_messages(bag, names, earlier), maxlen=1)
        inside += islice(read_messages(bag, names, window), 1)
    kinds = [each.type for dataset in datasets for each in dataset.topics if each.topic == topic]
    writer = buffers.BufferWriter(folder, topic, kinds[0], has_header=False)
    for message in sorted(before, key=_TIME_NS)[-1:] or sorted(inside, key=_TIME_NS)[:1]:
        writer.append(message.time_ns, message.data)
    writer.close()
    return {topic: len(writer)}


def _read_bag(
    dataset: DatasetPlan, bag: Path, window: TimeWindow, wanted: Collection[str]
) -> Iterator[tuple[int, str, RecordedMessage]]:
    """Yield the messages of a bag that are read, each after its time and its topic in the graph.

    Of the events of a service, these are the requests of one side.
    """
    targets = {topic.bag_topic: topic.topic for topic in dataset.topics if topic.topic in wanted}
    if dataset.publish_tf and index_bag(bag).find(buffers.TF) is not None:
        targets[buffers.TF] = buffers.TF
    by_name = {name.lstrip("/"): topic for name, topic in targets.items()}
    sides = {
        name: request_side(read_messages(bag, [name], window))
        for name in targets
        if name.endswith(SERVICE_EVENT)
    }
    for message in read_messages(bag, list(targets), window):
        if message.topic in sides:
            kind = request_kind(message.data)
            if kind is None or kind != sides[message.topic]:
                continue
        yield message.time_ns, by_name[message.topic.lstrip("/")], message


def _buffer_static(
    bags: Sequence[Path], datasets: Sequence[DatasetPlan], folder: Path
) -> dict[str, int]:
    """Buffer the static transforms of all bags for which they are requested, as one message."""
    with_static = [
        bag
        for bag, dataset in zip(bags, datasets, strict=True)
        if dataset.publish_tf_static and index_bag(bag).find(buffers.TF_STATIC) is not None
    ]
    messages = [
        message for bag in with_static for message in read_messages(bag, [buffers.TF_STATIC])
    ]
    if not messages:
        return {}
    messages.sort(key=_TIME_NS)
    writer = buffers.BufferWriter(folder, buffers.TF_STATIC, buffers.TF_TYPE, has_header=False)
    writer.append(messages[0].time_ns, merge_static([message.data for message in messages]))
    writer.close()
    return {buffers.TF_STATIC: 1}


def _windows(bags: Sequence[Path], datasets: Sequence[DatasetPlan]) -> list[TimeWindow]:
    """Return the windows of the bags, each relative to the start of its own bag."""
    if len(bags) == 1:
        # Reading it indexes it anyway, which takes long where a recording has no index.
        return [TimeWindow(start_ns=datasets[0].start_ns, end_ns=datasets[0].end_ns)]
    starts_ns = [index_bag(bag).start_ns for bag in bags]
    first_ns = min(starts_ns)
    return [
        TimeWindow(
            start_ns=max(0, dataset.start_ns - (start_ns - first_ns)),
            end_ns=None if dataset.end_ns is None else dataset.end_ns - (start_ns - first_ns),
        )
        for dataset, start_ns in zip(datasets, starts_ns, strict=True)
    ]


def merge_static(messages: Sequence[bytes]) -> bytes:
    """Return one message with the last transform of each child frame.

    A late subscription receives only the last message of a latched topic, so by convention (REP
    105; tf2_ros.StaticTransformBroadcaster) a publisher keeps all transforms in one message.

    Args:
        messages: serialised tf2_msgs/TFMessage in the order of their recording.
    """
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    latest: dict[str, Any] = {}
    for data in messages:
        message: Any = store.deserialize_cdr(data, buffers.TF_TYPE)
        for transform in message.transforms:
            latest[transform.child_frame_id] = transform
    merged = store.types[buffers.TF_TYPE](transforms=list(latest.values()))
    return bytes(store.serialize_cdr(merged, buffers.TF_TYPE))


_PHASE: Final = "preprocess"
_LOAD_TIMEOUT_S = 3600.0


def preprocess(plan: Plan, context: RunContext, launcher: Launcher) -> None:
    """Run the preprocessors on all messages that were buffered from the bag.

    Raises:
        NoOutputError: a recorded topic has no messages.
        RunError: a process exited, failed, or was not ready in time.
    """
    supervisor, buffer_dir = context.supervisor, context.buffer_dir
    graph = PhaseGraph(plan, _PHASE, supervisor, launcher, context.note)
    processes = plan.processes_in(_PHASE)
    recorded = {input_.source: input_.type for input_ in plan.inputs if not input_.bag_topic}
    read = {
        topic.name: set(topic.readers) - {"loader"}
        for topic in plan.topics
        if topic.phase == _PHASE and "loader" in topic.writers
    }
    datasets = plan.datasets or (plan.dataset,)
    types = {topic.topic: topic.type for dataset in datasets for topic in dataset.topics}
    sources = {topic: kind for topic, kind in types.items() if topic in read}
    played = {input_.source for input_ in plan.inputs if input_.bag_topic}
    transforms = buffers.buffered_transforms(buffer_dir)
    if buffers.TF in transforms:
        sources[buffers.TF] = buffers.TF_TYPE
    launcher.check_shared_memory(plan, _PHASE)
    launcher.start_early(processes, message_packages(plan), observer=False)
    loader = launcher.start(next(process for process in processes if process.role == "loader"))
    launcher.configure(
        loader,
        protocol.ConfigureLoader(
            sources=sources,
            recorded=recorded,
            buffer_dir=str(buffer_dir),
            buffer_only=tuple(sorted(played - sources.keys())),
            retime=plan.timeline is not None and plan.timeline.recorded,
            latched=(STATIC,) if buffers.TF_STATIC in transforms else (),
            clock=plan.clock,
        ),
    )
    others = [process for process in processes if process.role != "loader"]
    deadline = StartDeadline(plan.start_timeout.ns)
    nodes = launcher.start_nodes(others, deadline)
    graph.lifecycle.bring_up(deadline)
    if plan.states_in(_PHASE):
        launcher.describe_lifecycle_nodes()
    supervisor.request(loader, protocol.Subscribe(), protocol.Matched, 10.0)
    # An input that is also played as recorded may have no subscription here.
    topics = {
        topic: expected_subscriptions(graph, topic)
        for topic in sources
        if read.get(topic) or topic not in {*played, buffers.TF}
    }
    topics |= dict.fromkeys(recorded, 1) | subscription_counts(graph, transforms)
    between = _expected_subscriptions_by_host(zip(nodes, others, strict=True), launcher, recorded)
    wait_until_matched(graph, {loader: topics} | between, deadline)
    graph.check_parameters()
    load = protocol.Load(
        max_output_gap_ns=plan.drain_timeout.ns,
        real_time=any(dataset.real_time for dataset in datasets),
    )
    loaded = supervisor.request(loader, load, protocol.Loaded, _LOAD_TIMEOUT_S)
    _check_outputs(graph, loaded)
    supervisor.end([loader, *nodes])


def _expected_subscriptions_by_host(
    nodes: Iterable[tuple[ManagedProcess, ProcessPlan]], launcher: Launcher, recorded: Iterable[str]
) -> dict[ManagedProcess, dict[str, int]]:
    """Return how many subscriptions the topics of each host must match.

    The loader counts its own endpoints only. Messages that the first preprocessor of a chain
    publishes before the second one is matched would be lost.
    """
    subscriptions = Counter(list(recorded))
    subscriptions.update(topic for _, topic, _, does in launcher.endpoints if does == "subscribes")
    return {
        child: {
            topic: subscriptions[topic]
            for node, topic, _, does in launcher.endpoints
            if does == "publishes" and node in {node.name for node in process.nodes}
        }
        for child, process in nodes
        if process.role == "host"
    }


def played_digest(plan: Plan, folder: Path) -> str:
    """Return a digest of the messages in the buffers of all inputs and calls; empty without any."""
    whole = hashlib.sha256()
    sources = {input_.source for input_ in plan.inputs}
    sources |= {call.source for call in plan.called.values() if call.source}
    sources |= {latched.source for latched in plan.latched_inputs}
    for topic in sorted(sources):
        index = buffers.read_index(folder, topic)
        whole.update(msgspec.json.encode((topic, index.sizes)))
        with buffers.buffer_path(folder, topic, "cdr").open("rb") as file:
            whole.update(hashlib.file_digest(file, "sha256").digest())
    return whole.hexdigest() if sources else ""


def _check_outputs(graph: PhaseGraph, loaded: protocol.Loaded) -> None:
    """Compare the number of output messages with the number of input messages."""
    silent = [topic for topic, count in loaded.recorded.items() if count == 0]
    published = ", ".join(f"{topic}: {count} messages" for topic, count in loaded.published.items())
    if silent:
        facts = graph.observer.observe(loaded.published | loaded.recorded)
        raise graph.error(
            facts,
            find_faults(facts, silent),
            silent,
            f"no messages on {', '.join(silent)}",
            f"The loader published the input of the preprocessors ({published}).",
            otherwise=NoOutputError,
        )
    # An output made from several inputs has at most as many messages as the shortest one.
    sent = min(
        (count for topic, count in loaded.published.items() if count and topic != buffers.TF),
        default=0,
    )
    for topic, count in loaded.recorded.items():
        if count < sent:
            graph.note(f"{topic}: the preprocessors published {count} messages for {sent} inputs")
