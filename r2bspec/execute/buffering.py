"""From the bag to buffers: straight from recorded bytes, with nothing deserialised."""

from __future__ import annotations

import contextlib
from pathlib import Path

from r2bspec.data.headers import begins_with_header
from r2bspec.data.model import Window
from r2bspec.data.reader import read_messages
from r2bspec.execute.progress import Progress
from r2bspec.harness.buffers import BufferWriter
from r2bspec.harness.stamps import read_stamp
from r2bspec.plan.model import DatasetPlan


def buffer_bag(bag: Path, dataset: DatasetPlan, folder: Path, progress: Progress) -> dict[str, int]:
    """Write a buffer for every topic of the plan, under its name in the graph.

    Memory is bounded by one message.

    Returns:
        How many messages each topic of the graph got.

    Raises:
        DataError: the bag cannot be read.
        OSError: the disk is full.
    """
    by_name = {each.bag_topic.lstrip("/"): each for each in dataset.topics}
    expected = sum(each.count for each in dataset.topics)
    window = Window(start_ns=dataset.start_ns, end_ns=dataset.end_ns)
    writers: dict[str, BufferWriter] = {}
    stamped = {each.topic: bool(begins_with_header(each.type)) for each in dataset.topics}
    with contextlib.ExitStack() as stack:
        for each in dataset.topics:
            writer = BufferWriter(folder, each.topic, each.type, has_header=stamped[each.topic])
            stack.callback(writer.close)
            writers[each.topic] = writer
        messages = read_messages(bag, [each.bag_topic for each in dataset.topics], window)
        for done, message in enumerate(messages):
            topic = by_name[message.topic.lstrip("/")].topic
            stamp_ns = read_stamp(message.data) if stamped[topic] else message.time_ns
            writers[topic].append(stamp_ns, message.data)
            if done % 16 == 0:
                progress.step(done, max(expected, done))
    return {topic: len(writer) for topic, writer in writers.items()}
