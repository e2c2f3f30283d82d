"""The loader: sends the recorded messages through the preprocessors and records what comes out.

Nothing may be lost here, so the loader does not play at a rate. It keeps a few stamps in flight:
the next messages go out when the outputs of earlier ones have come back, or when none has come
for so long (`patience`) that none can be expected.
"""

from __future__ import annotations

import time
from pathlib import Path

from r2bspec.harness import buffers, protocol, ros
from r2bspec.harness.channel import Channel
from r2bspec.harness.monitor import discover, survey
from r2bspec.harness.stamps import read_stamp
from r2bspec.spec.model import QoS

_IN_FLIGHT = 4
"""Stamps that may be under way at once: fewer than the ten that a default queue holds."""

_DEFAULT_QOS = QoS()


class _Recording:
    """One recorded topic.

    An output answers the source message of the same stamp. Outputs that carry no stamp, or one of
    their own, answer in the order in which they come.
    """

    def __init__(self, topic: str, type_name: str, folder: Path, reader: ros.RawReader) -> None:
        self.topic = topic
        self.reader = reader
        self._stamped = ros.begins_with_header(type_name)
        self._buffer = buffers.BufferWriter(folder, topic, type_name, has_header=self._stamped)
        self._sources: dict[int, int] = {}
        self._answers: set[int] = set()
        self._others = 0

    def expect(self, sources: dict[int, int]) -> None:
        """Take note of the stamps of the source messages, each with its number."""
        self._sources = sources

    def answered(self, stamp_ns: int) -> bool:
        """Whether the answer to a source message has come."""
        return stamp_ns in self._answers or self._others > self._sources[stamp_ns]

    def drain(self) -> int:
        """Record every message that has arrived; how many there were."""
        count = 0
        while (taken := self.reader.take()) is not None:
            data, received_ns = taken
            stamp_ns = read_stamp(data) if self._stamped else received_ns
            self._buffer.append(stamp_ns, data)
            if stamp_ns in self._sources:
                self._answers.add(stamp_ns)
            else:
                self._others += 1
            count += 1
        return count

    def finish(self) -> int:
        self._buffer.close()
        return len(self._buffer)


class Loader:
    """Publishes the sources and records the outputs of the preprocessors."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureLoader) -> None:
        self._channel = channel
        self._settings = settings
        self._folder = Path(settings.buffer_dir)
        self._node = ros.start_node("loader")
        self._loop = ros.WaitLoop(self._node)
        self._writers = {
            topic: ros.RawWriter(self._node, topic, type_name, ros.profile(_DEFAULT_QOS))
            for topic, type_name in settings.sources.items()
        }
        self._waiting = dict(settings.recorded)
        self._recordings: list[_Recording] = []

    def serve(self) -> None:
        """Answer commands until told to shut down."""
        self._channel.send(protocol.Ready())
        while True:
            match self._channel.receive():
                case protocol.Subscribe():
                    self._subscribe()
                    self._channel.send(protocol.Matched(counts=self._matches()))
                case protocol.CountMatches():
                    self._subscribe()
                    self._channel.send(protocol.Matched(counts=self._matches()))
                case protocol.Discover(topics=topics):
                    self._channel.send(discover(self._node, topics))
                case protocol.Survey():
                    self._channel.send(survey(self._node))
                case protocol.Load(patience_ns=patience_ns):
                    self._channel.send(self._load(patience_ns))
                case protocol.Play(rate_hz=rate_hz, steps=steps):
                    self._channel.send(protocol.Played(steps=self._again(rate_hz, steps)))
                case protocol.Shutdown():
                    return
                case _:
                    continue

    def _subscribe(self) -> None:
        """Subscribe to every waiting topic whose QoS is known by now."""
        for topic, type_name in list(self._waiting.items()):
            qos = ros.profile_heard_from(self._node, topic)
            if qos is None:
                continue
            reader = ros.RawReader(self._node, topic, type_name, qos)
            self._recordings.append(_Recording(topic, type_name, self._folder, reader))
            self._loop.add(reader)
            del self._waiting[topic]

    def _matches(self) -> dict[str, int]:
        counts = {topic: writer.matches() for topic, writer in self._writers.items()}
        counts |= dict.fromkeys(self._waiting, 0)
        counts |= {each.topic: each.reader.matches() for each in self._recordings}
        return counts

    def _load(self, patience_ns: int) -> protocol.Loaded:
        published = dict.fromkeys(self._writers, 0)
        in_flight: list[int] = []
        schedule = self._schedule()
        stamps = dict.fromkeys(stamp_ns for stamp_ns, _, _ in schedule)
        for recording in self._recordings:
            recording.expect({stamp_ns: number for number, stamp_ns in enumerate(stamps)})
        for stamp_ns, topic, message in schedule:
            if self._interrupted():
                break
            if stamp_ns not in in_flight:
                self._wait_for_room(in_flight, patience_ns)
                in_flight.append(stamp_ns)
            self._writers[topic].publish(message)
            published[topic] += 1
        self._collect_rest(in_flight, patience_ns)
        recorded = {each.topic: each.finish() for each in self._recordings}
        return protocol.Loaded(published=published, recorded=recorded)

    def _schedule(self) -> list[tuple[int, str, bytearray]]:
        """Every source message with its stamp, by stamp, so that partners follow each other."""
        schedule = []
        for topic in self._writers:
            index = buffers.read_index(self._folder, topic)
            messages = buffers.read_messages(self._folder, topic, set(range(len(index.sizes))))
            schedule += [
                (stamp_ns, topic, messages[position])
                for position, stamp_ns in enumerate(index.stamps_ns)
            ]
        return sorted(schedule, key=lambda each: each[0])

    def _wait_for_room(self, in_flight: list[int], patience_ns: int) -> None:
        """Record outputs until fewer than `_IN_FLIGHT` stamps are under way, or patience ends."""
        last_ns = time.monotonic_ns()
        while len(in_flight) >= _IN_FLIGHT and not self._interrupted():
            if self._record(0.05):
                last_ns = time.monotonic_ns()
                in_flight[:] = [stamp_ns for stamp_ns in in_flight if not self._answered(stamp_ns)]
            elif time.monotonic_ns() - last_ns > patience_ns:
                # Some graphs answer only some messages; what is missing is counted at the end.
                in_flight.clear()

    def _collect_rest(self, in_flight: list[int], patience_ns: int) -> None:
        last_ns = time.monotonic_ns()
        while not (self._interrupted() or all(map(self._answered, in_flight))):
            if self._record(0.05):
                last_ns = time.monotonic_ns()
            elif time.monotonic_ns() - last_ns > patience_ns:
                return

    def _again(self, rate_hz: float, steps: int) -> int:
        """Publish the first stamps once more, for whoever wants to see where they go."""
        schedule = self._schedule()
        stamps = [*dict.fromkeys(stamp_ns for stamp_ns, _, _ in schedule)][:steps]
        for number, stamp_ns in enumerate(stamps):
            if self._channel.wait(1 / rate_hz):
                return number
            for at_ns, topic, message in schedule:
                if at_ns == stamp_ns:
                    self._writers[topic].publish(message)
        return len(stamps)

    def _interrupted(self) -> bool:
        """Whether a command waits: while loading there is but one, to shut down."""
        return self._channel.wait(0.0)

    def _answered(self, stamp_ns: int) -> bool:
        return all(each.answered(stamp_ns) for each in self._recordings)

    def _record(self, timeout_s: float) -> int:
        return sum(self._recordings[each].drain() for each in self._loop.wait(timeout_s))
