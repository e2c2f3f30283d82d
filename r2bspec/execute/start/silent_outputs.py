"""Why an output has no messages: the path to it is traced, and the first fault on it named.

In the warm-up this ends the run, as soon as it is useless to wait longer. In a measurement the run
continues, and the record says which output has stopped, and why. If the played messages do not even
arrive at the subscription that traces them, it was not the graph that stopped: the run ends, and is
invalid.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.execute.diagnose.facts import TRACE_RATE_HZ, TRACE_STEPS, GraphFacts
from r2bspec.execute.diagnose.first_fault import (
    NEVER_MATCHED,
    NO_OUTPUT,
    find_faults,
    full_path,
    path_lines,
)
from r2bspec.execute.errors import DeadInputError, NoOutputError
from r2bspec.execute.processes.supervisor import ManagedProcess
from r2bspec.plan.plan import MonitorPlan
from r2bspec.record.run_record import OutputGapRecord, Segment

if TYPE_CHECKING:
    from r2bspec.execute.diagnose.diagnosis import PhaseGraph
    from r2bspec.execute.start.segments import SegmentPlayer


@dataclass
class SilentOutputs:
    """Traces the paths of one start.

    Attributes:
        graph: whose outputs they are.
        rows_dir: receives the rows of the player and the monitors.
        monitor: receives what is traced.
        records: outputs that have stopped.
    """

    graph: PhaseGraph
    rows_dir: Path
    monitor: ManagedProcess
    segment_player: SegmentPlayer
    records: list[OutputGapRecord] = field(default_factory=list)
    _late: dict[str, int] = field(default_factory=dict)

    def explain_start(self, silent: Collection[str], *, final: bool) -> None:
        """Determine why monitors have received nothing since the start, and report it.

        Before the end of the start, a node without output may still load a model. Only endpoints
        that never match are certain.

        Args:
            silent: the monitors, by name.
            final: whether the start is no longer waited for.

        Raises:
            GraphDifferencesError: the graph differs from the plan: there never is an output.
            NoOutputError: there is another reason, and `final`.
        """
        graph, plan = self.graph, self.graph.plan
        unanswered = [name for name in plan.called if name in silent]
        if unanswered:
            said = f"no answer that counts for {', '.join(unanswered)}"
            if not final:
                self.graph.note(f"{said} so far")
                return
            target = plan.called[unanswered[0]].target
            callers = (process.name for process in plan.processes if process.role == "caller")
            log = f"{next(callers, 'player')}.log"
            hint = f"{target} was called, and no call was answered with success; see {log}."
            raise NoOutputError(said, hint=hint)
        topics = [monitor.topic for monitor in plan.monitors if monitor.name in silent]
        facts = self._trace()
        faults = find_faults(facts, topics)
        lacking = {fault.name for fault in faults}
        certain = any(fault.code in NEVER_MATCHED for fault in faults)
        if not final and not certain:
            found = (*graph.lifecycle.waiting(topics), *faults)
            sentences = "; ".join(each.message for each in found) or "no fault was found yet"
            self.graph.note(f"no messages on {', '.join(topics)} so far: {sentences}")
            return
        graph.add_unmatched_remappings(facts, lacking)
        hint = "All nodes run, but the source, or a node after it, publishes nothing."
        if plan.inputs:
            hint = "The inputs were played, but the graph published nothing on these topics."
        raise graph.error(
            facts,
            faults,
            topics,
            f"no messages on {', '.join(topics)}",
            hint,
            otherwise=NoOutputError,
        )

    def explain_stop(self, segment: Segment, plan: MonitorPlan) -> None:
        """Determine, once, why an output has stopped in a segment, and record it.

        Raises:
            DeadInputError: what is played arrives nowhere any more.
        """
        if plan.name in self.graph.plan.called:
            reason = "it has stopped answering"
            self.graph.note(f"{plan.topic}: {reason}")
            self.records.append(
                OutputGapRecord(segment=segment.id, topic=plan.topic, reason=reason, late=0, way=())
            )
            return
        self.graph.note(f"no more messages on {plan.topic}: tracing the path")
        facts = self._trace()
        faults = find_faults(facts, [plan.topic])
        reason = "; ".join(fault.message for fault in faults)
        if not reason:
            passed = facts.topics[plan.topic].passed
            reason = f"{passed} messages on {plan.topic} for {TRACE_STEPS} steps played afterwards"
        late = self._late.get(plan.name, 0)
        if late:
            reason = (
                f"{late:,} of the missing outputs came while the path was traced: they are late, "
                "not lost, and 'benchmark.drain_timeout' is too short for them"
            )
        self.graph.note(reason)
        way = path_lines(facts, full_path(facts, plan.topic))
        self.records.append(
            OutputGapRecord(
                segment=segment.id,
                topic=plan.topic,
                reason=reason,
                late=late,
                way=tuple(line.strip() for line in way),
            )
        )
        begins_at_input = any(
            fault.code == NO_OUTPUT and fault.name in facts.inputs for fault in faults
        )
        # In a few steps of a recording not every input need have a message.
        arrived = any(facts.topics[topic].passed for topic in facts.inputs)
        if begins_at_input and not arrived and not late:
            raise DeadInputError(
                f"from {segment.id} on, no played message arrived, not even at r2bspec's own "
                f"subscription ({reason}): the graph was not tested",
                hint="The middleware has failed. Look for a full /dev/shm and other causes with "
                "'r2bspec doctor', or try another middleware, and run again.",
            )

    def _trace(self) -> GraphFacts:
        """Play some steps and count the messages on each topic."""

        def play() -> None:
            if self.graph.plan.inputs:
                self.segment_player.play_unrecorded(TRACE_RATE_HZ, TRACE_STEPS)
            else:
                # The graph has its own source, which publishes during this time.
                self.graph.supervisor.pump_for(TRACE_STEPS / TRACE_RATE_HZ)

        facts = self.graph.observer.trace(self.monitor, self.rows_dir, play)
        self._late = self.segment_player.discard_new_rows()
        return facts
