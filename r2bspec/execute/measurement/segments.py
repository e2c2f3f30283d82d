"""Playing one segment: offer a rate, let the graph drain, and cut the samples out.

Player and monitors write rows for the whole run; a segment is the stretch between two row counts.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.execute.diagnosis.stopped_outputs import output_stopped
from r2bspec.execute.errors import RunError
from r2bspec.execute.host.resource_sampler import ResourceSampler
from r2bspec.execute.measurement.progress_view import ProgressView
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.execute.progress import Progress
from r2bspec.ipc import protocol
from r2bspec.ipc.sample_files import RowReader
from r2bspec.ipc.schedule import CyclicSchedule, Schedule
from r2bspec.ipc.stall_log import StallLogReader
from r2bspec.measure.matched_monitor import MatchedMonitor, match_monitor
from r2bspec.measure.matching import NO_MATCH
from r2bspec.measure.run_samples import NO_STAMPS, SegmentRows, segment_samples
from r2bspec.measure.samples import SegmentSamples, monitor_samples, playback_samples
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.plan.taps import tap_monitors
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import MONITOR_FIELDS, PLAYBACK_FIELDS, Segment, SegmentKind
from r2bspec.record.sample_arrays import Rows

PLAYBACK_ROWS = "playback"
"""The player's sample file; those of the monitors end in ``.rows``."""

_CHECK_INTERVAL_S = 0.25
_JUDGED_KINDS: Final = frozenset({"iteration", "sustained", "confirmation"})
_DRAIN_POLL_S = 0.01
_MIN_QUIET_S = 0.3
_QUIET_FACTOR = 5
"""A gap is waited for so many times the longest pause between two arrivals."""
_MAX_DRAIN_S = 60.0
"""For a graph that never stops sending."""
_PLAYER_SLACK_S = 30.0

Outstanding = Literal["nothing", "gaps", "tail"]
"""The answers that are missing: none; some, but not the last; the last one, and perhaps more."""

StopCondition = Callable[["SegmentObservation", float], bool]
"""Called every quarter second with what is there so far and the seconds played; True stops."""


class SegmentObservation:
    """The samples of one segment, all there is at the moment they were read."""

    def __init__(
        self, plan: Plan, playback: Rows, monitors: dict[str, Rows], played_before: int = 0
    ) -> None:
        self.playback = playback
        self.monitors = monitors
        self.played_before = played_before
        self.now_ns = time.monotonic_ns()
        self._plan = plan
        self._matched: dict[str, MatchedMonitor] = {}

    def matched(self, name: str) -> MatchedMonitor:
        """The steps that count for a monitor, and how its messages answer them."""
        if name not in self._matched:
            monitor = next(each for each in self._plan.monitors if each.name == name)
            self._matched[name] = match_monitor(
                self.playback,
                self.monitors[name],
                monitor,
                self._plan.inputs,
                self.played_before,
            )
        return self._matched[name]

    def samples(self, segment: Segment) -> SegmentSamples:
        """The samples as metrics need them, without hops, processes and the host."""
        return SegmentSamples(
            segment=segment,
            playback=playback_samples(self.playback),
            monitors={
                name: monitor_samples(segment, matched)
                for name, matched in self.all_matched().items()
            },
            processes={},
            machine=None,
        )

    def all_matched(self) -> dict[str, MatchedMonitor]:
        """The same of every monitor."""
        return {name: self.matched(name) for name in self.monitors}


@dataclass(frozen=True)
class SegmentHeading:
    """What a segment is and how it is called; the names are those of `Segment`.

    `title` is for the progress shown; `rerun_of` is the id of the segment in whose place it is
    played.
    """

    kind: SegmentKind
    id: str
    title: str
    index: int = 1
    rerun_of: str = ""


