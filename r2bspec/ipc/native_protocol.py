"""The messages of `r2bspec.ipc.protocol` in the form of native players and monitors.

A command is a list of words, each followed by a zero byte; their number follows from the words
before::

    harness                                         ConfigureHarness
    player INPUTS {TYPE QOS TOPIC BUFFER}           ConfigurePlayer
    play PLAYLIST                                   LoadSchedule, after the playlist was written
    play PLAYBACK                                   Play, after the playback file was written
    watch PROCESSES {PID}                           WatchClocks
    monitor STALLS TYPES {TYPE}                     ConfigureMonitor
    subscribe TOPICS {TYPE ROWS QOS TOPIC}   Subscribe
    start_tap TOPICS {TYPE ROWS QOS TOPIC}   StartTap
    stop_tap                                        StopTap
    count                                           CountMatches
    stop                                            Stop
    shutdown                                        Shutdown

The INPUTS of a player are those of the plan, and /tf after them if it is played. A TYPE is three
words: the library that has the type, the function in it that returns it, and its name. A QOS is
eight words: the numbers that rmw has for reliability, durability and history, the depth, deadline
and lifespan in ns, 0 for none, the number for liveliness, and its lease duration. STALLS and ROWS
are the paths of files of rows, which the monitor makes.

A reply is one line of words; the text at its end is written as it is::

    ready                   Ready
    ready {HEADER}          Ready, of a player: 0 or 1 for each input
    ready RMW               Ready, of a monitor
    matched {COUNT}         Matched: of each input of a player, or of each topic of a monitor, the
                            latest one first; -1 for one without a subscription
    played STEPS            Played; for a playlist, Ready
    watched CLOCKS          Watched
    failed CODE TEXT        Failed
    failed errno NUMBER WHAT: REASON    Failed; the code follows from the number
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import msgspec

from r2bspec.errors import is_refusal, refusal_text
from r2bspec.ipc import buffers, playback_file, protocol
from r2bspec.ipc.buffers import TF, TF_QOS, TF_TYPE
from r2bspec.ipc.sample_files import STALL_FILE
from r2bspec.ipc.schedule import Schedule
from r2bspec.language.quantities import Duration
from r2bspec.language.spec import QoS
from r2bspec.language.spec_graph import RMW_NUMBERS
from r2bspec.plan.package_advice import ros_package_advice
from r2bspec.plan.plan import MonitorPlan

_SIMPLE: dict[type, str] = {
    protocol.ConfigureHarness: "harness",
    protocol.StopTap: "stop_tap",
    protocol.CountMatches: "count",
    protocol.Stop: "stop",
    protocol.Shutdown: "shutdown",
}


_FULL_DISK = "Make room on that disk, or choose another folder with --output."
_MISSING_TYPE = re.compile(r"message type (\w+)/")


def _hint(code: str, message: str) -> str:
    """Return what to do about a failure; empty if nothing is known."""
    if code == "R2B681" and (found := _MISSING_TYPE.match(message)):
        return f"To install it: {ros_package_advice(found[1])}."
    return _FULL_DISK if code == "R2B651" else ""


class NativeCodec:
    """Writes the commands for one native part, and reads its replies.

    Names are not sent back, so it remembers the configuration. The files of a player are written
    here, too.
    """

    def __init__(self) -> None:
        self._player: protocol.ConfigurePlayer | None = None
        self._played: playback_file.PlaybackReader | None = None
        self._rows_dir: Path | None = None
        self._round: playback_file.Round | None = None
        self._headers: dict[str, bool] = {}
        self._is_loading = False
        self._playlists = 0
        self._playbacks = 0
        self._clocks = 0
        # Steps that were played of earlier schedules.
        self._steps_before = 0
        # In the order of the counts, with whether it is tapped for a while only.
        self._topics: list[tuple[str, bool]] = []

    def encode(self, message: Any) -> bytes:
        """Encode a command; for `LoadSchedule` and `Play`, this also writes their files.

        Raises:
            OSError: a file cannot be written, or a buffer is missing.
            ValueError: a native part knows no such command, or a message on /tf is damaged.
        """
        return b"".join(os.fsencode(word) + b"\0" for word in self._words(message))

    def _words(self, message: Any) -> list[str]:
        match message:
            case protocol.ConfigurePlayer():
                self._player = message
                topics = [input_.topic for input_ in message.inputs]
                topics += [TF] if TF in message.transforms else []
                self._topics = [(topic, False) for topic in topics]
                self._played = playback_file.PlaybackReader(Path(message.rows), ())
                return ["player", *_player_words(message)]
            case protocol.LoadSchedule(schedule=schedule):
                self._is_loading = True
                return ["play", str(self._write_playlist(schedule))]
            case protocol.Play():
                self._is_loading = False
                return ["play", str(self._write_playback(message))]
            case protocol.WatchClocks(pids=pids):
                return ["watch", str(len(pids)), *map(str, pids)]
            case protocol.ConfigureMonitor(monitors=monitors, rows_dir=folder):
                self._rows_dir = Path(folder)
                types = dict.fromkeys(monitor.type for monitor in monitors)
                words = (word for type_ in types for word in _type_words(type_))
                return ["monitor", str(self._rows_dir / STALL_FILE), str(len(types)), *words]
            case protocol.Subscribe(monitors=monitors):
                self._add_topics(monitors, is_tapped=False)
                return ["subscribe", str(len(monitors)), *self._topic_words(monitors)]
            case protocol.StartTap(monitors=monitors):
                self._add_topics(monitors, is_tapped=True)
                return ["start_tap", str(len(monitors)), *self._topic_words(monitors)]
            case protocol.StopTap():
                self._topics = [topic for topic in self._topics if not topic[1]]
        word = _SIMPLE.get(type(message))
        if word is None:
            raise ValueError(f"no command of a native part: {type(message).__name__}")
        return [word]

    def _write_playlist(self, schedule: Schedule) -> Path:
        if self._player is None or self._played is None:
            raise ValueError("a player is configured before it gets a schedule")
        self._playlists += 1
        path = Path(f"{self._player.rows}.playlist-{self._playlists}")
        inputs = self._player.inputs
        stamped = [
            input_.timestamp == "header" and self._headers.get(input_.topic, False)
            for input_ in inputs
        ]
        self._round = playback_file.read_round(
            schedule, [input_.source for input_ in inputs], stamped, Path(self._player.buffer_dir)
        )
        playback_file.write_playlist(path, self._round)
        self._steps_before = self._played.count()
        return path

    def _write_playback(self, play: protocol.Play) -> Path:
        if self._player is None or self._played is None or self._round is None:
            raise ValueError("a player gets a schedule before it plays")
        self._playbacks += 1
        path = playback_file.playback_path(Path(self._player.rows), self._playbacks)
        # A playback may have been stopped: the next one goes on after the last complete step.
        first = (self._played.count() - self._steps_before) % self._round.steps
        playback_file.write_playback(
            path,
            self._round,
            play.rate_hz,
            play.steps,
            first,
            self._played.last_stamp_ns(),
            clocks=self._clocks,
            begin_ns=play.begin_ns,
            delays_ns=play.delays_ns,
        )
        return path

    def _topic_words(self, monitors: Iterable[MonitorPlan]) -> Iterator[str]:
        if self._rows_dir is None:
            raise ValueError("a monitor is configured before it gets topics")
        for monitor in monitors:
            if monitor.qos is None:
                raise ValueError(
                    f"{monitor.topic} is subscribed to with a known quality of service"
                )
            rows = self._rows_dir / f"{monitor.name}.rows"
            yield from (
                *_type_words(monitor.type),
                str(rows),
                *_qos_words(monitor.qos),
                monitor.topic,
            )

    def _add_topics(self, monitors: Iterable[MonitorPlan], *, is_tapped: bool) -> None:
        for monitor in monitors:
            self._topics.insert(0, (monitor.topic, is_tapped))

    def decode(self, line: bytes) -> protocol.Reply:
        """Read a reply.

        Raises:
            msgspec.DecodeError: the line is none of a native part.
        """
        word, _, rest = line.decode(errors="replace").rstrip("\n").partition(" ")
        words = rest.split()
        match word:
            case "ready" if self._player is not None:
                planned = (input_.topic for input_ in self._player.inputs)
                flags = (flag == "1" for flag in words)
                headers = dict(zip(planned, flags, strict=False))
                self._headers |= headers
                return protocol.Ready(headers=headers)
            case "ready":
                return protocol.Ready(rmw=rest)
            case "matched":
                # The count of a topic with several subscriptions is that of the latest one.
                flags_of = reversed([*zip(self._topics, words, strict=True)])
                return protocol.Matched(
                    counts={topic: int(count) for (topic, _), count in flags_of if count != "-1"}
                )
            case "played" if self._is_loading:
                return protocol.Ready()
            case "played":
                return protocol.Played(steps=int(rest))
            case "watched":
                self._clocks = int(rest)
                return protocol.Watched(clocks=self._clocks)
            case "failed":
                return _failure(rest)
        raise msgspec.DecodeError(f"no reply of a native part: {word}")


def _failure(text: str) -> protocol.Failed:
    code, _, message = text.partition(" ")
    if code == "errno":
        number, _, message = message.partition(" ")
        what, _, reason = message.rpartition(": ")
        error = OSError(int(number), reason, what)
        code = "R2B630"
        if is_refusal(error):
            code, message = "R2B651", refusal_text(error)
    return protocol.Failed(code=code, message=message, hint=_hint(code, message))


def _player_words(command: protocol.ConfigurePlayer) -> Iterator[str]:
    folder = Path(command.buffer_dir)
    inputs = [(input_.topic, input_.type, input_.qos, input_.source) for input_ in command.inputs]
    if TF in command.transforms:
        inputs.append((TF, TF_TYPE, TF_QOS, TF))
    yield str(len(inputs))
    for topic, kind, qos, source in inputs:
        path = buffers.buffer_path(folder, source, "cdr")
        yield from (*_type_words(kind), *_qos_words(qos), topic, str(path))


def _type_words(name: str) -> tuple[str, str, str]:
    """Return a type by the names that rosidl gives to its generated code."""
    package, _, message = name.partition("/msg/")
    getter = "rosidl_typesupport_c__get_message_type_support_handle"
    return f"lib{package}__rosidl_typesupport_c.so", f"{getter}__{package}__msg__{message}", name


def _qos_words(qos: QoS) -> Iterator[str]:
    yield str(RMW_NUMBERS["reliability"][qos.reliability])
    yield str(RMW_NUMBERS["durability"][qos.durability])
    yield str(RMW_NUMBERS["history"][qos.history])
    yield str(qos.depth)
    yield _nanoseconds(qos.deadline)
    yield _nanoseconds(qos.lifespan)
    yield str(RMW_NUMBERS["liveliness"][qos.liveliness])
    yield _nanoseconds(qos.lease_duration)


def _nanoseconds(limit: Duration | None) -> str:
    """Return a limit of a profile, or 0 for none."""
    return str(limit.ns if limit is not None else 0)
