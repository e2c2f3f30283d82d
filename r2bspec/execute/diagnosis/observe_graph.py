"""Observing the running graph: its endpoints and, while some steps are played, its messages."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from r2bspec.execute.diagnosis.find_fault import (
    Fault,
    find_input_fault,
    first_fault,
    full_path,
    path_lines,
)
from r2bspec.execute.diagnosis.graph_facts import GraphFacts, gather_facts
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.arrivals import ArrivalReader
from r2bspec.ipc.sample_files import RowReader
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.record.run_record import MONITOR_FIELDS

TRACE_RATE_HZ = 10.0
TRACE_STEPS = 10
"""Enough to tell a node that publishes rarely from one that never does."""

_REPLY_TIMEOUT_S = 10.0
_MAX_MATCH_WAIT_S = 3.0
_QUIET_PERIOD_S = 0.5
_MAX_QUIET_WAIT_S = 5.0
_MAX_DISCOVERY_S = 10.0
"""Discovery takes a fraction of a second, and much longer on a busy machine."""

_SUBSCRIPTION_DEPTH = 1000
_POLL_S = 0.02
_DISCOVERY_INTERVAL_S = 0.3
_Answer = TypeVar("_Answer")
_COMMON_TOPICS = ("/rosout", "/parameter_events")


class GraphObserver:
    """Observes the graph.

    Args:
        supervisor: all processes.
        observer: a process that says what discovery shows: the observer or a loader.
        plan: of the run.
        phase: ``preprocess`` or ``measure``.
        known: endpoints that exist for certain, as in `protocol.Ready`: discovery is incomplete
            until it shows all of them.
        monitor: counts messages for `trace`.
    """

    def __init__(
        self,
        supervisor: ProcessSupervisor,
        observer: ManagedProcess,
        plan: Plan,
        phase: str,
        known: Iterable[tuple[str, str, str, str]] = (),
        monitor: ManagedProcess | None = None,
    ) -> None:
        self._known_endpoints = [*known]
        self._supervisor = supervisor
        self._observer = observer
        self._monitor = monitor
        self._plan = plan
        self._phase = phase

    def look(self) -> GraphFacts:
        """The endpoints that discovery shows at this moment; there may be more."""
        found = self._ask(protocol.ListGraph(), protocol.GraphSnapshot)
        return self._gather(found, self._discover(found))

    def observe(self) -> GraphFacts:
        """The endpoints of every topic; nothing is played."""
        return self._gather(*self._wait_for_discovery())

    def trace(self, rows_dir: Path, play: Callable[[], None]) -> GraphFacts:
        """The endpoints, and the messages of every topic while `play` plays `TRACE_STEPS` steps.

        Args:
            rows_dir: the folder where the monitor's process writes its rows.
            play: plays the steps and returns when they have been published.
        """
        found, discovered = self._wait_for_discovery()
        # A run may be traced more than once, and a file of rows is never opened again.
        now = time.monotonic_ns()
        watches = tuple(
            MonitorPlan(
                name=f".look-{now}-{number}",
                topic=topic,
                type=publishers[0].type,
                match="order",
                # Not left to the monitor, which may have discovered less than the observer.
                qos=weakest_offer(publishers),
            )
            for number, (topic, publishers) in enumerate(discovered.writers.items())
            if publishers
        )
        self._ask_monitor(protocol.StartTap(monitors=watches))
        self._wait_for_matches({each.topic for each in watches})
        files = {
            each.topic: ArrivalReader(rows_dir / f"{each.name}.rows", MONITOR_FIELDS)
            for each in watches
            if (rows_dir / f"{each.name}.rows").exists()
        }
        # Messages that publishers keep for late subscriptions arrive now; they are not counted.
        self._wait_for_quiet(files.values())
        before = {topic: rows.count() for topic, rows in files.items()}
        play()
        self._wait_for_quiet(files.values())
        passed = {topic: rows.count() - before[topic] for topic, rows in files.items()}
        self._ask_monitor(protocol.StopTap())
        return self._gather(found, discovered, passed)

    def _wait_for_discovery(self) -> tuple[protocol.GraphSnapshot, protocol.Discovered]:
        """The result of discovery when it no longer changes; at first it is incomplete."""
        deadline = time.monotonic() + _MAX_DISCOVERY_S
        found = self._ask(protocol.ListGraph(), protocol.GraphSnapshot)
        discovered = self._discover(found)
        while time.monotonic() < deadline:
            before = _endpoints(discovered)
            self._supervisor.pump(_DISCOVERY_INTERVAL_S)
            found = self._ask(protocol.ListGraph(), protocol.GraphSnapshot)
            discovered = self._discover(found)
            if _endpoints(discovered) == before and self._knows_all_endpoints(discovered):
                break
        return found, discovered

    def _knows_all_endpoints(self, discovered: protocol.Discovered) -> bool:
        for node, topic, _, does in self._known_endpoints:
            ends = discovered.writers if does == "publishes" else discovered.readers
            if topic not in _COMMON_TOPICS and node not in {
                each.node for each in ends.get(topic, ())
            }:
                return False
        return all(
            discovered.writers.get(each.name)
            for each in self._plan.topics
            if each.phase == self._phase and {"player", "loader"} & {*each.writers}
        )

    def _discover(self, found: protocol.GraphSnapshot) -> protocol.Discovered:
        planned = {each.name for each in self._plan.topics if each.phase == self._phase}
        names = tuple(sorted({*planned, *found.topics} - {*_COMMON_TOPICS}))
        return self._ask(protocol.Discover(topics=names), protocol.Discovered)

    def _gather(
        self,
        found: protocol.GraphSnapshot,
        discovered: protocol.Discovered,
        passed: dict[str, int] | None = None,
    ) -> GraphFacts:
        return gather_facts(
            self._plan,
            self._phase,
            {
                topic: (publishers, discovered.readers[topic])
                for topic, publishers in discovered.writers.items()
            },
            discovered.qos_mismatches,
            nodes=found.nodes,
            passed=passed,
            played=None if passed is None else TRACE_STEPS,
        )

    def _ask(self, command: object, kind: type[_Answer]) -> _Answer:
        return self._supervisor.request(self._observer, command, kind, _REPLY_TIMEOUT_S)

    def _ask_monitor(self, command: object) -> protocol.Matched:
        if self._monitor is None:
            raise ValueError("there is no monitor to trace with")
        return self._supervisor.request(self._monitor, command, protocol.Matched, _REPLY_TIMEOUT_S)

    def _wait_for_matches(self, topics: set[str]) -> None:
        deadline = time.monotonic() + _MAX_MATCH_WAIT_S
        while time.monotonic() < deadline:
            counts = self._ask_monitor(protocol.CountMatches()).counts
            if all(counts.get(topic, 0) for topic in topics):
                return
            self._supervisor.pump(_POLL_S)

    def _wait_for_quiet(self, files: Iterable[RowReader]) -> None:
        """Wait until no message has arrived for a while; bounded, as some topics never pause."""
        files = [*files]
        last: list[int] = []
        changed = began = time.monotonic()
        while (
            time.monotonic() - changed < _QUIET_PERIOD_S
            and time.monotonic() - began < _MAX_QUIET_WAIT_S
        ):
            counts = [each.count() for each in files]
            if counts != last:
                last, changed = counts, time.monotonic()
            self._supervisor.pump(_POLL_S)


def weakest_offer(publishers: Sequence[protocol.Endpoint]) -> QoS:
    """A QoS that is compatible with all publishers of a topic."""
    reliable = all(each.reliability == "reliable" for each in publishers)
    transient = all(each.durability == "transient_local" for each in publishers)
    return QoS(
        reliability="reliable" if reliable else "best_effort",
        durability="transient_local" if transient else "volatile",
        depth=_SUBSCRIPTION_DEPTH,
    )


def _endpoints(discovered: protocol.Discovered) -> list[tuple[str, str]]:
    """All endpoints, sorted."""
    both = (discovered.writers.items(), discovered.readers.items())
    return sorted((topic, repr(end)) for side in both for topic, ends in side for end in ends)


def find_faults(
    facts: GraphFacts, silent: Iterable[str], inputs: Iterable[str] = ()
) -> tuple[Fault, ...]:
    """The first fault on the path to each topic without messages, and those of some inputs.

    Each topic is reported once.
    """
    faults_of_silent = [first_fault(facts, each) for each in silent]
    found = [*(find_input_fault(facts, each) for each in inputs), *faults_of_silent]
    return tuple({each.topic: each for each in found if each is not None}.values())


@dataclass(frozen=True)
class FaultReport:
    """What is wrong with a graph, in words.

    Attributes:
        sentences: one for each fault.
        also: other differences of the nodes with faults; may be empty.
        path: a line for each topic on the way of the messages.
    """

    sentences: tuple[str, ...]
    also: str
    path: tuple[str, ...]

    def text(self, state: str, said: Collection[str] = ()) -> str:
        """The report as a text that begins with the state of the graph.

        Args:
            state: such as ``no messages on /out``.
            said: sentences that the reader knows.
        """
        left = "; ".join(each for each in self.sentences if each not in said) + self.also
        head = f"{state}: {left.removeprefix('; ')}" if left else state
        return "\n".join([head, *self.path])


def fault_report(
    facts: GraphFacts, silent: Iterable[str], faults: Iterable[Fault], also: str = ""
) -> FaultReport:
    """The sentences of the faults, then `also`, and below them the complete path."""
    path = dict.fromkeys(name for each in silent for name in full_path(facts, each))
    sentences = [each.sentence for each in faults]
    if not sentences:
        sentences = ["publishers and subscriptions are matched, and no fault was found"]
    return FaultReport(tuple(sentences), also, tuple(path_lines(facts, path)))
