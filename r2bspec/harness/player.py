"""The player: publishes the buffered inputs, step by step, on a schedule.

The schedule is open: a step is due at its time whether or not the graph has answered the last one,
and a step that is late is published at once, with its lateness on record. All inputs of a step
carry the same unique header stamp, so that each output can be matched to its input.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from r2bspec.harness import buffers, protocol, ros
from r2bspec.harness.channel import Channel
from r2bspec.harness.pacing import Pacer
from r2bspec.harness.rows import RowWriter
from r2bspec.harness.stamps import write_stamp

_LEAD_NS = 20_000_000
"""Time between the command to play and the first due time, so that the first step is not late."""


@dataclass(frozen=True)
class _Step:
    """What is published together: the messages to stamp, and what publishes each input."""

    stamped: list[bytearray]
    publications: list[Callable[[], None]]


class Player:
    """Holds the inputs in memory and plays them in a loop."""

    def __init__(self, channel: Channel, settings: protocol.ConfigurePlayer) -> None:
        self._channel = channel
        self._node = ros.start_node("player")
        folder = Path(settings.buffer_dir)
        self._writers = [
            ros.RawWriter(self._node, each.topic, each.type, ros.profile(each.qos))
            for each in settings.inputs
        ]
        self._topics = [each.topic for each in settings.inputs]
        self._stamped = [
            each.timestamp == "header" and ros.begins_with_header(each.type)
            for each in settings.inputs
        ]
        memory = [
            buffers.read_messages(folder, each.source, {step[column] for step in settings.steps})
            for column, each in enumerate(settings.inputs)
        ]
        publications = [
            {position: writer.publication(message) for position, message in messages.items()}
            for writer, messages in zip(self._writers, memory, strict=True)
        ]
        self._steps = [
            _Step(
                stamped=[
                    memory[column][position]
                    for column, position in enumerate(step)
                    if self._stamped[column]
                ],
                publications=[
                    publications[column][position] for column, position in enumerate(step)
                ],
            )
            for step in settings.steps
        ]
        self._pacer = Pacer()
        self._rows = RowWriter(Path(settings.rows), width=4)
        self._next = 0
        self._last_stamp_ns = 0
        # Nothing here makes cycles; a collection in mid-play would only delay a publication.
        gc.collect()
        gc.disable()

    def serve(self) -> None:
        """Answer commands until told to shut down."""
        self._channel.send(protocol.Ready())
        while True:
            match self._channel.receive():
                case protocol.CountMatches():
                    counts = {
                        topic: writer.matches()
                        for topic, writer in zip(self._topics, self._writers, strict=True)
                    }
                    self._channel.send(protocol.Matched(counts=counts))
                case protocol.Play(rate_hz=rate_hz, steps=steps):
                    self._channel.send(protocol.Played(steps=self._play(rate_hz, steps)))
                case protocol.Shutdown():
                    return
                case _:
                    # A Stop that crossed with the end of playing.
                    continue

    def _play(self, rate_hz: float, steps: int) -> int:
        """Publish `steps` steps; fewer if a command arrives. Returns how many were published."""
        begin_ns = time.monotonic_ns() + _LEAD_NS
        period_ns = 1e9 / rate_hz
        for step in range(steps):
            # From the first due time, not from the last: rounding must not add up.
            due_ns = begin_ns + round(step * period_ns)
            stamp_ns = self._stamp_next(due_ns)
            if self._pacer.wait_until(due_ns, self._channel.wait):
                return step
            if step % 64 == 0 and self._channel.wait(0.0):
                # A player that is late never sleeps, and would not hear a command otherwise.
                return step
            self._publish_next(stamp_ns, due_ns)
        return steps

    def _stamp_next(self, due_ns: int) -> int:
        """Write the time at which the next step will be published into its messages.

        Done before waiting: touching messages that are no longer in the cache takes its time, and
        would make each publication late by it.
        """
        until_due_ns = max(0, due_ns - time.monotonic_ns())
        stamp_ns = max(time.time_ns() + until_due_ns, self._last_stamp_ns + 1)
        self._last_stamp_ns = stamp_ns
        for message in self._steps[self._next].stamped:
            write_stamp(message, stamp_ns)
        return stamp_ns

    def _publish_next(self, stamp_ns: int, due_ns: int) -> None:
        step = self._steps[self._next]
        self._next = (self._next + 1) % len(self._steps)
        published_ns = time.monotonic_ns()
        for publish in step.publications:
            publish()
        self._rows.append(stamp_ns, due_ns, published_ns, time.monotonic_ns())
