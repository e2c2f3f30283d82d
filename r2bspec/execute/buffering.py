"""From recordings to buffers: straight from recorded bytes, with nothing deserialised."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

from r2bspec.data.headers import begins_with_header
from r2bspec.data.index import index_bag
from r2bspec.data.model import Window
from r2bspec.data.reader import read_messages
from r2bspec.execute.progress import Progress
from r2bspec.harness.buffers import BufferWriter
from r2bspec.harness.stamps import read_stamp
from r2bspec.plan.model import DatasetPlan


def buffer_bags(
    bags: Sequence[Path], datasets: Sequence[DatasetPlan], folder: Path, progress: Progress
) -> dict[str, int]:
    """Write a buffer for every topic of the plan, under its name in the graph.

    Memory is bounded by one message. Windows count from the first message of any of the bags.

    Returns:
        How many messages each topic of the graph got.

    Raises:
        DataError: a bag cannot be read.
        OSError: the disk is full.
    """
    topics = [each for dataset in datasets for each in dataset.topics]
    stamped = {each.topic: bool(begins_with_header(each.type)) for each in topics}
    writers: dict[str, BufferWriter] = {}
    with contextlib.ExitStack() as stack:
        for each in topics:
            if each.topic not in writers:
                has_header = stamped[each.topic]
                writer = BufferWriter(folder, each.topic, each.type, has_header=has_header)
                stack.callback(writer.close)
                writers[each.topic] = writer
        for bag, dataset, window in zip(bags, datasets, _windows(bags, datasets), strict=True):
            _buffer(bag, dataset, window, writers, stamped, progress)
    return {topic: len(writer) for topic, writer in writers.items()}


def _windows(bags: Sequence[Path], datasets: Sequence[DatasetPlan]) -> list[Window]:
    """The windows of the bags, each counted from the start of its own bag."""
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


def _buffer(
    bag: Path,
    dataset: DatasetPlan,
    window: Window,
    writers: dict[str, BufferWriter],
    stamped: dict[str, bool],
    progress: Progress,
) -> None:
    by_name = {each.bag_topic.lstrip("/"): each.topic for each in dataset.topics}
    expected = sum(each.count for each in dataset.topics)
    messages = read_messages(bag, [each.bag_topic for each in dataset.topics], window)
    for done, message in enumerate(messages):
        topic = by_name[message.topic.lstrip("/")]
        stamp_ns = read_stamp(message.data) if stamped[topic] else message.time_ns
        writers[topic].append(stamp_ns, message.data)
        if done % 16 == 0:
            progress.step(done, max(expected, done))
