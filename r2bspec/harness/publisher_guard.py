"""Looking at who publishes on the topics of a run: discovery shows publishers of any program.

A domain keeps runs apart that r2bspec started, but it is no fence: a program of another user that
joins it can publish on the topics of the run. What it publishes is measured, or handed to the
nodes, like anything else.
"""

from __future__ import annotations

import contextlib
import os
import pwd
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
from rclpy.node import Node

from r2bspec.ipc.protocol import RUN_ID_VARIABLE, ForeignPublisher
from r2bspec.middleware.middleware import PROC, middleware_of

LOOK_PERIOD_S = 0.2
_UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
"""What rmw says of a node whose name has not been discovered yet."""
_MAX_PROCESSES = 3


class PublisherGuard:
    """Remembers every publisher on some topics that no process of the run may have made."""

    def __init__(self, node: Node, topics: tuple[str, ...]) -> None:
        self._node = node
        self._counts = dict.fromkeys(topics, 0)
        self._known: set[tuple[str, str]] = set()
        self._foreign: dict[tuple[str, str], ForeignPublisher] = {}
        self._next_s = 0.0

    def foreign(self) -> tuple[ForeignPublisher, ...]:
        """All that were seen until now."""
        self.look(now=True)
        return tuple(self._foreign.values())

    def look(self, *, now: bool = False) -> None:
        """See who publishes; looks at most five times a second, unless told `now`.

        To count publishers takes some microseconds, so that is what happens while a run measures.
        """
        if not now and time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + LOOK_PERIOD_S
        for topic, before in self._counts.items():
            count = self._node.count_publishers(topic)
            if now or count != before or self._lacks_a_name(topic):
                self._counts[topic] = count
                self._look_at(topic)

    def _lacks_a_name(self, topic: str) -> bool:
        return any(
            each.topic == topic and _UNKNOWN_NODE in each.node for each in self._foreign.values()
        )

    def _look_at(self, topic: str) -> None:
        for info in self._node.get_publishers_info_by_topic(topic):
            gid = bytes(info.endpoint_gid)
            key = (topic, gid.hex())
            node = f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            if key in self._foreign:
                # An endpoint is discovered before its node: the name may come with a later look.
                if _UNKNOWN_NODE in self._foreign[key].node:
                    self._foreign[key] = msgspec.structs.replace(self._foreign[key], node=node)
            elif key not in self._known:
                self._known.add(key)
                processes = list(_processes_of(gid))
                if not any(map(_is_of_this_run, processes)):
                    self._foreign[key] = ForeignPublisher(
                        topic=topic,
                        node=node,
                        gid=gid.hex(),
                        processes=tuple(map(_describe, processes[:_MAX_PROCESSES])),
                    )


def _processes_of(gid: bytes) -> Iterator[Path]:
    """The processes of this host that an endpoint can belong to, by its identifier."""
    middleware = middleware_of(os.environ)
    for folder in PROC.glob("[0-9]*"):
        if middleware.may_be_endpoint_of(gid, (int(folder.name),)):
            yield folder


def _is_of_this_run(folder: Path) -> bool:
    wanted = f"{RUN_ID_VARIABLE}={os.environ.get(RUN_ID_VARIABLE, '')}".encode()
    with contextlib.suppress(OSError):
        return wanted in (folder / "environ").read_bytes().split(b"\0")
    return False


def _describe(folder: Path) -> str:
    name, user = "?", "?"
    with contextlib.suppress(OSError):
        name = (folder / "comm").read_text(errors="replace").strip()
        owner = folder.stat().st_uid
        user = str(owner)
        with contextlib.suppress(KeyError):
            user = pwd.getpwuid(owner).pw_name
    return f"{name} ({folder.name}) of user {user}"
