"""The player: publishes the buffered inputs, step by step, on a schedule.

The load is open-loop: a step is due at its time whether or not the graph has answered the previous
one. A late step is published immediately, and its lateness is recorded. All inputs of a step have
the same unique header stamp, so that each output can be matched to its input.
"""

from __future__ import annotations

import time
from pathlib import Path

from r2bspec.harness import rclpy_tools
from r2bspec.harness.clock_publisher import ClockPublisher
from r2bspec.harness.control_channel import Channel
from r2bspec.harness.pacing import Pacer
from r2bspec.harness.preloaded_messages import TF_QOS, PreloadedMessages, publish_static_transforms
from r2bspec.ipc import protocol
from r2bspec.ipc.sample_files import RowWriter
from r2bspec.ipc.schedule import NO_STEP, CyclicSchedule, PlaybackEvent, TimelineSchedule
from r2bspec.ipc.step_samples import StepRows
from r2bspec.ipc.transform_stamps import TF, TF_STATIC, TF_TYPE

_START_DELAY_NS = 20_000_000
"""Time between the command to play and the first due time, so that the first step is not late."""


class Player:
    """Keeps the inputs in memory and plays them according to its schedule."""

    def __init__(self, channel: Channel, settings: protocol.ConfigurePlayer) -> None:
        self._channel = channel
        self._settings = settings
        self._node = rclpy_tools.start_node("player")
        self._folder = Path(settings.buffer_dir)
        self._topics = [each.topic for each in settings.inputs]
        headers = [rclpy_tools.begins_with_header(each.type) for each in settings.inputs]
        self._headers = dict(zip(self._topics, headers, strict=True))
        self._stamped = [
            each.timestamp == "header" and header
            for each, header in zip(settings.inputs, headers, strict=True)
        ]
        # Before anything else, so that all nodes, which are started later, receive them.
        self._clock = ClockPublisher(self._node) if settings.clock else None
        self._static_publisher = (
            publish_static_transforms(self._node, self._folder)
            if TF_STATIC in settings.transforms
            else None
        )
        self._publishers = [
            rclpy_tools.RawPublisher(
                self._node, each.topic, each.type, rclpy_tools.profile(each.qos)
            )
            for each in settings.inputs
        ]
        self._transforms = (
            [rclpy_tools.RawPublisher(self._node, TF, TF_TYPE, rclpy_tools.profile(TF_QOS))]
            if TF in settings.transforms
            else []
        )
        self._schedule: CyclicSchedule | TimelineSchedule = CyclicSchedule(steps=())
        self._preloaded: PreloadedMessages | None = None
        self._pacer = Pacer()
        self._rows = RowWriter(Path(settings.rows), width=5)
        self._next = 0
        self._last_stamp_ns = 0

    def serve(self) -> None:
        """Answer commands until told to shut down."""
        try:
            self._serve()
        finally:
            if self._clock is not None:
                self._clock.close()

    def _serve(self) -> None:
        self._channel.send(protocol.Ready(headers=self._headers))
        while True:
            match self._channel.receive():
                case protocol.Follow(schedule=schedule):
                    self._load_schedule(schedule)
                    self._channel.send(protocol.Ready())
                case protocol.CountMatches():
                    self._channel.send(protocol.Matched(counts=self._matches()))
                case protocol.Play(rate_hz=rate_hz, steps=steps):
                    self._channel.send(protocol.Played(steps=self._play(rate_hz, steps)))
                case protocol.Shutdown():
                    return
                case _:
                    # A Stop that arrived after the last step.
                    continue

    def _matches(self) -> dict[str, int]:
        topics = [*self._topics, *(TF for _ in self._transforms)]
        publishers = [*self._publishers, *self._transforms]
        counts = {
            topic: publisher.matches() for topic, publisher in zip(topics, publishers, strict=True)
        }
        return counts | (
            {TF_STATIC: self._static_publisher.matches()} if self._static_publisher else {}
        )

    def _load_schedule(self, schedule: CyclicSchedule | TimelineSchedule) -> None:
        self._schedule = schedule
        self._preloaded = PreloadedMessages(
            schedule,
            self._settings.inputs,
            self._stamped,
            [*self._publishers, *self._transforms],
            self._folder,
        )
        self._next = 0

    def _play(self, rate_hz: float, steps: int) -> int:
        """Publish `steps` steps; fewer if a command arrives. Returns how many were published."""
        if self._preloaded is None:
            return 0
        if self._static_publisher is not None:
            self._static_publisher.wait_for_acknowledgements()
        begin_ns = time.monotonic_ns() + _START_DELAY_NS
        epoch_ns = self._epoch(begin_ns)
        rows = StepRows(self._rows)
        events = self._schedule.events(rate_hz, steps, self._next)
        for number, event in enumerate(events):
            # Relative to the first due time, so that rounding errors do not accumulate.
            due_ns = begin_ns + event.offset_ns
            stamp_ns = self._stamp(self._preloaded, event, due_ns, epoch_ns)
            if self._pacer.wait_until(due_ns, self._channel.wait):
                break
            if number % 64 == 0 and self._channel.wait(0.0):
                # A late player never sleeps, so it must also check for commands here.
                break
            published_ns, done_ns = self._publish(self._preloaded, event)
            if event.step != NO_STEP:
                rows.add_event(event, stamp_ns, due_ns, published_ns, done_ns)
        if isinstance(self._schedule, CyclicSchedule):
            self._next = (self._next + rows.count) % len(self._schedule.steps)
        return rows.count

    def _epoch(self, begin_ns: int) -> int:
        """The system time of the beginning, to which the stamps of a timeline are shifted.

        It is later if a stamp would otherwise repeat, because stamps may be ahead of the clock.
        """
        epoch_ns = time.time_ns() + begin_ns - time.monotonic_ns()
        if isinstance(self._schedule, CyclicSchedule):
            return epoch_ns
        return max(epoch_ns, self._last_stamp_ns + 1 - self._schedule.earliest_stamp_ns())

    def _stamp(
        self, preloaded: PreloadedMessages, event: PlaybackEvent, due_ns: int, epoch_ns: int
    ) -> int:
        """Write the stamp into the messages of the next event; returns the stamp.

        This happens before waiting for the due time: writing to messages that are no longer in the
        cache takes time, which would delay each publication.
        """
        if event.stamp_ns is not None:
            stamp_ns = epoch_ns + event.stamp_ns
        else:
            stamp_ns = time.time_ns() + max(0, due_ns - time.monotonic_ns())
        if event.step != NO_STEP:
            if event.stamp_ns is None:
                stamp_ns = max(stamp_ns, self._last_stamp_ns + 1)
            self._last_stamp_ns = max(stamp_ns, self._last_stamp_ns)
        preloaded.stamp(event, stamp_ns)
        return stamp_ns

    def _publish(self, preloaded: PreloadedMessages, event: PlaybackEvent) -> tuple[int, int]:
        """Publish the messages of an event; returns the times before and after."""
        publications = preloaded.publications(event)
        published_ns = time.monotonic_ns()
        for publish in publications:
            publish()
        return published_ns, time.monotonic_ns()
