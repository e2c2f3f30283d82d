"""Playing one segment: offer a rate, let the graph drain, and cut the samples out.

Player and monitors write rows for the whole run; a segment is the stretch between two row counts.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from r2bspec.execute.diagnosis.stopped_outputs import fell_silent
from r2bspec.execute.errors import RunError
from r2bspec.execute.host.resource_sampler import ResourceSampler
from r2bspec.execute.measurement.progress_view import LiveView
from r2bspec.execute.processes.supervisor import Child, Children
from r2bspec.execute.progress import Progress
from r2bspec.ipc import protocol
from r2bspec.ipc.sample_files import RowReader
from r2bspec.ipc.schedule import Cyclic, Schedule
from r2bspec.ipc.stall_log import HeldReader
from r2bspec.measure.expected_steps import asked_of
from r2bspec.measure.matching import Matching, match, ratio_of
from r2bspec.measure.samples import SegmentSamples, monitor_samples, playback_samples
from r2bspec.plan.plan import InputPlan, MonitorPlan
from r2bspec.plan.taps import tap_watches
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import MONITOR_FIELDS, PLAYBACK_FIELDS, Segment, SegmentKind
from r2bspec.record.sample_arrays import Rows

PLAYBACK_ROWS = "playback"
"""The player's sample file; those of the monitors end in ``.rows``."""

_WATCH_S = 0.25
_QUIET_LEAST_S = 0.3
_QUIET_MOST_S = 3.0
_DRAIN_MOST_S = 60.0
_PLAYER_SLACK_S = 30.0

Watch = Callable[["Observed", float], bool]
"""Called every quarter second with what is there so far and the seconds played; True stops."""


class Observed:
    """The samples of one segment, all there is at the moment they were read."""

    def __init__(
        self,
        playback: Rows,
        monitors: dict[str, Rows],
        plans: tuple[MonitorPlan, ...],
        inputs: tuple[InputPlan, ...],
        played_before: int,
    ) -> None:
        self.playback = playback
        self.monitors = monitors
        self.played_before = played_before
        self.now_ns = time.monotonic_ns()
        self._plans = plans
        self._inputs = inputs

    def matching(self, name: str) -> Matching:
        """How the messages of a monitor answer the steps of the playback."""
        plan = self._plan(name)
        ratio = ratio_of(plan, self.played_before)
        return match(self.asked(name), self.monitors[name], plan.match, ratio)

    def samples(self, segment: Segment) -> SegmentSamples:
        """The samples as metrics need them, without those of processes."""
        return SegmentSamples(
            segment=segment,
            playback=playback_samples(self.playback),
            monitors={
                name: monitor_samples(segment, self.asked(name), rows, self._plan(name))
                for name, rows in self.monitors.items()
            },
            processes={},
            machine=None,
        )

    def asked(self, name: str) -> Rows:
        """The steps that count for a monitor."""
        return asked_of(self.playback, self._inputs, self._plan(name))

    def _plan(self, name: str) -> MonitorPlan:
        return next(plan for plan in self._plans if plan.name == name)


