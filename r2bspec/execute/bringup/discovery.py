"""Waiting until writers and readers have found each other, each from its own side."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable

from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.processes.supervisor import Children
from r2bspec.ipc import protocol

End = tuple[str, str, str]
"""An endpoint: topic, type, and ``publishes`` or ``subscribes``."""

_ASK_S = 10.0
_POLL_S = 0.02
_MOST_S = 5.0


def wait_until_met(children: Children, launcher: Launcher, ends: Iterable[End]) -> None:
    """Wait until the nodes and the harness have found each other from both sides.

    A writer that has seen its reader need not have been seen by it, and what passes until then is
    lost. What the harness cannot know, as QoS that never match, is waited for only so long.

    Args:
        children: all processes.
        launcher: knows the nodes that can be asked.
        ends: the harness's own endpoints, as (topic, type, ``publishes`` or ``subscribes``).
    """
    known = [(topic, kind, does) for _, topic, kind, does in launcher.endpoints] + [*ends]
    written = Counter((topic, kind) for topic, kind, does in known if does == "publishes")
    read = Counter((topic, kind) for topic, kind, does in known if does == "subscribes")
    deadline = time.monotonic() + _MOST_S
    open_ends = {child: {*launcher.ends_of(child)} for child in launcher.hosts}
    while any(open_ends.values()) and time.monotonic() < deadline:
        for child, waiting in open_ends.items():
            if waiting:
                found = children.ask(child, protocol.CountMatches(), protocol.Matched, _ASK_S)
                waiting -= {
                    (topic, kind, does)
                    for topic, kind, does in waiting
                    if (found.counts if does == "publishes" else found.heard).get(topic, 0)
                    >= (read if does == "publishes" else written)[topic, kind]
                }
        children.pump(_POLL_S)
