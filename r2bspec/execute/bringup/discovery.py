"""Waiting until writers and readers have found each other, each from its own side."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable

from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.processes.supervisor import ProcessSupervisor
from r2bspec.ipc import protocol

EndpointKey = tuple[str, str, str]
"""An endpoint: topic, type, and ``publishes`` or ``subscribes``."""

_REPLY_TIMEOUT_S = 10.0
_POLL_S = 0.02
_MAX_WAIT_S = 5.0


def wait_for_mutual_discovery(
    supervisor: ProcessSupervisor, launcher: Launcher, harness_endpoints: Iterable[EndpointKey]
) -> None:
    """Wait until the nodes and the harness have found each other from both sides.

    A writer that has seen its reader need not have been seen by it, and what passes until then is
    lost. What the harness cannot know, as QoS that never match, is waited for only so long.

    Args:
        supervisor: all processes.
        launcher: knows the nodes that can be asked.
        harness_endpoints: the harness's own endpoints, as (topic, type, ``publishes`` or
            ``subscribes``).
    """
    known = [(topic, kind, does) for _, topic, kind, does in launcher.endpoints] + [
        *harness_endpoints
    ]
    written = Counter((topic, kind) for topic, kind, does in known if does == "publishes")
    read = Counter((topic, kind) for topic, kind, does in known if does == "subscribes")
    deadline = time.monotonic() + _MAX_WAIT_S
    undiscovered = {child: {*launcher.host_endpoints(child)} for child in launcher.hosts}
    while any(undiscovered.values()) and time.monotonic() < deadline:
        for child, waiting in undiscovered.items():
            if waiting:
                found = supervisor.request(
                    child, protocol.CountMatches(), protocol.Matched, _REPLY_TIMEOUT_S
                )
                waiting -= {
                    (topic, kind, does)
                    for topic, kind, does in waiting
                    if (found.counts if does == "publishes" else found.publisher_counts).get(
                        topic, 0
                    )
                    >= (read if does == "publishes" else written)[topic, kind]
                }
        supervisor.pump(_POLL_S)
