"""The loader: publishes the recorded messages to the preprocessors and records their output.

No message may be lost, so the loader does not play at a rate. It keeps a few stamps in flight: it
publishes the next messages when the outputs of earlier ones have arrived, or after a timeout. If
the spec requests real time, messages are published at their recorded times, and messages for which
a preprocessor is too slow are lost.

Some graphs publish an output for only some of their inputs, and some never do. The first missing
output takes the full timeout. Each further one halves the timeout, and each output restores it to a
multiple of the longest time that an output has taken.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import NamedTuple

import msgspec

from r2bspec.bags.message_types import read_stamp
from r2bspec.harness import rclpy_tools
from r2bspec.harness.control_channel import Channel
from r2bspec.harness.observer import GraphParticipant
from r2bspec.ipc import buffers, protocol
from r2bspec.ipc.buffers import TF, TF_QOS
from r2bspec.language.spec import QoS

_MIN_TIMEOUT_NS = 20_000_000
_MIN_FINAL_NS = 500_000_000
_PAUSE_FACTOR = 10


class AdaptiveTimeout:
    """Computes the timeout; `max_ns` is its maximum."""

    def __init__(self, max_ns: int) -> None:
        self._max_ns = max_ns
        self._limit_ns = max_ns
        self._longest_ns = 0
        self._has_expired = False

    @property
    def limit_ns(self) -> int:
        """How long to wait for the next output."""
        return self._limit_ns

    @property
    def final_ns(self) -> int:
        """How long to wait at the end, after the last input."""
        return max(self._limit_ns, self._usual_timeout_ns)

    def answered(self, after_ns: int) -> None:
        """Record an output that arrived `after_ns` after the previous output."""
        self._longest_ns = max(self._longest_ns, after_ns)
        if self._has_expired:
            self._limit_ns = max(self._limit_ns, self._usual_timeout_ns)

    def expired(self) -> None:
        """Record that no output arrived within the timeout."""
        self._has_expired = True
        self._limit_ns = max(_MIN_TIMEOUT_NS, self._limit_ns // 2)

    @property
    def _usual_timeout_ns(self) -> int:
        return min(self._max_ns, max(_MIN_FINAL_NS, _PAUSE_FACTOR * self._longest_ns))


class TopicRecorder:
    """A recorded topic.

    An output answers the source message with the same stamp. Outputs without a stamp, or with a new
    stamp, answer the source messages in order of arrival.
    """

    def __init__(
        self, topic: str, type_name: str, folder: Path, subscription: rclpy_tools.RawSubscription
    ) -> None:
        self.topic = topic
        self.subscription = subscription
        self._stamped = rclpy_tools.begins_with_header(type_name)
        self._buffer = buffers.BufferWriter(folder, topic, type_name, has_header=self._stamped)
        self._sources: dict[int, int] = {}
        self._answers: set[int] = set()
        self._unmatched_count = 0

    def expect(self, sources: dict[int, int]) -> None:
        """Set the stamps of the source messages, each with its number."""
        self._sources = sources

    def answered(self, stamp_ns: int) -> bool:
        """Return True if the output of a source message has arrived."""
        return stamp_ns in self._answers or self._unmatched_count > self._sources[stamp_ns]

    def drain(self) -> int:
        """Record every message that has arrived, and return their number."""
        count = 0
        while (taken := self.subscription.take()) is not None:
            data, received_ns = taken
            # Some middlewares give no time of reception.
            received_ns = received_ns or time.time_ns()
            stamp_ns = read_stamp(data) if self._stamped else received_ns
            self._buffer.append(stamp_ns, data, received_ns)
            if stamp_ns in self._sources:
                self._answers.add(stamp_ns)
            else:
                self._unmatched_count += 1
            count += 1
        return count

    def finish(self) -> int:
        """Complete the buffer, and return the number of its messages."""
        self._buffer.close()
        return len(self._buffer)


_MAX_IN_FLIGHT = 4
"""The maximum number of stamps in flight: less than the default queue depth of ten."""

_POLL_S = 0.05
_DEFAULT_QOS = QoS()


class _SourceMessage(NamedTuple):
    """A buffered message: its key for the order, its stamp, and the time of its recording."""

    turn_ns: int
    stamp_ns: int
    time_ns: int
    topic: str
    position: int


class Loader(GraphParticipant):
    """Publishes the sources and records the outputs of the preprocessors."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureLoader) -> None:
        self._settings = settings
        self._folder = Path(settings.buffer_dir)
        super().__init__(channel, "loader", self._folder, settings.latched, clock=settings.clock)
        self._loop = rclpy_tools.WaitLoop(self._node)
        self._publishers = {
            topic: rclpy_tools.RawPublisher(
                self._node,
                topic,
                type_name,
                rclpy_tools.profile(TF_QOS if topic == TF else _DEFAULT_QOS),
            )
            for topic, type_name in settings.sources.items()
        }
        self._waiting = dict(settings.recorded)
        self._recorders: list[TopicRecorder] = []

    def _serve(self) -> None:
        self._channel.send(protocol.Ready())
        while True:
            match self._channel.receive():
                case protocol.Subscribe() | protocol.CountMatches():
                    self._subscribe()
                    self._channel.send(protocol.Matched(counts=self._matches()))
                case protocol.Load(max_output_gap_ns=max_output_gap_ns, real_time=real_time):
                    self._channel.send(self._load(max_output_gap_ns, real_time=real_time))
                case protocol.Shutdown():
                    return
                case command:
                    self._answer(command)

    def _subscribe(self) -> None:
        """Subscribe to every pending topic whose publisher, and thus QoS, has been discovered."""
        for topic, type_name in list(self._waiting.items()):
            qos = rclpy_tools.profile_matching_publishers(self._node, topic)
            if qos is None:
                continue
            subscription = rclpy_tools.RawSubscription(self._node, topic, type_name, qos)
            self._recorders.append(TopicRecorder(topic, type_name, self._folder, subscription))
            self._loop.add(subscription)
            del self._waiting[topic]

    def _matches(self) -> dict[str, int]:
        counts = {topic: publisher.matches() for topic, publisher in self._publishers.items()}
        counts |= self._latched_matches()
        counts |= dict.fromkeys(self._waiting, 0)
        counts |= {recorder.topic: recorder.subscription.matches() for recorder in self._recorders}
        return counts

    def _load(self, max_output_gap_ns: int, *, real_time: bool) -> protocol.Loaded:
        sources = self._sources(real_time=real_time)
        messages = self._messages(sources)
        answered = (
            data_source
            for data_source in sources
            if data_source.topic in self._publishers and data_source.topic != TF
        )
        stamps = dict.fromkeys(source.stamp_ns for source in answered)
        for recorder in self._recorders:
            recorder.expect({stamp_ns: number for number, stamp_ns in enumerate(stamps)})
        published = dict.fromkeys(self._publishers, 0)
        turns_ns: dict[str, dict[int, int]] = {data_source.topic: {} for data_source in sources}
        in_flight: dict[int, None] = {}
        self._await_latched()
        timeout = AdaptiveTimeout(max_output_gap_ns)
        begin_ns = time.monotonic_ns()
        for known_source in sources:
            if self._interrupted():
                break
            if real_time:
                self._record_until(begin_ns + known_source.time_ns - sources[0].time_ns)
            if known_source.stamp_ns in stamps and known_source.stamp_ns not in in_flight:
                if not real_time:
                    self._wait_for_free_slot(in_flight, timeout)
                in_flight[known_source.stamp_ns] = None
            turns_ns[known_source.topic][known_source.position] = time.time_ns()
            if known_source.topic in self._publishers:
                self._publishers[known_source.topic].publish(
                    messages[known_source.topic][known_source.position]
                )
                published[known_source.topic] += 1
        self._collect_rest(in_flight, timeout)
        if self._settings.retime:
            self._retime(turns_ns)
        recorded = {finished.topic: finished.finish() for finished in self._recorders}
        return protocol.Loaded(published=published, recorded=recorded)

    def _sources(self, *, real_time: bool) -> list[_SourceMessage]:
        """Return all source messages in the order of publication, by time.

        Messages with the same stamp follow each other, at the time of the last one; in real time,
        each message has its own time.
        """
        indexes = [self._index(topic) for topic in (*self._publishers, *self._settings.buffer_only)]
        messages = sorted(
            _SourceMessage(time_ns, stamp_ns, time_ns, index.topic, position)
            for index in indexes
            for position, (stamp_ns, time_ns) in enumerate(
                zip(index.stamps_ns, index.times_ns, strict=True)
            )
        )
        if real_time:
            return messages
        last_ns = {message.stamp_ns: message.time_ns for message in messages}
        return sorted(message._replace(turn_ns=last_ns[message.stamp_ns]) for message in messages)

    def _index(self, topic: str) -> buffers.BufferIndex:
        """Return the index of a buffer, with the header stamps of types that only ROS knows."""
        index = buffers.read_index(self._folder, topic)
        if index.has_header is None and topic in self._settings.sources:
            header = rclpy_tools.begins_with_header(index.type)
            index = (
                buffers.read_stamps(self._folder, index)
                if header
                else msgspec.structs.replace(index, has_header=False)
            )
            buffers.write_index(self._folder, index)
        return index

    def _messages(self, sources: list[_SourceMessage]) -> dict[str, dict[int, bytearray]]:
        """Return the messages that the publishers publish, by topic and position."""
        return {
            topic: buffers.read_messages(
                self._folder,
                topic,
                {source.position for source in sources if source.topic == topic},
            )
            for topic in self._publishers
        }

    def _retime(self, turns_ns: dict[str, dict[int, int]]) -> None:
        """Replace the times of the sources by the times at which they were published."""
        for topic, turns in turns_ns.items():
            index = buffers.read_index(self._folder, topic)
            times_ns = tuple(turns.get(step, 0) for step in range(len(index.sizes)))
            buffers.write_index(self._folder, msgspec.structs.replace(index, times_ns=times_ns))

    def _record_until(self, end_ns: int) -> None:
        """Record outputs until a time."""
        while (left_ns := end_ns - time.monotonic_ns()) > 0 and not self._interrupted():
            self._record(min(_POLL_S, left_ns / 1e9))

    def _wait_for_free_slot(self, in_flight: dict[int, None], timeout: AdaptiveTimeout) -> None:
        """Record outputs until fewer than `_MAX_IN_FLIGHT` stamps are in flight, or a timeout."""
        last_ns = time.monotonic_ns()
        while len(in_flight) >= _MAX_IN_FLIGHT and not self._interrupted():
            answer_count = self._record(min(_POLL_S, timeout.limit_ns / 1e9))
            pause_ns = time.monotonic_ns() - last_ns
            if answer_count:
                last_ns += pause_ns
                timeout.answered(pause_ns)
                for stamp_ns in [
                    candidate_ns for candidate_ns in in_flight if self._answered(candidate_ns)
                ]:
                    del in_flight[stamp_ns]
            elif pause_ns > timeout.limit_ns:
                # Some graphs answer only some messages; missing outputs are counted at the end.
                timeout.expired()
                in_flight.clear()

    def _collect_rest(self, in_flight: dict[int, None], timeout: AdaptiveTimeout) -> None:
        last_ns = time.monotonic_ns()
        while not (self._interrupted() or all(map(self._answered, in_flight))):
            answer_count = self._record(_POLL_S)
            now_ns = time.monotonic_ns()
            if answer_count:
                timeout.answered(now_ns - last_ns)
                last_ns = now_ns
            elif now_ns - last_ns > timeout.final_ns:
                return

    def _interrupted(self) -> bool:
        """Return whether a command has arrived: while loading, this can only be the shutdown."""
        return self._channel.wait(0.0)

    def _answered(self, stamp_ns: int) -> bool:
        return all(recorder.answered(stamp_ns) for recorder in self._recorders)

    def _record(self, timeout_s: float) -> int:
        return sum(self._recorders[topic].drain() for topic in self._loop.wait(timeout_s))
