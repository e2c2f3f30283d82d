"""Waiting until publishers and subscriptions have discovered each other, from both sides."""

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
    """Wait until the nodes and the harness have discovered each other from both sides.

    A publisher may have discovered a subscription that has not yet discovered the publisher;
    messages published in this time are lost. The wait is bounded by `_MAX_WAIT_S`, because some
    pairs never match, for example those with incompatible QoS.

    Args:
        supervisor: all processes.
        launcher: has the nodes that can be queried.
        harness_endpoints: the harness's own endpoints, as (topic, type, ``publishes`` or
            ``subscribes``).
    """
    known = [(topic, kind, does) for _, topic, kind, does in launcher.endpoints] + [
        *harness_endpoints
    ]
    publishers = Counter((topic, kind) for topic, kind, does in known if does == "publishes")
    subscriptions = Counter((topic, kind) for topic, kind, does in known if does == "subscribes")
    deadline = time.monotonic() + _MAX_WAIT_S
    undiscovered = {child: {*launcher.host_endpoints(child)} for child in launcher.hosts}
    with supervisor.waiting("nodes: discovery of the harness"):
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
                        >= (subscriptions if does == "publishes" else publishers)[topic, kind]
                    }
            supervisor.pump(_POLL_S)
