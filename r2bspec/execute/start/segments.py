"""Playing one segment: offer a rate, let the graph drain, and extract the samples.

Player and monitors write rows for the whole run; a segment consists of those between two row
counts.

In a live run the graph has its own source, and nothing is played. A segment then consists of the
messages that arrived in a period of time. Their stamps are on the system clock, all other times on
CLOCK_MONOTONIC, so the offset of the two is stored with each segment.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.execute.errors import RunError
from r2bspec.execute.processes.supervisor import ManagedProcess
from r2bspec.execute.run_context import RunContext
from r2bspec.execute.start.segment_observation import (
    DRAIN_POLL_S,
    DrainTimer,
    SegmentObservation,
    last_answer_s,
    output_stopped,
    outstanding_answers,
)
from r2bspec.ipc import arrivals, protocol
from r2bspec.ipc.playback_file import PlaybackReader
from r2bspec.ipc.sample_files import ArrivalReader, RowReader, StallLogReader, read_clocks
from r2bspec.ipc.schedule import CyclicSchedule, Schedule, Turns
from r2bspec.judge.measure.matching import StepStamps
from r2bspec.judge.measure.run_samples import SegmentRows, segment_samples, work_of_steps
from r2bspec.judge.measure.samples import SegmentSamples
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.record.run_record import Segment, SegmentKind
from r2bspec.record.sample_arrays import (
    MONITOR_FIELDS,
    PLAYBACK_DTYPE,
    PLAYBACK_FIELDS,
    WORK_DTYPE,
    Rows,
)

if TYPE_CHECKING:
    from r2bspec.execute.anatomy import AnatomyObservation

PLAYBACK_ROWS = "playback"
"""The player's files (`r2bspec.ipc.playback_file`); those of the monitors end in ``.rows``."""

_CHECK_INTERVAL_S = 0.25
_JUDGED_KINDS: Final = frozenset({"iteration", "sustained", "confirmation", "turns", "work_turns"})
_OBSERVED_KINDS: Final = _JUDGED_KINDS | {"anatomy"}
"""Whose events are kept: nobody reads those of a warm-up or of a probe."""

_PLAYER_SLACK_S = 30.0

StopCondition = Callable[["SegmentObservation", float], bool]
"""Called four times a second with the samples so far and the seconds played; True stops."""


@dataclass(frozen=True)
class SegmentHeading:
    """The kind and the names of a segment, as in `Segment`.

    `title` is for the progress shown; `rerun_of` is the id of the segment in whose place it is
    played.
    """

    kind: SegmentKind
    id: str
    title: str
    index: int = 1
    rerun_of: str = ""


def titled(rate_hz: float, text: str) -> str:
    """Return the title of a segment; a rate of 0, which is that of the recording, is left out."""
    return f"{rate_hz:g} Hz, {text}" if rate_hz else text


