"""The commands of `r2bspec.ipc.protocol` as native players and monitors read them.

A command is one line of words separated by spaces; other bytes in a word are written as %XX. The
replies are the JSON lines of `protocol`, so they are decoded like those of any other process::

    harness                                         ConfigureHarness
    player ROWS CLOCK STATIC-FILE STATIC-BYTES PLANNED INPUTS {TOPIC TYPE QOS STAMPED}
    follow PLAYLIST                                 Follow, after the playlist was written
    play RATE-HZ STEPS                              Play
    monitor ROWS-DIR TOPICS {NAME TOPIC TYPE QOS}   ConfigureMonitor
    subscribe                                       Subscribe
    watch CONTENT TOPICS {NAME TOPIC TYPE QOS}      Watch
    unwatch                                         Unwatch
    count                                           CountMatches
    stop, shutdown                                  Stop, Shutdown

The INPUTS of a player are the PLANNED ones of the plan, and /tf after them if it is played. A QOS
is ``reliable,volatile,keep_last,10``, or ``-`` for that of the publisher; CLOCK, STAMPED and
CONTENT are 0 or 1; STATIC-FILE is empty if nothing is latched.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from r2bspec.ipc import buffers, protocol
from r2bspec.ipc.playlist import write_playlist
from r2bspec.ipc.transform_stamps import TF, TF_QOS, TF_STATIC, TF_TYPE
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import MonitorPlan

_SIMPLE: dict[type, str] = {
    protocol.ConfigureHarness: "harness",
    protocol.Subscribe: "subscribe",
    protocol.Unwatch: "unwatch",
    protocol.CountMatches: "count",
    protocol.Stop: "stop",
    protocol.Shutdown: "shutdown",
}


class NativeEncoder:
    """Encodes the commands for one native part, whose configuration it remembers."""

    def __init__(self) -> None:
        self._player: protocol.ConfigurePlayer | None = None
        self._playlists = 0

    def __call__(self, message: Any) -> bytes:
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
                return ["monitor", folder, str(len(monitors)), *_topic_words(monitors)]
            case protocol.Watch(monitors=monitors, with_content=content):
                flag = str(int(content))
                return ["watch", flag, str(len(monitors)), *_topic_words(monitors)]
        word = _SIMPLE.get(type(message))
        if word is None:
            raise ValueError(f"no command of a native part: {type(message).__name__}")
        return [word]


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
        qos = "-" if each.qos is None else _qos_word(each.qos)
        yield from (each.name, each.topic, each.type, qos)


def _qos_word(qos: QoS) -> str:
    return f"{qos.reliability},{qos.durability},{qos.history},{qos.depth}"