class SegmentPlayer:
    """The player, the monitors and their sample files: everything that playing needs.

    A stage without a player can only be watched (`r2bspec.execute.measurement.live_mode`).

    Attributes:
        segments: what has been played.
        samples: the samples of what counts for a verdict, by the id of their segment, without
            those of processes and of the host.
        on_output_stopped: is called once for each monitor whose output stops, after the segment.
    """

    def __init__(
        self,
        plan: Plan,
        supervisor: ProcessSupervisor,
        player: ManagedProcess | None,
        rows_dir: Path,
        folder: RunFolder,
        progress: Progress,
        on_segment: Callable[[], None],
        resources: ResourceSampler,
        *,
        schedule: Schedule | None = None,
        confirms: bool = False,
    ) -> None:
        self._plan = plan
        self._schedule = schedule or CyclicSchedule(steps=())
        self._confirms = confirms
        self._resources = resources
        self._on_segment = on_segment
        self._supervisor = supervisor
        self._player = player
        monitors = plan.monitors
        self._playback = RowReader(rows_dir / PLAYBACK_ROWS, PLAYBACK_FIELDS)
        self._stall_log = StallLogReader(rows_dir)
        self._monitors = {
            plan.name: RowReader(rows_dir / f"{plan.name}.rows", MONITOR_FIELDS)
            for plan in monitors
        }
        self._taps = {
            tap.topic: RowReader(rows_dir / f"{tap.name}.rows", MONITOR_FIELDS)
            for tap in tap_monitors(monitors)
        }
        # What was played by now, nobody has seen: the graph was not there.
        self._initial_count = self._playback.count()
        self._next_rows: dict[str, int] = {}
        self._stopped_outputs: set[str] = set()
        self.on_output_stopped: Callable[[Segment, MonitorPlan], None] = lambda _, __: None
        self._folder = folder
        self._progress = progress
        self.segments: list[Segment] = []
        self.samples: dict[str, SegmentSamples] = {}
        self._stamps: list[NDArray[np.int64]] = []

    def play(
        self,
        heading: SegmentHeading,
        rate_hz: float,
        steps: int,
        stop_condition: StopCondition | None = None,
    ) -> SegmentObservation:
        """Play a segment and record it; one that ends with an exception is kept as incomplete.

        On the stage of a batch that confirms, everything measured is of that kind.

        Returns:
            The samples, after the graph has drained.

        Raises:
            RunError: the player does not answer, or a process died or failed.
        """
        heading = self._confirming(heading)
        self._progress.segment(heading.title, steps)
        first = self._first_rows()
        complete = False
        try:
            self._play(rate_hz, steps, first, stop_condition)
            self._drain(heading.kind, first)
            complete = True
        finally:
            observation = self._observe(first)
            self._write_segment(heading, rate_hz, steps, first, observation, complete)
        self._detect_stopped_outputs(heading.kind, observation)
        return observation

    def play_unrecorded(self, rate_hz: float, steps: int) -> None:
        """Play what belongs to no segment; `discard_new_rows` what comes of it.

        Raises:
            RunError: the player does not answer, or a process died or failed.
        """
        if self._player is None:
            raise RunError("nothing is played in this run")
        timeout_s = self._schedule.span_ns(rate_hz, steps) / 1e9 * 1.5 + _PLAYER_SLACK_S
        command = protocol.Play(rate_hz=rate_hz, steps=steps)
        self._supervisor.request(self._player, command, protocol.Played, timeout_s)

    def discard_new_rows(self) -> None:
        """Leave out what has arrived since the last segment."""
        self._next_rows = self._counts() | {name: rows.count() for name, rows in self._taps.items()}

    def _detect_stopped_outputs(self, kind: SegmentKind, observation: SegmentObservation) -> None:
        """Tell of outputs that have stopped, each once."""
        for plan in self._plan.monitors:
            if (
                kind == "warm_up"
                or plan.name in self._stopped_outputs
                or not observation.playback.size
            ):
                continue
            matched = observation.matched(plan.name)
            if output_stopped(matched.steps, matched.rows, matched.matching):
                self._stopped_outputs.add(plan.name)
                self.on_output_stopped(self.segments[-1], plan)

    def play_for(
        self, heading: SegmentHeading, rate_hz: float, duration_ns: int, min_steps: int = 2
    ) -> SegmentObservation:
        """Play a segment of a length in time, but of no fewer than `min_steps`; see `play`."""
        steps = max(min_steps, self._schedule.steps_within(rate_hz, duration_ns))
        return self.play(heading, rate_hz, steps)

    def segment_id_for(self, name: str) -> str:
        """The id of a segment that is played under a name, apart from those of another batch."""
        return f"confirm-{name}" if self._confirms else name

    def _confirming(self, heading: SegmentHeading) -> SegmentHeading:
        measured = self._confirms and heading.kind != "warm_up"
        kind = "confirmation" if measured else heading.kind
        return replace(heading, kind=kind, id=self.segment_id_for(heading.id))

    def received(self) -> dict[str, int]:
        """How many messages each monitor has received since it was started."""
        return {name: rows.count() for name, rows in self._monitors.items()}

    def _counts(self) -> dict[str, int]:
        return self.received() | {"": self._playback.count()}

    def _first_rows(self) -> dict[str, int]:
        """The first row of each file that belongs to no segment yet.

        What arrived since the end of the last segment is kept with the next one.
        """
        return {name: self._next_rows.get(name, 0) for name in (*self._monitors, *self._taps)} | {
            "": self._playback.count()
        }

    def _observe(self, first: dict[str, int]) -> SegmentObservation:
        # Monitors first: a step that is in the monitors' rows must be in the player's.
        monitors = {name: rows.read(first[name]) for name, rows in self._monitors.items()}
        before = first[""] - self._initial_count
        played = self._playback.read(first[""])
        return SegmentObservation(self._plan, played, monitors, before)

    def _play(
        self,
        rate_hz: float,
        steps: int,
        first: dict[str, int],
        stop_condition: StopCondition | None,
    ) -> None:
        if self._player is None:
            raise RunError("nothing is played in this run")
        begin = time.monotonic()
        deadline = begin + self._schedule.span_ns(rate_hz, steps) / 1e9 * 1.5 + _PLAYER_SLACK_S
        next_check = begin + _CHECK_INTERVAL_S
        stopping = False
        live = self._live(first)
        self._player.send(protocol.Play(rate_hz=rate_hz, steps=steps))
        # While the player waits for the first due time: what was used before then is not counted.
        self._resources.sample_at(time.monotonic_ns())
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
                    f"the player has not finished {steps} steps "
                    f"{f'at {rate_hz:g} Hz' if rate_hz else 'of the recording'} in time",
                    hint="The machine may be overloaded, or a publication blocks.",
                    code="R2B645",
                )
            if now >= next_check:
                next_check = now + _CHECK_INTERVAL_S
                self._progress.playing(live)
                if (
                    stop_condition
                    and not stopping
                    and stop_condition(self._observe(first), now - begin)
                ):
                    self._player.send(protocol.Stop())
                    stopping = True

    def _live(self, first: dict[str, int]) -> ProgressView:
        monitors = {plan.name: (plan, self._monitors[plan.name]) for plan in self._plan.monitors}
        return ProgressView(self._playback, monitors, first, self._cores)

    def _cores(self) -> dict[str, float]:
        known = {each.name: self._resources.cores(each.pid) for each in self._supervisor}
        return {name: cores for name, cores in known.items() if cores is not None}

    def _sample_at_end(self, first: dict[str, int], steps: int, rate_hz: float) -> None:
        """Have resources sampled when the last period ends, which the player does not wait for."""
        begun = self._playback.read(first[""], first[""] + 1)
        if begun.size:
            span_ns = self._schedule.span_ns(rate_hz, steps)
            self._resources.sample_at(int(begun["due_ns"][0]) + span_ns)

    def _drain(self, kind: SegmentKind, first: dict[str, int]) -> None:
        """Wait for answers; what is missing when this returns counts as lost.

        What comes after the last answer may be late: it is waited for until nothing has come for
        the whole `drain_timeout`. A gap before an answer to the last step is most likely a loss,
        because graphs rarely overtake themselves: it is waited for only for a multiple of the
        longest pause so far, so that a graph that drops does not cost a time-out in each segment.
        """
        timeout_s = self._plan.drain_timeout_ns / 1e9
        changed = time.monotonic()
        deadline = changed + max(_MAX_DRAIN_S, timeout_s)
        last_counts: dict[str, int] = {}
        longest_pause_s = 0.0
        outstanding: Outstanding | None = None
        while (now := time.monotonic()) < deadline:
            counts = self._counts()
            if counts != last_counts:
                if last_counts:
                    longest_pause_s = max(longest_pause_s, now - changed)
                last_counts, changed, outstanding = counts, now, None
                if self._enough(first, counts) and self._outstanding(first) == "nothing":
                    return
            quiet_s = now - changed
            if quiet_s > _MIN_QUIET_S and outstanding is None:
                outstanding = self._outstanding(first)
                # While the graph starts, playing on tells more than waiting.
                if kind == "warm_up" and not all(self.received().values()):
                    return
            limit_s = timeout_s
            if outstanding != "tail":
                limit_s = min(max(_MIN_QUIET_S, _QUIET_FACTOR * longest_pause_s), timeout_s)
            if quiet_s > limit_s:
                return
            self._supervisor.pump(_DRAIN_POLL_S)

    def _enough(self, first: dict[str, int], counts: dict[str, int]) -> bool:
        """Whether as many messages came as are expected, which is cheap to see."""
        if not isinstance(self._schedule, CyclicSchedule):
            # Of a timeline, not every step counts for every monitor.
            return True
        played = counts[""] - first[""]
        return all(
            (counts[each.name] - first[each.name] + 1) * each.ratio_inputs > played
            for each in self._plan.monitors
        )

    def _outstanding(self, first: dict[str, int]) -> Outstanding:
        """Which answers are still missing.

        As many messages as steps do not suffice: where some are answered twice, others still wait.
        """
        observation = self._observe(first)
        found: Outstanding = "nothing"
        for name, matched in observation.all_matched().items():
            if name in self._stopped_outputs:
                continue
            answers = matched.matching.first_row
            if not answers.size or (answers != NO_MATCH).all():
                continue
            if answers[-1] == NO_MATCH:
                return "tail"
            found = "gaps"
        return found

    def _write_segment(
        self,
        heading: SegmentHeading,
        rate_hz: float,
        steps: int,
        first: dict[str, int],
        observation: SegmentObservation,
        complete: bool,
    ) -> None:
        playback = observation.playback
        if not playback.size:
            return
        began_ns = int(playback["due_ns"][0])
        self._write_samples(
            Segment(
                id=heading.id,
                kind=heading.kind,
                rate_hz=rate_hz,
                index=heading.index,
                steps=steps,
                began_ns=began_ns,
                ended_ns=began_ns + self._schedule.span_ns(rate_hz, playback.size),
                complete=complete,
                played_before=observation.played_before,
                rerun_of=heading.rerun_of,
                monitor_held_ns=self._stall_log.between(began_ns, time.monotonic_ns()),
            ),
            observation,
            first,
        )

    def _write_samples(
        self, segment: Segment, observation: SegmentObservation, first: dict[str, int]
    ) -> None:
        """Write a segment and its rows, and hold its samples if a verdict may rest on them."""
        taps = {topic: reader.read(first[topic]) for topic, reader in self._taps.items()}
        self._folder.write_playback(segment.id, observation.playback)
        for name, rows in observation.monitors.items():
            self._folder.write_monitor(segment.id, name, rows)
            self._next_rows[name] = first[name] + rows.size
        for topic, rows in taps.items():
            self._folder.write_tap(segment.id, topic, rows)
            self._next_rows[topic] = first[topic] + rows.size
        if segment.complete and segment.kind in _JUDGED_KINDS:
            rows_of = SegmentRows(
                observation.playback, observation.monitors, taps, self._earlier_stamps
            )
            matched = None if segment.live else observation.all_matched()
            self.samples[segment.id] = segment_samples(self._plan, segment, rows_of, matched)
        self._stamps.append(observation.playback["stamp_ns"].copy())
        self.segments.append(segment)
        self._on_segment()

    def _earlier_stamps(self) -> NDArray[np.int64]:
        return np.concatenate(self._stamps) if self._stamps else NO_STAMPS