class SegmentPlayer:
    """Plays segments with the player, the monitors and their sample files.

    Without a player it can only record (`LiveSegmentWatcher`).

    Attributes:
        segments: all that have been played.
        samples: of the segments that are judged, by id, without those of processes and the host.
        schedule: of the player; without steps if there is none.
        graph_pids: of the processes whose work is recorded.
        on_output_stopped: is called once for each monitor whose output stops, after the segment.
    """

    def __init__(
        self,
        plan: Plan,
        context: RunContext,
        player: ManagedProcess | None,
        rows_dir: Path,
        *,
        schedule: Schedule | None = None,
        latching: ManagedProcess | None = None,
        confirms: bool = False,
        start: int = 1,
        anatomy: AnatomyObservation | None = None,
    ) -> None:
        self._plan = plan
        self._anatomy = anatomy
        self._start = start
        self._latching = latching
        self.schedule = schedule or CyclicSchedule(steps=())
        self._step_stamps = StepStamps(self.schedule)
        self._confirms = confirms
        self._context = context
        self._supervisor = context.supervisor
        self._player = player
        monitors = plan.monitors
        self._playback: PlaybackReader | RowReader = (
            RowReader(rows_dir / protocol.CALLED_ROWS, PLAYBACK_FIELDS)
            if plan.called and not plan.inputs
            else PlaybackReader(rows_dir / PLAYBACK_ROWS, PLAYBACK_FIELDS)
        )
        self._stall_log = StallLogReader(rows_dir)
        self._monitors = {
            plan.name: ArrivalReader(rows_dir / f"{plan.name}.rows", MONITOR_FIELDS)
            for plan in monitors
        }
        # Rows written before this point were played before the graph was started.
        self._initial_count = self._playback.count()
        self._next_rows: dict[str, int] = {}
        self._stopped_outputs: set[str] = set()
        self._reported_outputs: set[str] = set()
        self.on_output_stopped: Callable[[Segment, MonitorPlan], None] = lambda _, __: None
        self.segments: list[Segment] = []
        self.samples: dict[str, SegmentSamples] = {}
        self._stamps: list[NDArray[np.int64]] = []
        # The process of each clock that the player reads, by its index in the record.
        self._clocks: tuple[int, ...] = ()
        self.graph_pids: tuple[int, ...] = ()
        # Monitors whose messages have answered no step of the last segment.
        self._unasked: set[str] = set()

    def play(
        self,
        heading: SegmentHeading,
        rate_hz: float,
        steps: int,
        stop_condition: StopCondition | None = None,
        turns: Turns | None = None,
    ) -> SegmentObservation:
        """Play a segment and record it; as incomplete if it ends with an exception.

        In a confirmation run, all measured segments have the kind `confirmation`.

        Returns:
            The samples, after the graph has drained.

        Raises:
            RunError: the player does not respond, or a process exited or failed.
        """
        heading = self._confirming(heading)
        self._context.progress.segment(heading.title, steps)
        first = self._first_rows()
        complete = False
        try:
            play = self._play_command(heading.id, rate_hz, steps, turns)
            self._play(play, first, stop_condition)
            self._drain(heading.kind, rate_hz, first)
            complete = True
        finally:
            observation = self._observe(first)
            if observation.playback.size:
                began_ns = int(observation.playback["due_ns"][0])
                self._store(
                    heading,
                    observation,
                    first,
                    rate_hz=rate_hz,
                    steps=steps,
                    began_ns=began_ns,
                    ended_ns=began_ns + self.schedule.span_ns(rate_hz, observation.playback.size),
                    complete=complete,
                    played_before=observation.played_before,
                    monitor_held_ns=self._stall_log.between(began_ns, time.monotonic_ns()),
                    core=turns.core if turns is not None else None,
                    arrivals=self._plan.arrivals.kind if self._plan.arrivals else msgspec.UNSET,
                )
        self._detect_stopped_outputs(heading.kind, observation)
        return observation

    def watch_work(self, processes: Mapping[int, Sequence[int]]) -> None:
        """Record the processor time that these processes use for each step from now on.

        Args:
            processes: the pids of each process and its descendants, by its index in the record.

        Raises:
            RunError: the player does not respond.
        """
        if not isinstance(self._playback, PlaybackReader) or self._player is None:
            return
        pids = [(index, pid) for index, family in processes.items() for pid in family]
        self.graph_pids = tuple(pid for _, pid in pids)
        command = protocol.WatchClocks(pids=self.graph_pids)
        reply = self._supervisor.request(self._player, command, protocol.Watched)
        self._clocks = tuple(index for index, _ in pids[: reply.clocks])

    def _work(self) -> Rows:
        """Return the processor time of the steps of the last playback, of type `WORK_DTYPE`."""
        if not self._clocks or not isinstance(self._playback, PlaybackReader):
            return np.empty(0, WORK_DTYPE)
        clocks_ns = self._playback.last_clocks()
        known = (clocks_ns[1:] >= 0) & (clocks_ns[:-1] >= 0)
        used_ns = np.where(known, np.diff(clocks_ns, axis=0), 0)
        blocks = []
        for process in dict.fromkeys(self._clocks):
            columns = np.array(self._clocks) == process
            steps = np.flatnonzero(known[:, columns].all(axis=1))
            block = np.empty(steps.size, WORK_DTYPE)
            block["step"], block["process"] = steps, process
            block["work_ns"] = used_ns[np.ix_(steps, columns)].sum(axis=1)
            blocks.append(block)
        return np.concatenate(blocks)

    def play_unrecorded(self, rate_hz: float, steps: int) -> None:
        """Play steps that belong to no segment; `discard_new_rows` discards their output.

        Raises:
            RunError: the player does not respond, or a process exited or failed.
        """
        if self._player is None:
            raise RunError("this run has no player")
        self._await_latched()
        timeout_s = self.schedule.span_ns(rate_hz, steps) / 1e9 * 1.5 + _PLAYER_SLACK_S
        command = protocol.Play(rate_hz=rate_hz, steps=steps)
        self._supervisor.request(self._player, command, protocol.Played, timeout_s)

    def play_unrecorded_for(self, title: str, rate_hz: float, duration_ns: int) -> None:
        """Play messages that belong to no segment for a time; see `play_unrecorded`."""
        steps = max(1, self.schedule.steps_within(rate_hz, duration_ns))
        self._context.progress.segment(title, steps)
        self.play_unrecorded(rate_hz, steps)

    def discard_new_rows(self) -> dict[str, int]:
        """Discard the messages that have arrived since the last segment.

        Returns:
            For each monitor, how many of them are late: outputs of steps of earlier segments.
        """
        earlier = self._earlier_stamps()
        late = {}
        for name, rows in self._monitors.items():
            stamps = np.unique(rows.read(self._next_rows.get(name, 0))["stamp_ns"])
            late[name] = int(np.count_nonzero(np.isin(stamps, earlier)))
        self._next_rows = self._counts()
        return late

    def _detect_stopped_outputs(self, kind: SegmentKind, observation: SegmentObservation) -> None:
        """Report outputs that have stopped, each once; those that go on are waited for again."""
        if kind == "warm_up" or not (observation.playback.size or self._player is None):
            return
        for plan in self._plan.monitors:
            if not plan.counts_answers or self._player is None:
                # Nothing that is played says how many messages to expect.
                is_there = bool(observation.monitors[plan.name].size)
                has_stopped = not is_there
            else:
                matched = observation.matched(plan.name)
                is_there = bool(matched.matching.answered.any())
                has_stopped = output_stopped(matched.steps, matched.rows, matched.matching)
            if plan.name in self._stopped_outputs:
                if is_there:
                    self._stopped_outputs.remove(plan.name)
            elif has_stopped:
                self._stopped_outputs.add(plan.name)
                if plan.name not in self._reported_outputs:
                    self._reported_outputs.add(plan.name)
                    self.on_output_stopped(self.segments[-1], plan)

    def play_for(
        self, heading: SegmentHeading, rate_hz: float, duration_ns: int, min_steps: int = 2
    ) -> SegmentObservation:
        """Play a segment of this duration, with at least `min_steps` steps; see `play`."""
        steps = max(min_steps, self.schedule.steps_within(rate_hz, duration_ns))
        return self.play(heading, rate_hz, steps)

    def segment_id_for(self, name: str) -> str:
        """Return the id of a segment with a name, unique over the starts of a run."""
        return f"confirm-{name}" if self._confirms else name

    def _confirming(self, heading: SegmentHeading) -> SegmentHeading:
        measured = self._confirms and heading.kind != "warm_up"
        kind = "confirmation" if measured else heading.kind
        return replace(heading, kind=kind, id=self.segment_id_for(heading.id))

    def received(self) -> dict[str, int]:
        """Return the number of messages that each monitor has received since its start."""
        return {name: rows.count() for name, rows in self._monitors.items()}

    def _counts(self) -> dict[str, int]:
        return self.received() | {"": self._playback.count()}

    def _first_rows(self) -> dict[str, int]:
        """Return the first row of each file that belongs to no segment yet.

        Messages that arrived after the end of the last segment belong to the next one.
        """
        return {name: self._next_rows.get(name, 0) for name in self._monitors} | {
            "": self._playback.count()
        }

    def _observe(self, first: dict[str, int]) -> SegmentObservation:
        # Monitors first: a step in the rows of a monitor must be in those of the player.
        received = {name: rows.read(first[name]) for name, rows in self._monitors.items()}
        before = first[""] - self._initial_count
        played = self._playback.read(first[""])
        monitors = {
            name: self._step_stamps.replace(rows, played, first[""])
            for name, rows in received.items()
        }
        return SegmentObservation(self._plan, played, monitors, before)

    def _play_command(
        self, name: str, rate_hz: float, steps: int, turns: Turns | None
    ) -> protocol.Play:
        """Return the command for a segment, with the due times that are not those of the rate."""
        begin_ns, delays_ns = (turns.begin_ns, turns.delays_ns) if turns else (0, ())
        if self._plan.arrivals:
            delays_ns = arrivals.delays_ns(self._plan.arrivals, rate_hz, steps, name)
        return protocol.Play(rate_hz=rate_hz, steps=steps, begin_ns=begin_ns, delays_ns=delays_ns)

    def _play(
        self, play: protocol.Play, first: dict[str, int], stop_condition: StopCondition | None
    ) -> None:
        rate_hz, steps = play.rate_hz, play.steps
        if self._player is None:
            raise RunError("this run has no player")
        self._await_latched()
        begin = time.monotonic()
        deadline = begin + self.schedule.span_ns(rate_hz, steps) / 1e9 * 1.5 + _PLAYER_SLACK_S
        next_check = begin + _CHECK_INTERVAL_S
        stopping = False
        self._player.send(play)
        # While the player waits for the first due time, so that earlier use is not counted.
        self._context.resources.sample_at(time.monotonic_ns())
        while True:
            self._supervisor.pump()
            while self._player.inbox:
                message = self._player.inbox.popleft()
                if isinstance(message, protocol.Played):
                    self._sample_at_end(first, message.steps, rate_hz)
                    return
            now = time.monotonic()
            if now > deadline:
                raise RunError(
                    f"the player did not finish {steps} steps "
                    f"{f'at {rate_hz:g} Hz' if rate_hz else 'of the recording'} in time",
                    hint="The machine may be overloaded, or a publish call blocks.",
                    code="R2B645",
                )
            if now >= next_check:
                next_check = now + _CHECK_INTERVAL_S
                self._report_progress(first)
                if (
                    stop_condition
                    and not stopping
                    and stop_condition(self._observe(first), now - begin)
                ):
                    self._player.send(protocol.Stop())
                    stopping = True

    def _await_latched(self) -> None:
        """Wait until the nodes have what is latched, which they need for what is played."""
        if self._latching is not None:
            self._supervisor.request(self._latching, protocol.AwaitLatched(), protocol.Matched)

    def _report_progress(self, first: dict[str, int]) -> None:
        counts = self._counts()
        received = (counts[name] - first[name] for name in self._monitors)
        self._context.progress.playing(counts[""] - first[""], min(received, default=0))

    def _sample_at_end(self, first: dict[str, int], steps: int, rate_hz: float) -> None:
        """Schedule a resource sample at the end of the last period; the player ends before it."""
        begun = self._playback.read(first[""], first[""] + 1)
        if begun.size:
            span_ns = self.schedule.span_ns(rate_hz, steps)
            self._context.resources.sample_at(int(begun["due_ns"][0]) + span_ns)

    def _drain(self, kind: SegmentKind, rate_hz: float, first: dict[str, int]) -> None:
        """Wait for answers; what is missing when this returns counts as lost."""
        if any(monitor.own_pace for monitor in self._plan.monitors):
            self._await_end(rate_hz, first)
        self._await_answers(kind, first)

    def _await_end(self, rate_hz: float, first: dict[str, int]) -> None:
        """Wait until the period of the last step is over: of some outputs, all until then count."""
        played = self._playback.read(first[""])
        if played.size:
            span_ns = self.schedule.span_ns(rate_hz, played.size)
            left_ns = int(played["due_ns"][0]) + span_ns - time.monotonic_ns()
            self._supervisor.pump_for(max(0.0, left_ns / 1e9) + DRAIN_POLL_S)

    def _await_answers(self, kind: SegmentKind, first: dict[str, int]) -> None:
        timer = DrainTimer(self._plan.drain_timeout.seconds, time.monotonic())
        last_counts: dict[str, int] = {}
        while not timer.is_over(now_s := time.monotonic()):
            counts = self._counts()
            if counts != last_counts:
                if last_counts:
                    timer.arrived(now_s)
                last_counts = counts
                if self._enough(first, counts) and not self._look(timer, now_s, first):
                    return
            if timer.wants_a_look(now_s):
                self._look(timer, now_s, first)
                # While the graph starts, playing on tells more than waiting.
                if kind == "warm_up" and not all(self.received().values()):
                    return
            self._supervisor.pump(DRAIN_POLL_S)

    def _enough(self, first: dict[str, int], counts: dict[str, int]) -> bool:
        """Return whether the number of messages suffices; a cheap check before `_outstanding`."""
        if not isinstance(self.schedule, CyclicSchedule):
            # Of a timeline, not every step counts for every monitor.
            return True
        played = counts[""] - first[""]
        return all(
            (counts[monitor.name] - first[monitor.name] + 1) * monitor.ratio_inputs > played
            for monitor in self._plan.monitors
        )

    def _look(self, timer: DrainTimer, now_s: float, first: dict[str, int]) -> bool:
        """Return whether answers are still missing.

        An output that has stopped is not waited for again, nor one that comes unasked.
        """
        matched = self._observe(first).all_matched()
        waited = [
            each
            for name, each in matched.items()
            if name not in self._stopped_outputs
            and (name not in self._unasked or each.matching.answered.any())
        ]
        outstanding = outstanding_answers(waited)
        timer.looked(now_s, outstanding, last_answer_s(waited))
        return outstanding != "nothing"

    def _store(
        self,
        heading: SegmentHeading,
        observation: SegmentObservation,
        first: dict[str, int],
        **fields: Any,
    ) -> None:
        """Write a segment and its rows, and keep its samples in memory if they are judged."""
        segment = Segment(
            id=heading.id,
            kind=heading.kind,
            index=heading.index,
            rerun_of=heading.rerun_of,
            start=self._start,
            **fields,
        )
        folder = self._context.folder
        self._step_stamps.remember(observation.playback, first[""])
        folder.write_rows("playback", observation.playback, segment.id)
        work = np.empty(0, WORK_DTYPE)
        if segment.kind in _JUDGED_KINDS:
            work = self._work()
            folder.write_rows("work", work, segment.id)
        for name, rows in observation.monitors.items():
            folder.write_rows("monitor", rows, segment.id, name)
            self._next_rows[name] = first[name] + rows.size
        observed = None
        if self._anatomy is not None and segment.kind in _OBSERVED_KINDS:
            observed = self._anatomy.store(segment, time.monotonic_ns(), folder)
        if segment.complete and segment.kind in _JUDGED_KINDS:
            earlier = self._earlier_stamps()
            rows_of = SegmentRows(
                observation.playback,
                observation.monitors,
                lambda found: np.isin(found, earlier),
                observed,
                work_of_steps(
                    work,
                    [process.name for process in self._supervisor.records()],
                    int(observation.playback.size),
                ),
            )
            matched = None if segment.live else observation.all_matched()
            self.samples[segment.id] = segment_samples(self._plan, segment, rows_of, matched)
        if not segment.live:
            self._unasked = {
                name
                for name, each in observation.all_matched().items()
                if each.rows.size and not each.matching.answered.any()
            }
        self._stamps.append(observation.playback["stamp_ns"].copy())
        self.segments.append(segment)
        self._context.on_segment()

    def _earlier_stamps(self) -> NDArray[np.int64]:
        return np.concatenate(self._stamps) if self._stamps else np.empty(0, np.int64)


