"""The starts of a run, one after the other, each a session in fresh processes.

Player and monitor are started afresh, too, and not the graph alone: where they lie in memory, when
they discover the nodes, and on which cores their threads run is decided at their start, and is part
of every latency. If they remained, what they got would be common to all starts. Starts would then
differ by less than two runs do, and a verdict would be more certain than it may be.

What does not depend on the processes is made once, before the first start: the bag is read, the
preprocessors run, buffers and schedule are built, and the harness overhead is measured (once more
before a confirmation run, which is compared with it). What is left is made short: in a later start,
all processes import ROS at the same time.

Nothing of the next start is prepared while iterations play. A process that imports ROS takes a core
for half a second, and discovery by new participants wakes every process of the graph; both would
be in the measured latencies. Ending the old processes takes 30 to 60 ms, and is finished before the
new ones are started, so that these meet none of the old ones in their domain.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.errors import GraphMismatchError, InterruptedRunError, RunError
from r2bspec.execute.measurement.segments import SegmentPlayer
from r2bspec.execute.run_context import RunContext
from r2bspec.execute.session import Session
from r2bspec.plan.plan import Plan
from r2bspec.record.run_record import StartRecord


@dataclass
class StartSequence:
    """The starts of a run and of its confirmation; at most one of them runs at a time.

    Attributes:
        make_launcher: a new launcher, once the buffers are complete.
        sessions: one for each start so far, the running one last.
        records: of the starts whose graph was warmed up.
        foreign: publishers that are no process's of the run, in words.
    """

    plan: Plan
    context: RunContext
    make_launcher: Callable[[], Launcher]
    sessions: list[Session] = field(default_factory=list)
    records: list[StartRecord] = field(default_factory=list)
    foreign: tuple[str, ...] = ()

    def begin(self, *, confirms: bool = False) -> SegmentPlayer:
        """End the start that runs, if there is one, and start all processes afresh.

        Args:
            confirms: whether it is part of the confirmation run.

        Raises:
            RunError: a process of the old start has exited, or the new one fails.
        """
        began_ns = time.monotonic_ns()
        before = self.sessions[-1] if self.sessions else None
        self._end_running()
        session = self._new_session(
            self.plan,
            confirms=confirms,
            is_later=before is not None and before.confirms == confirms,
        )
        segment_player = session.bring_up()
        ready_ns = time.monotonic_ns()
        interference = self.context.host.between(began_ns, ready_ns)
        self.records.append(
            StartRecord(
                number=session.start,
                began_ns=began_ns,
                ready_ns=ready_ns,
                overhead_ns=session.overhead_ns,
                confirms=confirms,
                disturbed=interference.reasons,
                taken=interference.taken,
            )
        )
        return segment_player

    def begin_uncounted(self, plan: Plan) -> SegmentPlayer:
        """End the start that runs, and start the processes of a changed plan; it has no record.

        Raises:
            RunError: a process of the old start has exited, or the new one fails.
        """
        self._end_running()
        return self._new_session(plan, confirms=False, is_later=True).bring_up()

    def _end_running(self) -> None:
        if self.sessions:
            # Detect a process that exited after the last message, which also fails the run.
            self.context.supervisor.pump(0.0)
            self.find_foreign_publishers()
            self.sessions[-1].look_at_loaded_files()
            self.context.supervisor.end(list(self.context.supervisor))

    def _new_session(self, plan: Plan, *, confirms: bool, is_later: bool) -> Session:
        session = Session(
            plan,
            self.context,
            self.make_launcher(),
            start=len(self.sessions) + 1,
            confirms=confirms,
            schedule=self.sessions[-1].schedule if self.sessions else None,
            is_later=is_later,
        )
        self.sessions.append(session)
        return session

    def find_foreign_publishers(self) -> bool:
        """Ask who has published on what is played and watched; whether others have, ever."""
        before = self.foreign
        publishers = self.sessions[-1].foreign_publishers() if self.sessions else ()
        self.foreign = tuple(dict.fromkeys((*before, *publishers)))
        for publisher in self.foreign[len(before) :]:
            self.context.note(f"a program that is not of this run has published on {publisher}")
        return bool(self.foreign)

    def name_start(self, error: RunError) -> None:
        """Say in an error in which start it occurred, unless it is the first one."""
        if len(self.sessions) < 2 or isinstance(error, InterruptedRunError):
            return
        confirms = ", which confirms a failure" if self.sessions[-1].confirms else ""
        which = f" (in start {len(self.sessions)}{confirms})"
        error.args = (f"{error}{which}", *error.args[1:])
        if isinstance(error, GraphMismatchError):
            error.details = f"{error.details}{which}".strip()