class Stage:
    """The player, the monitors and their sample files: everything that playing needs.

    A stage without a player can only be watched (`r2bspec.execute.measurement.live_mode`).

    Attributes:
        segments: what has been played.
        on_silence: is called once for each monitor whose output stops, after the segment.
    """

    def __init__(
        self,
        children: Children,
        player: Child | None,
        monitors: tuple[MonitorPlan, ...],
        rows_dir: Path,
        folder: RunFolder,
        progress: Progress,
        on_segment: Callable[[], None],
        resources: ResourceSampler,
        *,
        schedule: Schedule | None = None,
        inputs: tuple[InputPlan, ...] = (),
        confirms: bool = False,
    ) -> None:
        self._schedule = schedule or Cyclic(steps=())
        self._inputs = inputs
        self._confirms = confirms
        self._resources = resources
        self._on_segment = on_segment
        self._children = children
        self._player = player
        self._plans = monitors
        self._playback = RowReader(rows_dir / PLAYBACK_ROWS, PLAYBACK_FIELDS)
        self._held = HeldReader(rows_dir)
        self._monitors = {
            plan.name: RowReader(rows_dir / f"{plan.name}.rows", MONITOR_FIELDS)
            for plan in monitors
        }
        self._taps = {
            tap.topic: RowReader(rows_dir / f"{tap.name}.rows", MONITOR_FIELDS)
            for tap in tap_watches(monitors)
        }
        # What was played by now, nobody has seen: the graph was not there.
        self._begun = self._playback.count()
        self._read: dict[str, int] = {}
        self._silent: set[str] = set()
        self.on_silence: Callable[[Segment, MonitorPlan], None] = lambda _, __: None
        self._folder = folder
        self._progress = progress
        self.segments: list[Segment] = []

    def play(
        self,
        kind: SegmentKind,
        segment_id: str,
        rate_hz: float,
        steps: int,
        *,
        title: str,
        index: int = 1,
        watch: Watch | None = None,
        rerun_of: str = "",
    ) -> Observed:
        """Play a segment and record it; one that ends with an exception is kept as incomplete.

        `rerun_of` is the id of the segment in whose place it is played. On the stage of a batch
        that confirms, everything measured is of that kind.

        Returns:
            The samples, after the graph has drained.

        Raises:
            RunError: the player does not answer, or a process died or failed.
        """
        kind, segment_id = self._kind_of(kind), self.id_of(segment_id)
        self._progress.segment(title, steps)
        first = self._unread()
        complete = False
        try:
            played = self._play(rate_hz, steps, first, watch)
            self._drain(first, played)
            complete = True
        finally:
            observed = self._observed(first)
            self._write(
                kind, segment_id, rate_hz, steps, index, first, observed, complete, rerun_of
            )
        self._look_for_silence(kind, observed)
        return observed

    def play_aside(self, rate_hz: float, steps: int) -> None:
        """Play what belongs to no segment; `skip` what comes of it.

        Raises:
            RunError: the player does not answer, or a process died or failed.
        """
        if self._player is None:
            raise RunError("nothing is played in this run")
        timeout_s = self._schedule.span_ns(rate_hz, steps) / 1e9 * 1.5 + _PLAYER_SLACK_S
        command = protocol.Play(rate_hz=rate_hz, steps=steps)
        self._children.ask(self._player, command, protocol.Played, timeout_s)

    def skip(self) -> None:
        """Leave out what has arrived since the last segment."""
        self._read = self._counts() | {name: rows.count() for name, rows in self._taps.items()}

    def _look_for_silence(self, kind: SegmentKind, observed: Observed) -> None:
        """Tell of outputs that have stopped, each once."""
        for plan in self._plans:
            if kind == "warm_up" or plan.name in self._silent or not observed.playback.size:
                continue
            seen, matched = observed.monitors[plan.name], observed.matching(plan.name)
            if fell_silent(observed.asked(plan.name), seen, matched):
                self._silent.add(plan.name)
                self.on_silence(self.segments[-1], plan)

    def play_for(
        self,
        kind: SegmentKind,
        segment_id: str,
        rate_hz: float,
        duration_ns: int,
        *,
        title: str,
        index: int = 1,
        least_steps: int = 2,
        rerun_of: str = "",
    ) -> Observed:
        """Play a segment of a length in time, but of no fewer than `least_steps`; see `play`."""
        steps = max(least_steps, self._schedule.steps_within(rate_hz, duration_ns))
        return self.play(
            kind, segment_id, rate_hz, steps, title=title, index=index, rerun_of=rerun_of
        )

    def id_of(self, name: str) -> str:
        """The id of a segment that is played under a name, apart from those of another batch."""
        return f"confirm-{name}" if self._confirms else name

    def _kind_of(self, kind: SegmentKind) -> SegmentKind:
        return "confirmation" if self._confirms and kind != "warm_up" else kind

    def received(self) -> dict[str, int]:
        """How many messages each monitor has received since it was started."""
        return {name: rows.count() for name, rows in self._monitors.items()}

    def _counts(self) -> dict[str, int]:
        return self.received() | {"": self._playback.count()}

    def _unread(self) -> dict[str, int]:
        """The first row of each file that belongs to no segment yet.

        What arrived since the end of the last segment is kept with the next one.
        """
        return {name: self._read.get(name, 0) for name in (*self._monitors, *self._taps)} | {
            "": self._playback.count()
        }

    def _observed(self, first: dict[str, int]) -> Observed:
        # Monitors first: a step that is in the monitors' rows must be in the player's.
        monitors = {name: rows.read(first[name]) for name, rows in self._monitors.items()}
        before = first[""] - self._begun
        played = self._playback.read(first[""])
        return Observed(played, monitors, self._plans, self._inputs, before)

    def _play(self, rate_hz: float, steps: int, first: dict[str, int], watch: Watch | None) -> int:
        if self._player is None:
            raise RunError("nothing is played in this run")
        begin = time.monotonic()
        deadline = begin + self._schedule.span_ns(rate_hz, steps) / 1e9 * 1.5 + _PLAYER_SLACK_S
        next_watch = begin + _WATCH_S
        stopping = False
        live = self._live(first)
        self._player.send(protocol.Play(rate_hz=rate_hz, steps=steps))
        # While the player waits for the first due time: what was used before then is not counted.
        self._resources.sample_at(time.monotonic_ns())
        while True:
            self._children.pump()
            while self._player.inbox:
                message = self._player.inbox.popleft()
                if isinstance(message, protocol.Played):
                    self._sample_at_end(first, message.steps, rate_hz)
                    return message.steps
            now = time.monotonic()
            if now > deadline:
                raise RunError(
                    f"the player has not finished {steps} steps "
                    f"{f'at {rate_hz:g} Hz' if rate_hz else 'of the recording'} in time",
                    hint="The machine may be overloaded, or a publication blocks.",
                    code="R2B645",
                )
            if now >= next_watch:
                next_watch = now + _WATCH_S
                self._progress.playing(live)
                if watch and not stopping and watch(self._observed(first), now - begin):
                    self._player.send(protocol.Stop())
                    stopping = True

    def _live(self, first: dict[str, int]) -> LiveView:
        monitors = {plan.name: (plan, self._monitors[plan.name]) for plan in self._plans}
        return LiveView(self._playback, monitors, first, self._cores)

    def _cores(self) -> dict[str, float]:
        known = {each.name: self._resources.cores(each.pid) for each in self._children}
        return {name: cores for name, cores in known.items() if cores is not None}

    def _sample_at_end(self, first: dict[str, int], steps: int, rate_hz: float) -> None:
        """Have resources sampled when the last period ends, which the player does not wait for."""
        begun = self._playback.read(first[""], first[""] + 1)
        if begun.size:
            span_ns = self._schedule.span_ns(rate_hz, steps)
            self._resources.sample_at(int(begun["due_ns"][0]) + span_ns)

    def _drain(self, first: dict[str, int], played: int) -> None:
        """Wait until every step is answered, or nothing has come for longer than it ever took."""
        last_counts: dict[str, int] = {}
        changed = time.monotonic()
        deadline = changed + _DRAIN_MOST_S
        longest_pause_s = 0.0
        while time.monotonic() < deadline:
            counts = self._counts()
            now = time.monotonic()
            if counts != last_counts:
                if self._all_answered(first, counts, played):
                    return
                if last_counts:
                    longest_pause_s = max(longest_pause_s, now - changed)
                last_counts, changed = counts, now
            quiet_s = min(max(_QUIET_LEAST_S, 5 * longest_pause_s), _QUIET_MOST_S)
            if now - changed > quiet_s:
                return
            self._children.pump(0.01)

    def _all_answered(self, first: dict[str, int], counts: dict[str, int], played: int) -> bool:
        """Whether each step has its answer and nothing more is to be expected.

        As many messages as steps do not suffice: where some are answered twice, others still wait.
        """
        for plan in self._plans if isinstance(self._schedule, Cyclic) else ():
            # A step may lead to several messages, or to none by itself. In a timeline not every
            # monitor is asked about every step.
            if (counts[plan.name] - first[plan.name] + 1) * plan.ratio_inputs <= played:
                return False
        observed = self._observed(first)
        return not any(observed.matching(name).missed for name in self._monitors)

    def _write(
        self,
        kind: SegmentKind,
        segment_id: str,
        rate_hz: float,
        steps: int,
        index: int,
        first: dict[str, int],
        observed: Observed,
        complete: bool,
        rerun_of: str,
    ) -> None:
        playback = observed.playback
        if not playback.size:
            return
        began_ns = int(playback["due_ns"][0])
        self._keep(
            Segment(
                id=segment_id,
                kind=kind,
                rate_hz=rate_hz,
                index=index,
                steps=steps,
                began_ns=began_ns,
                ended_ns=began_ns + self._schedule.span_ns(rate_hz, playback.size),
                complete=complete,
                played_before=observed.played_before,
                rerun_of=rerun_of,
                monitor_held_ns=self._held.between(began_ns, time.monotonic_ns()),
            ),
            observed,
            first,
        )

    def _keep(self, segment: Segment, observed: Observed, first: dict[str, int]) -> None:
        """Write a segment and its samples."""
        self._folder.write_playback(segment.id, observed.playback)
        for name, rows in observed.monitors.items():
            self._folder.write_monitor(segment.id, name, rows)
            self._read[name] = first[name] + rows.size
        for topic, reader in self._taps.items():
            rows = reader.read(first[topic])
            self._folder.write_tap(segment.id, topic, rows)
            self._read[topic] = first[topic] + rows.size
        self.segments.append(segment)
        self._on_segment()
