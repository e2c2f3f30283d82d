"""Ending a start before its timeout, when it is certain that the graph will not become ready.

The graph is observed once a second while endpoints are missing. A fault is certain if
`r2bspec.execute.diagnosis.certain_faults` finds it, and if the graph has not changed since
`_UNCHANGED_S`: until then a node may still create or replace endpoints. A graph that has not
changed for longer, and whose nodes are idle (`r2bspec.execute.bringup.idle_nodes`), is stalled.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator

from r2bspec.execute.bringup.idle_nodes import patience_s
from r2bspec.execute.diagnosis.certain_faults import RemappedTopic, certain_topics
from r2bspec.execute.diagnosis.graph_facts import GraphFacts
from r2bspec.plan.plan import Plan
from r2bspec.wiring.name_resolution import expand

_INTERVAL_S = 1.0
_UNCHANGED_S = 4.0
"""A node creates its endpoints one after another, usually within milliseconds; on a busy machine
discovery may show them seconds apart."""


class EarlyDiagnosis:
    """Observes a graph that is not ready.

    Args:
        plan: of the run.
        phase: ``preprocess`` or ``measure``.
        observe: returns the facts of the graph, as discovery shows them now.
        clock: a monotonic clock in seconds.
        idle_s: for how many seconds the nodes have been idle.
        answer: whether all nodes answer, which takes a while.

    Attributes:
        facts: of the graph, once it has not changed for a while; None before.
        stalled_s: for how many seconds a stalled graph has not changed; 0 for any other.
    """

    facts: GraphFacts | None = None
    stalled_s: float = 0.0

    def __init__(
        self,
        plan: Plan,
        phase: str,
        observe: Callable[[], GraphFacts],
        clock: Callable[[], float] = time.monotonic,
        *,
        idle_s: Callable[[], float] = lambda: 0.0,
        answer: Callable[[], bool] = lambda: False,
    ) -> None:
        self._observe = observe
        self._clock = clock
        self._idle_s = idle_s
        self._answer = answer
        self._patience_s = patience_s(plan)
        self._remapped = tuple(remapped_topics(plan, phase))
        self._last: GraphFacts | None = None
        self._unchanged_since = self._next = clock() + _INTERVAL_S

    def certain(self, missing: Collection[str]) -> frozenset[str]:
        """The missing topics that will never be matched; mostly, and at first, none.

        Raises:
            RunError: the observing process does not answer.
        """
        now = self._clock()
        if now < self._next:
            return frozenset()
        facts = self._observe()
        now = self._clock()
        self._next = now + _INTERVAL_S
        if facts != self._last:
            self._last, self._unchanged_since = facts, now
        unchanged_s = now - self._unchanged_since
        # Asked at every look, because it compares with the one before.
        quiet_s = min(unchanged_s, self._idle_s())
        if unchanged_s < _UNCHANGED_S:
            return frozenset()
        self.facts = facts
        if quiet_s >= self._patience_s and self._answer():
            self.stalled_s = unchanged_s
        return certain_topics(facts, missing, self._remapped)


def remapped_topics(plan: Plan, phase: str) -> Iterator[RemappedTopic]:
    """The topics to which a plan remaps the names of nodes."""
    for process in plan.processes:
        for node in process.nodes if process.phase == phase else ():
            own_name = process.role != "command" or f"__node:={node.node}" in process.argv
            for before, after in node.remappings.items():
                full = expand(after, node.node, node.namespace)
                yield RemappedTopic(node.name, before, full, own_name)
