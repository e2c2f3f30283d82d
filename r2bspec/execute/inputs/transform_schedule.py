"""Recorded transforms: the static ones merged into one message, the others placed between steps."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from typing import Any

from r2bspec.ipc.buffers import BufferIndex
from r2bspec.ipc.schedule import CyclicTransform, round_length_ns
from r2bspec.ipc.transform_stamps import TF_TYPE


def merge_static(messages: Sequence[bytes]) -> bytes:
    """One message with the last transform to each child frame.

    A late joiner gets the last message of a latched topic only, so by convention
    (REP 105; tf2_ros.StaticTransformBroadcaster) each publisher keeps all that it knows in one.

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
    """Where recorded transforms lie in a round of steps that have no times of their own.

    Between two steps they are spread as they were in the recording: a transform that was recorded
    a third of the way from one step to the next is played there, whatever the rate. Its stamps are
    as far from those of the steps as they were, at the rate of the recording exactly so. Between
    the last and the first step come those that followed the last one, for a mean period.

    Args:
        transforms: what was recorded of /tf.
        steps: one round, as `r2bspec.execute.inputs.align_by_stamp.playback_order` gives it.
        inputs: what was buffered for each input.
    """
    times_ns = [
        max(index.times_ns[position] for index, position in zip(inputs, step, strict=True))
        for step in steps
    ]
    lags_ns = [
        _lag_ns(step, inputs, time_ns) for step, time_ns in zip(steps, times_ns, strict=True)
    ]
    period_ns = round_length_ns(sorted(set(times_ns))) // len(set(times_ns))
    placed = []
    for number, from_ns in enumerate(times_ns):
        last = number + 1 == len(steps)
        to_ns = times_ns[(number + 1) % len(steps)]
        if last and to_ns <= from_ns and len(set(times_ns)) == len(times_ns):
            to_ns = from_ns + period_ns
        early, late = min(from_ns, to_ns), max(from_ns, to_ns)
        first = bisect.bisect_left(transforms.times_ns, early)
        for position in range(first, bisect.bisect_left(transforms.times_ns, late)):
            at = (transforms.times_ns[position] - from_ns) / (to_ns - from_ns)
            origin_ns = transforms.times_ns[position] + lags_ns[number]
            if at < 1:
                placed.append(CyclicTransform(number + at, position, origin_ns))
    return tuple(sorted(placed, key=lambda each: each.at))


def _lag_ns(step: tuple[int, ...], inputs: Sequence[BufferIndex], time_ns: int) -> int:
    """How much later than its recording a step is stamped; usually negative."""
    for index, position in zip(inputs, step, strict=True):
        if index.has_header:
            return index.stamps_ns[position] - time_ns
    return 0
