"""The messages of a schedule in the memory of the player, ready to be stamped and published.

All slow operations are done here, before playback.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rclpy.node import Node

from r2bspec.harness import rclpy_tools
from r2bspec.ipc import buffers
from r2bspec.ipc.header_stamps import write_stamp
from r2bspec.ipc.schedule import PlaybackEvent, Schedule, TimelineSchedule
from r2bspec.ipc.transform_stamps import TF, TF_STATIC, TF_TYPE, StampedTransforms
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import InputPlan

TF_QOS = QoS(depth=100)
TF_STATIC_QOS = QoS(durability="transient_local", depth=1)


class PreloadedMessages:
    """The messages of one schedule.

    Args:
        schedule: of the player.
        inputs: of the plan.
        stamped: for each input, whether a stamp is written into its messages.
        publishers: of the inputs and, if transforms are played, of /tf.
        folder: contains the buffers.
    """

    def __init__(
        self,
        schedule: Schedule,
        inputs: Sequence[InputPlan],
        stamped: Sequence[bool],
        publishers: Sequence[rclpy_tools.RawPublisher],
        folder: Path,
    ) -> None:
        sources = [each.source for each in inputs] + [TF]
        self._stamped = stamped
        self._messages = [
            buffers.read_messages(folder, source, positions) if positions else {}
            for source, positions in zip(sources, schedule.positions_used(), strict=True)
        ]
        self._publications = [
            {position: publisher.publication(message) for position, message in messages.items()}
            for publisher, messages in zip(publishers, self._messages, strict=False)
        ]
        shifts = schedule.shift_transforms if isinstance(schedule, TimelineSchedule) else True
        transforms = self._messages[-1] if shifts else {}
        self._transforms = {
            position: StampedTransforms(message) for position, message in transforms.items()
        }

    def stamp(self, event: PlaybackEvent, stamp_ns: int) -> None:
        """Write a stamp into the messages of an event that have one.

        Args:
            event: with the messages.
            stamp_ns: of a step; for transforms, the new value of their `PlaybackEvent.origin_ns`.
        """
        offsets_ns = event.stamp_offsets_ns or (0,) * len(event.messages)
        for (column, position), offset_ns in zip(event.messages, offsets_ns, strict=True):
            if column == len(self._stamped):
                if position in self._transforms:
                    self._transforms[position].shift(stamp_ns - event.origin_ns)
            elif self._stamped[column]:
                write_stamp(self._messages[column][position], stamp_ns + offset_ns)

    def publications(self, event: PlaybackEvent) -> list[Callable[[], None]]:
        """The functions that publish the messages of an event."""
        return [self._publications[column][position] for column, position in event.messages]


def publish_static_transforms(node: Node, folder: Path) -> rclpy_tools.RawPublisher:
    """Publish the buffered /tf_static as transient local, so that late subscriptions receive it.

    Returns:
        The publisher, which must be kept as long as the transforms must be available.
    """
    publisher = rclpy_tools.RawPublisher(
        node, TF_STATIC, TF_TYPE, rclpy_tools.profile(TF_STATIC_QOS)
    )
    publisher.publish(buffers.read_messages(folder, TF_STATIC, {0})[0])
    return publisher
