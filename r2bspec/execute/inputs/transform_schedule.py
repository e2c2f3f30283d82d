"""Recorded transforms: static ones are merged into one message, others scheduled between steps."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from typing import Any

from r2bspec.execute.inputs.recorded_rate import step_intervals
from r2bspec.ipc.buffers import BufferIndex
from r2bspec.ipc.schedule import CyclicTransform
from r2bspec.ipc.stamps import TF_TYPE


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


def place_transforms(
    transforms: BufferIndex,
    steps: Sequence[tuple[int, ...]],
    inputs: Sequence[BufferIndex],
) -> tuple[CyclicTransform, ...]:
    """The positions of recorded transforms in a round of steps without times.

    Between two steps the transforms are distributed as in the recording: one that was recorded at
    a third of the interval is played at a third of it, at any rate. The differences of its stamps
    to those of the steps are kept; they are exact at the rate of the recording. The transforms
    that followed the last step, for a mean period, are played between the last and the first step.

    Args:
        transforms: the buffer of /tf.
        steps: one round, from `r2bspec.execute.inputs.align_by_stamp.playback_order`.
        inputs: the buffer of each input.
    """
    times_ns = [
        max(index.times_ns[position] for index, position in zip(inputs, step, strict=True))
        for step in steps
    ]
    lags_ns = [
        _lag_ns(step, inputs, time_ns) for step, time_ns in zip(steps, times_ns, strict=True)
    ]
    placed = []
    for number, from_ns, to_ns in step_intervals(times_ns):
        early, late = min(from_ns, to_ns), max(from_ns, to_ns)
        first = bisect.bisect_left(transforms.times_ns, early)
        for position in range(first, bisect.bisect_left(transforms.times_ns, late)):
            at = (transforms.times_ns[position] - from_ns) / (to_ns - from_ns)
            origin_ns = transforms.times_ns[position] + lags_ns[number]
            if at < 1:
                placed.append(CyclicTransform(number + at, position, origin_ns))
    return tuple(sorted(placed, key=lambda each: each.at))


def _lag_ns(step: tuple[int, ...], inputs: Sequence[BufferIndex], time_ns: int) -> int:
    """The stamp of a step minus the time of its recording; usually negative."""
    for index, position in zip(inputs, step, strict=True):
        if index.has_header:
            return index.stamps_ns[position] - time_ns
    return 0
