"""Recordings to buffers: locating or synthesising the bags of a plan, and copying them as bytes."""

from __future__ import annotations

import contextlib
import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.bag_writer import begins_with_header
from r2bspec.bags.integrity import hash_files
from r2bspec.bags.recording import Message, Window
from r2bspec.datasets.locate_bag import locate
from r2bspec.datasets.synthesis import make
from r2bspec.execute.errors import DatasetMismatchError
from r2bspec.execute.progress import Progress
from r2bspec.ipc.buffers import TF, TF_STATIC, TF_TYPE, BufferWriter, read_stamp
from r2bspec.plan.plan import DatasetPlan


@dataclass(frozen=True)
class ResolvedDataset:
    """A bag on disk, and its provenance for the record."""

    path: Path
    provenance: dict[str, Any]


def obtain_dataset(plan: DatasetPlan, base_dir: Path, progress: Progress) -> ResolvedDataset:
    """Locate the bag, or synthesise it if it is a synthetic one that is not in the cache.

    Raises:
        DataError: it does not exist, or cannot be synthesised.
        DatasetMismatchError: its hash differs from the one in the spec.
    """
    location = locate(plan.source, base_dir)
    provenance: dict[str, Any] = {"source": plan.source, "kind": location.kind}
    if location.path is None:
        made = make(
            plan.source,
            [each.bag_topic for each in plan.topics],
            Window(start_ns=plan.start_ns, end_ns=plan.end_ns),
            progress=progress.step,
        )
        path, digest = made.path, made.content_sha256
        if made.damaged:
            progress.note(f"the dataset {plan.source} in the cache was damaged; it was made anew")
    else:
        path = location.path
        digest = hash_files(path)
    if plan.sha256 and digest.removeprefix("sha256:") != plan.sha256.removeprefix("sha256:"):
        raise DatasetMismatchError(
            f"the hash of {plan.source} is {digest}, not the one in the spec",
            hint="Use the bag that the spec expects, or update data_loader.bag.sha256.",
        )
    return ResolvedDataset(path, provenance | {"path": str(path), "sha256": digest})


class _BagSource(NamedTuple):
    """The topics to read from one bag, with their names in the graph."""

    bag: Path
    targets: Mapping[str, str]
    window: Window


def buffer_bags(
    bags: Sequence[Path], datasets: Sequence[DatasetPlan], folder: Path, progress: Progress
) -> dict[str, int]:
    """Write a buffer for every topic of the plan, under its name in the graph.

    Messages of one topic may be in several bags; they are buffered in the order of their
    recording. Memory is bounded by a few messages of each bag. Windows are relative to the first
    message of all bags. If transforms are requested, /tf is buffered like other topics, and the
    complete /tf_static, regardless of the window, as one message.

    Returns:
        The number of messages of each topic of the graph.

    Raises:
        DataError: a bag cannot be read.
        OSError: the disk is full.
    """
    types = {each.topic: each.type for dataset in datasets for each in dataset.topics}
    if any(dataset.publish_tf for dataset in datasets):
        types[TF] = TF_TYPE
    stamped = {topic: begins_with_header(type_name) for topic, type_name in types.items()}
    parts = [
        _BagSource(bag, _graph_topics(dataset, bag), window)
        for bag, dataset, window in zip(bags, datasets, _windows(bags, datasets), strict=True)
    ]
    expected = sum(each.count for dataset in datasets for each in dataset.topics)
    writers: dict[str, BufferWriter] = {}
    with contextlib.ExitStack() as stack:
        for topic, type_name in types.items():
            writer = BufferWriter(folder, topic, type_name, has_header=stamped[topic])
            stack.callback(writer.close)
            writers[topic] = writer
        for done, (topic, message) in enumerate(_merge_bags(parts)):
            stamp_ns = read_stamp(message.data) if stamped[topic] else message.time_ns
            writers[topic].append(stamp_ns, message.data, message.time_ns)
            if done % 16 == 0:
                progress.step(done, max(expected, done))
    counts = {topic: len(writer) for topic, writer in writers.items()}
    return counts | _buffer_static(bags, datasets, folder)


def _graph_topics(dataset: DatasetPlan, bag: Path) -> dict[str, str]:
    """The topics of a bag that are read, with their names in the graph."""
    targets = {each.bag_topic: each.topic for each in dataset.topics}
    if dataset.publish_tf and index_bag(bag).find(TF) is not None:
        targets[TF] = TF
    return targets


def _merge_bags(parts: Sequence[_BagSource]) -> Iterator[tuple[str, Message]]:
    """The messages of all bags in order of time, each with its topic in the graph."""
    streams = [_read_bag(part) for part in parts]
    for _, topic, message in heapq.merge(*streams, key=itemgetter(0)):
        yield topic, message


def _read_bag(part: _BagSource) -> Iterator[tuple[int, str, Message]]:
    by_name = {name.lstrip("/"): topic for name, topic in part.targets.items()}
    for message in read_messages(part.bag, list(part.targets), part.window):
        yield message.time_ns, by_name[message.topic.lstrip("/")], message


def _buffer_static(
    bags: Sequence[Path], datasets: Sequence[DatasetPlan], folder: Path
) -> dict[str, int]:
    """Buffer the static transforms of all bags for which they are requested, as one message."""
    with_static = [
        bag
        for bag, dataset in zip(bags, datasets, strict=True)
        if dataset.publish_tf_static and index_bag(bag).find(TF_STATIC) is not None
    ]
    found = [message for bag in with_static for message in read_messages(bag, [TF_STATIC])]
    if not found:
        return {}
    found.sort(key=lambda each: each.time_ns)
    writer = BufferWriter(folder, TF_STATIC, TF_TYPE, has_header=False)
    writer.append(found[0].time_ns, merge_static([each.data for each in found]))
    writer.close()
    return {TF_STATIC: 1}


def _windows(bags: Sequence[Path], datasets: Sequence[DatasetPlan]) -> list[Window]:
    """The windows of the bags, each relative to the start of its own bag."""
    if len(bags) == 1:
        return [Window(start_ns=datasets[0].start_ns, end_ns=datasets[0].end_ns)]
    starts_ns = [index_bag(bag).start_ns for bag in bags]
    first_ns = min(starts_ns)
    return [
        Window(
            start_ns=max(0, dataset.start_ns - (start_ns - first_ns)),
            end_ns=None if dataset.end_ns is None else dataset.end_ns - (start_ns - first_ns),
        )
        for dataset, start_ns in zip(datasets, starts_ns, strict=True)
    ]


def merge_static(messages: Sequence[bytes]) -> bytes:
    """One message with the last transform to each child frame.

    A late subscription receives only the last message of a latched topic, so by convention
    (REP 105; tf2_ros.StaticTransformBroadcaster) a publisher keeps all transforms in one message.

    Args:
        messages: serialised tf2_msgs/TFMessage in the order of their recording.
    """
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    latest: dict[str, Any] = {}
    for data in messages:
        message: Any = store.deserialize_cdr(data, TF_TYPE)
        for transform in message.transforms:
            latest[transform.child_frame_id] = transform
    merged = store.types[TF_TYPE](transforms=list(latest.values()))
    return bytes(store.serialize_cdr(merged, TF_TYPE))
