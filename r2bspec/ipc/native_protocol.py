"""The messages of `r2bspec.ipc.protocol` as native players and monitors read and write them.

A command is one line of words separated by spaces; other bytes in a word are written as %XX::

    harness                                         ConfigureHarness
    player ROWS CLOCK STATIC-FILE STATIC-BYTES PLANNED INPUTS {TOPIC TYPE QOS STAMPED}
    follow PLAYLIST                                 Follow, after the playlist was written
    play RATE-HZ STEPS                              Play
    monitor ROWS-DIR TYPES {TYPE}                   ConfigureMonitor
    subscribe TOPICS {NAME TOPIC TYPE QOS}          Subscribe
    watch TOPICS {NAME TOPIC TYPE QOS}              Watch
    unwatch                                         Unwatch
    count                                           CountMatches
    stop, shutdown                                  Stop, Shutdown

The INPUTS of a player are the PLANNED ones of the plan, and /tf after them if it is played. A QOS
is ``reliable,volatile,keep_last,10``; CLOCK and STAMPED are 0 or 1; STATIC-FILE is empty if nothing
is latched.

A reply is one line of words, too; the text at its end is written as it is::

    ready                   Ready
    ready {HEADER}          Ready, of a player: 0 or 1 for each planned input
    ready RMW               Ready, of a monitor
    matched {COUNT}         Matched: of each input, or of each topic in the order of the commands;
                            "-" for one without a subscription
    played STEPS            Played
    failed CODE TEXT        Failed
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import msgspec

from r2bspec.ipc import buffers, protocol
from r2bspec.ipc.playlist import write_playlist
from r2bspec.ipc.transform_stamps import TF, TF_QOS, TF_STATIC, TF_TYPE
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import MonitorPlan

_SIMPLE: dict[type, str] = {
    protocol.ConfigureHarness: "harness",
    protocol.Unwatch: "unwatch",
    protocol.CountMatches: "count",
    protocol.Stop: "stop",
    protocol.Shutdown: "shutdown",
}


_HINTS = {
    "R2B651": "Make room on that disk, or choose another folder with --output.",
    "R2B681": "Install its package, or source the workspace that contains it.",
}
"""What to do, by the code of a failure."""


class NativeCodec:
    """Writes the commands for one native part, and reads its replies.

    Names are not sent back, so it remembers the configuration.
    """

    def __init__(self) -> None:
        self._player: protocol.ConfigurePlayer | None = None
        self._playlists = 0
        # In the order of the commands, with whether it is watched for a while only.
        self._topics: list[tuple[str, bool]] = []

    def encode(self, message: Any) -> bytes:
        """Encode a command as one line; for `Follow`, this also writes the playlist.

        Raises:
            OSError: the playlist cannot be written, or a buffer is missing.
            ValueError: a native part knows no such command.
        """
        words = [quote(word, safe="/,_-.+~") for word in self._words(message)]
        return " ".join(words).encode() + b"\n"

    def _words(self, message: Any) -> list[str]:
        match message:
            case protocol.ConfigurePlayer():
                self._player = message
                topics = [each.topic for each in message.inputs]
                topics += [each for each in (TF, TF_STATIC) if each in message.transforms]
                self._topics = [(each, False) for each in topics]
                return ["player", *_player_words(message)]
            case protocol.Follow(schedule=schedule):
                if self._player is None:
                    raise ValueError("a player is configured before it gets a schedule")
                self._playlists += 1
                path = Path(f"{self._player.rows}.playlist-{self._playlists}")
                sources = [each.source for each in self._player.inputs]
                write_playlist(path, schedule, sources, Path(self._player.buffer_dir))
                return ["follow", str(path)]
            case protocol.Play(rate_hz=rate_hz, steps=steps):
                return ["play", repr(float(rate_hz)), str(steps)]
            case protocol.ConfigureMonitor(monitors=monitors, rows_dir=folder):
                types = dict.fromkeys(each.type for each in monitors)
                return ["monitor", folder, str(len(types)), *types]
            case protocol.Subscribe(monitors=monitors):
                self._topics += [(each.topic, False) for each in monitors]
                return ["subscribe", str(len(monitors)), *_topic_words(monitors)]
            case protocol.Watch(monitors=monitors):
                self._topics += [(each.topic, True) for each in monitors]
                return ["watch", str(len(monitors)), *_topic_words(monitors)]
            case protocol.Unwatch():
                self._topics = [each for each in self._topics if not each[1]]
        word = _SIMPLE.get(type(message))
        if word is None:
            raise ValueError(f"no command of a native part: {type(message).__name__}")
        return [word]

    def decode(self, line: bytes) -> protocol.Reply:
        """Read a reply.

        Raises:
            msgspec.DecodeError: the line is none of a native part.
        """
        word, _, rest = line.decode(errors="replace").rstrip("\n").partition(" ")
        words = rest.split()
        match word:
            case "ready" if self._player is not None:
                planned = (each.topic for each in self._player.inputs)
                flags = (each == "1" for each in words)
                return protocol.Ready(headers=dict(zip(planned, flags, strict=False)))
            case "ready":
                return protocol.Ready(rmw=rest)
            case "matched":
                found = zip(self._topics, words, strict=True)
                return protocol.Matched(
                    counts={topic: int(count) for (topic, _), count in found if count != "-"}
                )
            case "played":
                return protocol.Played(steps=int(rest))
            case "failed":
                code, _, text = rest.partition(" ")
                return protocol.Failed(code=code, message=text, hint=_HINTS.get(code, ""))
        raise msgspec.DecodeError(f"no reply of a native part: {word}")


def _player_words(command: protocol.ConfigurePlayer) -> Iterator[str]:
    folder = Path(command.buffer_dir)
    static, size = "", 0
    if TF_STATIC in command.transforms:
        static = str(buffers.buffer_path(folder, TF_STATIC, "cdr"))
        size = buffers.read_index(folder, TF_STATIC).sizes[0]
    has_tf = TF in command.transforms
    yield from (command.rows, str(int(command.clock)), static, str(size))
    yield from (str(len(command.inputs)), str(len(command.inputs) + has_tf))
    for each in command.inputs:
        yield from (each.topic, each.type, _qos_word(each.qos))
        yield str(int(each.timestamp == "header"))
    if has_tf:
        yield from (TF, TF_TYPE, _qos_word(TF_QOS), "0")


def _topic_words(monitors: Iterable[MonitorPlan]) -> Iterator[str]:
    for each in monitors:
        if each.qos is None:
            raise ValueError(f"{each.topic} is subscribed to with a known quality of service")
        yield from (each.name, each.topic, each.type, _qos_word(each.qos))


def _qos_word(qos: QoS) -> str:
    return f"{qos.reliability},{qos.durability},{qos.history},{qos.depth}"