_POLL_S = 0.25
_MAX_CLOCK_DRIFT_NS = 1_000_000
"""A larger change of the offset within a segment means that the system clock was set."""


class LiveSegmentWatcher(SegmentPlayer):
    """Records segments in which the graph's own source publishes."""

    def play_for(
        self, heading: SegmentHeading, rate_hz: float, duration_ns: int, min_steps: int = 2
    ) -> SegmentObservation:
        """Record a segment of this duration; rate and minimum number of steps have no effect.

        Raises:
            RunError: a process exited or failed.
        """
        del rate_hz, min_steps
        heading = self._confirming(heading)
        self._context.progress.segment(heading.title, 0)
        first = self._first_rows()
        _, offset_ns = read_clocks()
        began_ns = time.monotonic_ns()
        complete = False
        try:
            self._context.resources.sample_at(began_ns)
            while (left_ns := began_ns + duration_ns - time.monotonic_ns()) > 0:
                self._supervisor.pump(min(_POLL_S, left_ns / 1e9))
                self._report_progress(first)
            self._context.resources.sample_at(began_ns + duration_ns)
            complete = True
        finally:
            ended_ns = began_ns + duration_ns if complete else time.monotonic_ns()
            changed_ns = read_clocks()[1] - offset_ns
            observation = self._observe_between(first, began_ns, ended_ns)
            self._store(
                heading,
                observation,
                first,
                rate_hz=0.0,
                steps=0,
                began_ns=began_ns,
                ended_ns=ended_ns,
                complete=complete,
                live=True,
                clock_offset_ns=offset_ns if abs(changed_ns) <= _MAX_CLOCK_DRIFT_NS else None,
            )
        self._detect_stopped_outputs(heading.kind, observation)
        return observation

    def play_unrecorded(self, rate_hz: float, steps: int) -> None:
        """Let the source publish for the time that these steps would take."""
        self._supervisor.pump_for(steps / rate_hz)

    def play_unrecorded_for(self, title: str, rate_hz: float, duration_ns: int) -> None:
        """Let the source publish for a time; the rate has no effect."""
        del rate_hz
        self._context.progress.segment(title, 0)
        self._supervisor.pump_for(duration_ns / 1e9)

    def _observe_between(
        self, first: dict[str, int], began_ns: int, ended_ns: int
    ) -> SegmentObservation:
        """Return the messages received between two times."""
        monitors = {}
        for name, rows in self._observe(first).monitors.items():
            received = rows["received_ns"]
            monitors[name] = rows[(received >= began_ns) & (received < ended_ns)]
        return SegmentObservation(self._plan, np.empty(0, PLAYBACK_DTYPE), monitors)
