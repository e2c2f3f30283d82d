"""Looking at the real graph: who is there, and, while some steps are played, what passes where."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from r2bspec.execute.diagnosis.find_break import (
    Fault,
    find_input_fault,
    first_fault,
    full_path,
    path_lines,
)
from r2bspec.execute.diagnosis.graph_facts import GraphFacts, gather_facts
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.sample_files import RowReader
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.record.run_record import MONITOR_FIELDS

TRACE_RATE_HZ = 10.0
TRACE_STEPS = 10
"""Enough to tell a node that answers now and then from one that never does."""

_REPLY_TIMEOUT_S = 10.0
_MAX_MATCH_WAIT_S = 3.0
_QUIET_PERIOD_S = 0.5
_MAX_QUIET_WAIT_S = 5.0
_MAX_DISCOVERY_S = 10.0
"""Discovery takes a fraction of a second, and much longer on a machine that is busy."""

_POLL_S = 0.02
_DISCOVERY_INTERVAL_S = 0.3
_Answer = TypeVar("_Answer")
_COMMON_TOPICS = ("/rosout", "/parameter_events")


class GraphObserver:
    """Looks through a monitor's eyes.

    Args:
        supervisor: all processes.
        monitor: a process that plays the monitor; to see who is there, a loader is enough.
        plan: what should be there.
        phase: ``preprocess`` or ``measure``.
        known: endpoints that are there for certain, as `protocol.Ready` tells them: until they are
            seen, discovery has not settled.
    """

    def __init__(
        self,
        supervisor: ProcessSupervisor,
        monitor: ManagedProcess,
        plan: Plan,
        phase: str,
        known: Iterable[tuple[str, str, str, str]] = (),
    ) -> None:
        self._known_endpoints = [*known]
        self._supervisor = supervisor
        self._monitor = monitor
        self._plan = plan
        self._phase = phase

    def observe(self) -> GraphFacts:
        """Who is there, on every topic; nothing is played."""
        return self._gather(*self._wait_for_discovery())

    def trace(self, rows_dir: Path, play: Callable[[], None]) -> GraphFacts:
        """Who is there, and what passes on every topic while `play` plays `TRACE_STEPS` steps.

        Args:
            rows_dir: the folder where the monitor's process writes its rows.
            play: plays, and returns when that is done.
        """
        found, seen = self._wait_for_discovery()
        # Runs may be looked at more than once, and a file of rows is never opened again.
        now = time.monotonic_ns()
        watches = tuple(
            MonitorPlan(
                name=f".look-{now}-{number}",
                topic=topic,
                type=writers[0].type,
                match="order",
                qos=None,
            )
            for number, (topic, writers) in enumerate(seen.writers.items())
            if writers
        )
        self._ask(protocol.Watch(monitors=watches), protocol.Matched)
        self._wait_for_matches({each.topic for each in watches})
        files = {
            each.topic: RowReader(rows_dir / f"{each.name}.rows", MONITOR_FIELDS)
            for each in watches
            if (rows_dir / f"{each.name}.rows").exists()
        }
        # What a writer keeps for late joiners comes now, and is not what will be played.
        self._wait_for_quiet(files.values())
        before = {topic: rows.count() for topic, rows in files.items()}
        play()
        self._wait_for_quiet(files.values())
        passed = {topic: rows.count() - before[topic] for topic, rows in files.items()}
        self._ask(protocol.Unwatch(), protocol.Matched)
        return self._gather(found, seen, passed)

    def _wait_for_discovery(self) -> tuple[protocol.Surveyed, protocol.Discovered]:
        """What discovery shows when it has settled: eyes that were just opened see little."""
        deadline = time.monotonic() + _MAX_DISCOVERY_S
        found = self._ask(protocol.Survey(), protocol.Surveyed)
        seen = self._discover(found)
        while time.monotonic() < deadline:
            before = _endpoints(seen)
            self._supervisor.pump(_DISCOVERY_INTERVAL_S)
            found = self._ask(protocol.Survey(), protocol.Surveyed)
            seen = self._discover(found)
            if _endpoints(seen) == before and self._known_endpoints_discovered(seen):
                break
        return found, seen

    def _known_endpoints_discovered(self, seen: protocol.Discovered) -> bool:
        for node, topic, _, does in self._known_endpoints:
            ends = seen.writers if does == "publishes" else seen.readers
            if topic not in _COMMON_TOPICS and node not in {
                each.node for each in ends.get(topic, ())
            }:
                return False
        return all(
            seen.writers.get(each.name)
            for each in self._plan.topics
            if each.phase == self._phase and {"player", "loader"} & {*each.writers}
        )

    def _discover(self, found: protocol.Surveyed) -> protocol.Discovered:
        planned = {each.name for each in self._plan.topics if each.phase == self._phase}
        names = tuple(sorted({*planned, *found.topics} - {*_COMMON_TOPICS}))
        return self._ask(protocol.Discover(topics=names), protocol.Discovered)

    def _gather(
        self,
        found: protocol.Surveyed,
        seen: protocol.Discovered,
        passed: dict[str, int] | None = None,
    ) -> GraphFacts:
        return gather_facts(
            self._plan,
            self._phase,
            {topic: (writers, seen.readers[topic]) for topic, writers in seen.writers.items()},
            seen.qos_mismatches,
            nodes=found.nodes,
            passed=passed,
            played=None if passed is None else TRACE_STEPS,
        )

    def _ask(self, command: object, kind: type[_Answer]) -> _Answer:
        return self._supervisor.request(self._monitor, command, kind, _REPLY_TIMEOUT_S)

    def _wait_for_matches(self, topics: set[str]) -> None:
        deadline = time.monotonic() + _MAX_MATCH_WAIT_S
        while time.monotonic() < deadline:
            counts = self._ask(protocol.CountMatches(), protocol.Matched).counts
            if all(counts.get(topic, 0) for topic in topics):
                return
            self._supervisor.pump(_POLL_S)

    def _wait_for_quiet(self, files: Iterable[RowReader]) -> None:
        """Until nothing has come for a while, but not for ever: some topics never rest."""
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


def _endpoints(seen: protocol.Discovered) -> list[tuple[str, str]]:
    """All that is there, in an order of its own."""
    both = (seen.writers.items(), seen.readers.items())
    return sorted((topic, repr(end)) for side in both for topic, ends in side for end in ends)


def find_faults(
    facts: GraphFacts, silent: Iterable[str], inputs: Iterable[str] = ()
) -> tuple[Fault, ...]:
    """The first break on the way to each silent topic, and to the readers of some inputs.

    Each is named once; those that come first on their way come first.
    """
    faults_of_silent = [first_fault(facts, each) for each in silent]
    found = [*(find_input_fault(facts, each) for each in inputs), *faults_of_silent]
    return tuple({each.topic: each for each in found if each is not None}.values())


def fault_report(
    facts: GraphFacts, silent: Iterable[str], faults: Iterable[Fault], also: str = ""
) -> str:
    """The faults, a sentence each, what is `also` to be said, and below it the whole way."""
    path = dict.fromkeys(name for each in silent for name in full_path(facts, each))
    said = [each.sentence for each in faults]
    if not said:
        said = ["writers and readers have found each other, and nothing is seen to be wrong"]
    return "\n".join(["; ".join(said) + also, *path_lines(facts, path)])
