"""Publishers on the topics of a run that are no process's of the run.

What they publish is in the samples, or was given to the nodes, so nothing that was measured says
anything about the graph.
"""

from __future__ import annotations

import os

from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.middleware.middleware import RMW_VARIABLE, middleware_of
from r2bspec.plan.plan import Plan
from r2bspec.plan.taps import all_taps

_PREFIX_DIGITS = 24
_REPLY_TIMEOUT_S = 10.0


def guarded_topics(plan: Plan) -> tuple[str, ...]:
    """The topics on which only processes of the run may publish: what is played and watched.

    None where nodes of others take part, or a process loads another middleware than the observer,
    so that it cannot be known by its identifiers.
    """
    if plan.external or any(RMW_VARIABLE in each.env for each in plan.processes):
        return ()
    topics = [each.topic for each in plan.inputs]
    topics += [each.topic for each in plan.monitors]
    topics += [each.topic for each in all_taps(plan.monitors)]
    return tuple(dict.fromkeys(topics))


def foreign_publishers(supervisor: ProcessSupervisor, observer: ManagedProcess) -> tuple[str, ...]:
    """Every publisher that was seen on guarded topics and is no process's of the run, in words."""
    seen = supervisor.request(
        observer, protocol.ListForeign(), protocol.ForeignPublishers, _REPLY_TIMEOUT_S
    ).publishers
    if not seen:
        return ()
    # The observer knows processes by their environment, which one may have lost or may hide.
    pids = supervisor.pids()
    middleware = middleware_of(os.environ)
    foreign = [
        each for each in seen if not middleware.may_be_endpoint_of(bytes.fromhex(each.gid), pids)
    ]
    return tuple(dict.fromkeys(_describe(each) for each in foreign))


def _describe(publisher: protocol.ForeignPublisher) -> str:
    who = " or ".join(publisher.processes) or "no process of this host"
    return (
        f"{publisher.topic}: node {publisher.node} "
        f"(GUID prefix {publisher.gid[:_PREFIX_DIGITS]}; {who})"
    )
