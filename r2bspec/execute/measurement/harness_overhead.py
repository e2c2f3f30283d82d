"""The harness overhead: the latency of the harness and its transport without a graph.

Before nodes are created, the player plays for at most about a second (below 20 Hz longer) to a
subscription in the process of the monitor, on the topics of the inputs and with their QoS. Every
latency of the run contains this overhead. It is reported but not subtracted: a graph of several
processes transfers messages more than once, and the cost of a transfer depends on rate and load.

How many messages that takes: the median is known once a distribution-free confidence interval of it
is narrow. Of n independent values, the median of their distribution lies between the k-th smallest
and the k-th largest with probability 1 - 2 P(B < k), where B is binomial with n and 1/2 (David and
Nagaraja, Order Statistics, 7.1). For 11 values and k = 2 this is 98.8 %. The 99th percentile is
bounded by the largest of n values with probability 1 - 0.99^n: 299 values are enough for 95 %. Of
fewer than 100 values, the largest is also what is reported as the 99th percentile (nearest rank),
which says what to expect, and not how likely more is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from r2bspec.execute.host_watch import Interference
from r2bspec.execute.measurement.segments import PLAYBACK_ROWS
from r2bspec.execute.processes.supervisor import REPLY_TIMEOUT_S, ManagedProcess
from r2bspec.execute.run_context import RunContext
from r2bspec.ipc import protocol
from r2bspec.ipc.arrivals import ArrivalReader
from r2bspec.ipc.playback_file import PlaybackReader
from r2bspec.ipc.sample_files import RowReader
from r2bspec.ipc.schedule import Schedule
from r2bspec.judge.measure.matching import StepStamps, match, select_expected_steps
from r2bspec.judge.measure.times import percentile
from r2bspec.plan.plan import InputPlan, MonitorPlan, Plan
from r2bspec.record.run_record import HarnessOverheadRecord
from r2bspec.record.sample_arrays import MONITOR_FIELDS, PLAYBACK_FIELDS, Rows

DURATION_S = 1.0
_DEFAULT_HZ = 30.0
_WARM_UP_STEPS = 30
"""More than the depth of a queue, so that every page that will be used has been touched."""

_WARM_UP_HZ = 200.0
"""Touching pages needs no time between the steps, so this is faster than most rates."""

_SUBSCRIPTION_DEPTH = 1000
_MAX_MATCH_WAIT_S = 10.0
_QUIET_PERIOD_S = 0.3
_POLL_S = 0.02
_LOOK_S = 0.1
"""How often to look whether enough was played: rarely, because a look uses the processor."""

_P99_MESSAGES: Final = math.ceil(math.log(0.05) / math.log(0.99))
_FEWEST_MESSAGES: Final = 11
_FEW_MESSAGES: Final = 20
_MOST_MESSAGES: Final = 2000
_MEDIAN_ERROR: Final = 0.02
"""How often the median may lie outside its interval."""

_NARROW: Final = 0.25
"""How far the ends of the interval may be from the median, as a share of it."""


@dataclass
class HarnessOverhead:
    """The measurement of the overhead on each input of a plan.

    Attributes:
        plan: of the run.
        context: of the run.
        player: configured with the inputs of the plan.
        monitor: configured; it need not have subscribed.
        rows_dir: where player and monitor write their rows.
        schedule: of the player.
    """

    plan: Plan
    context: RunContext
    player: ManagedProcess
    monitor: ManagedProcess
    rows_dir: Path
    schedule: Schedule

    def measure(self) -> tuple[HarnessOverheadRecord, ...]:
        """Measure it; takes at most `DURATION_S`, and longer below 20 Hz.

        If other programs disturbed it, it is measured once more, and the quieter measurement
        counts.

        The result is empty if the measurement would affect the graph: if an input already has a
        subscription, or if an input is transient local, so that late subscriptions would receive
        the messages played here.

        Raises:
            RunError: a process does not respond, or exited.
        """
        inputs, supervisor = self.plan.inputs, self.context.supervisor
        topics = [source.topic for source in inputs]
        if not can_be_measured(inputs) or any(self._matches(self.player, topics)):
            return ()
        watches = tuple(
            # The name of no monitor begins with a dot.
            MonitorPlan(
                name=f".overhead-{number}",
                topic=source.topic,
                type=source.type,
                match="stamp",
                answers=(source.topic,),
                qos=msgspec.structs.replace(source.qos, depth=_SUBSCRIPTION_DEPTH),
            )
            for number, source in enumerate(inputs)
            if not source.recorded_rate
        )
        supervisor.request(self.monitor, protocol.StartTap(monitors=watches), protocol.Matched)
        records: tuple[HarnessOverheadRecord, ...] = ()
        watched = [watch.topic for watch in watches]
        # From both sides: what is published before the monitor knows the player is lost to it.
        if self._wait_for_matches(self.player, topics, wanted=True) and self._wait_for_matches(
            self.monitor, watched, wanted=True
        ):
            records = self._measure_watched(watches)
        supervisor.request(self.monitor, protocol.StopTap(), protocol.Matched)
        # The start waits for nodes by counting subscriptions, which must not include these.
        self._wait_for_matches(self.player, topics, wanted=False)
        return records

    def _measure_watched(
        self, watches: tuple[MonitorPlan, ...]
    ) -> tuple[HarnessOverheadRecord, ...]:
        """Play to these subscriptions, after a warm-up."""
        rate_hz = overhead_rate_hz(self.plan)
        step_stamps = StepStamps(self.schedule)
        files = [
            ArrivalReader(self.rows_dir / f"{watch.name}.rows", MONITOR_FIELDS) for watch in watches
        ]
        played = PlaybackReader(self.rows_dir / PLAYBACK_ROWS, PLAYBACK_FIELDS)
        usual = self.schedule.steps_within(rate_hz, round(DURATION_S * 1e9))
        warm_up_hz = max(rate_hz, _WARM_UP_HZ) if rate_hz else 0.0
        self._play(files, warm_up_hz, min(_WARM_UP_STEPS, max(1, usual)))
        length = overhead_length(usual)

        def measure() -> tuple[Interference, tuple[HarnessOverheadRecord, ...]]:
            began_ns = time.monotonic_ns()
            first, before = played.count(), [rows.count() for rows in files]

            def received() -> Iterator[tuple[MonitorPlan, Rows, Rows]]:
                sent = played.read(first)
                for watch, file, start in zip(watches, files, before, strict=True):
                    answers = step_stamps.replace(file.read(start), sent, first)
                    yield watch, select_expected_steps(sent, self.plan.inputs, watch), answers

            def is_enough() -> bool:
                return all(
                    len(latencies := latencies_ns(steps, answers)) >= length.fewest
                    and median_is_known(latencies)
                    for _, steps, answers in received()
                )

            self._play(files, rate_hz, length.most, is_enough)
            interference = self.context.host.between(began_ns, time.monotonic_ns())
            return interference, tuple(
                msgspec.structs.replace(
                    overhead_record(watch.topic, rate_hz, steps, answers),
                    disturbed=interference.reasons,
                    placement=self.plan.harness.placement,
                    processes=1 if self.player.process is self.monitor.process else 2,
                )
                for watch, steps, answers in received()
            )

        return _quietest(measure)

    def _play(
        self,
        files: Sequence[RowReader],
        rate_hz: float,
        steps: int,
        is_enough: Callable[[], bool] = lambda: False,
    ) -> None:
        """Play, and wait until all messages have arrived, or none has arrived for a while.

        Args:
            files: the rows of the monitor.
            rate_hz: steps per second; 0 for the rate of the recording.
            steps: how many are played.
            is_enough: whether to stop before that; asked some times a second.
        """
        supervisor, player = self.context.supervisor, self.player
        before = [rows.count() for rows in files]
        player.send(protocol.Play(rate_hz=rate_hz, steps=steps))
        span_s = self.schedule.span_ns(rate_hz, steps) / 1e9
        with supervisor.waiting(f"{player.name}: played"):
            stops_at = time.monotonic() + span_s
            while not player.inbox and time.monotonic() < stops_at:
                supervisor.pump(_LOOK_S)
                if is_enough():
                    player.send(protocol.Stop())
                    break
        timeout_s = span_s * 1.5 + REPLY_TIMEOUT_S
        steps = supervisor.answer(player, protocol.Played, timeout_s).steps
        goal = [count + steps for count in before]
        last, changed = [0], time.monotonic()
        while time.monotonic() - changed < _QUIET_PERIOD_S:
            counts = [rows.count() for rows in files]
            if all(count >= enough for count, enough in zip(counts, goal, strict=True)):
                return
            if counts != last:
                last, changed = counts, time.monotonic()
            supervisor.pump(_POLL_S)

    def _matches(self, part: ManagedProcess, topics: list[str]) -> list[int]:
        command = protocol.CountMatches()
        counts = self.context.supervisor.request(part, command, protocol.Matched).counts
        return [counts.get(topic, 0) for topic in topics]

    def _wait_for_matches(self, part: ManagedProcess, topics: list[str], *, wanted: bool) -> bool:
        """Wait until all topics of a part are matched, or, unless `wanted`, none is."""

        def are_as_wanted() -> bool:
            return all((count > 0) == wanted for count in self._matches(part, topics))

        return self.context.supervisor.pump_until(are_as_wanted, _MAX_MATCH_WAIT_S, _POLL_S)


def can_be_measured(inputs: tuple[InputPlan, ...]) -> bool:
    """Whether no message that is played meanwhile is kept for subscriptions of the graph."""
    return not any(input_.qos.durability == "transient_local" for input_ in inputs)


def _quietest(
    measure: Callable[[], tuple[Interference, tuple[HarnessOverheadRecord, ...]]],
) -> tuple[HarnessOverheadRecord, ...]:
    """Measure, and once more if others disturbed that; the one from which they took less."""
    latencies, records = measure()
    if not latencies.reasons:
        return records
    again, other = measure()
    return other if not again.reasons or again.taken < latencies.taken else records


def overhead_rate_hz(plan: Plan) -> float:
    """The rate at which the overhead of a plan is measured: the lowest of its results."""
    rates = [*(play.rate_hz for play in plan.play), *plan.sustained_hz]
    rates += [plan.search.min_hz] if plan.search and not rates else []
    return min(rates, default=_DEFAULT_HZ)


def overhead_record(
    topic: str, rate_hz: float, playback: Rows, received: Rows
) -> HarnessOverheadRecord:
    """The overhead on one input.

    Args:
        topic: the input.
        rate_hz: the rate at which it was played.
        playback: rows of type `PLAYBACK_DTYPE`.
        received: rows of type `MONITOR_DTYPE`; stamps are 0 where the type has no header.
    """
    latency_ns = latencies_ns(playback, received)
    late_ns = playback["published_ns"] - playback["due_ns"]
    return HarnessOverheadRecord(
        topic=topic,
        bytes=int(received["bytes"].max()) if received.size else 0,
        rate_hz=rate_hz,
        sent=int(playback.size),
        received=int(latency_ns.size),
        latency_p50_ns=_quantile(latency_ns, 0.5),
        latency_p99_ns=_quantile(latency_ns, 0.99),
        lateness_p50_ns=_quantile(late_ns, 0.5),
        lateness_p99_ns=_quantile(late_ns, 0.99),
    )


def latencies_ns(playback: Rows, received: Rows) -> Rows:
    """The latencies of those messages that have arrived; the arguments are those of a record."""
    matches = match(playback, received, "stamp" if (received["stamp_ns"] != 0).any() else "order")
    answered = matches.first_row >= 0
    arrived_ns = received["received_ns"][matches.first_row[answered]]
    latency_ns: Rows = arrived_ns - playback["published_ns"][answered]
    return latency_ns


def _quantile(values_ns: Rows, q: float) -> int | None:
    value = percentile(values_ns.astype(float), q)
    return None if value is None else round(value)


class OverheadLength(NamedTuple):
    """After how many messages the measurement may end, and after how many it does."""

    fewest: int
    most: int


def overhead_length(usual: int) -> OverheadLength:
    """The length for a rate.

    Args:
        usual: how many messages a second has, or as much of one as the recording.
    """
    if usual < _FEW_MESSAGES:
        # Below 20 Hz a second has too few; each further one takes long.
        return OverheadLength(_FEWEST_MESSAGES, _FEW_MESSAGES)
    most = min(usual, _MOST_MESSAGES)
    return OverheadLength(min(most, _P99_MESSAGES), most)


def median_is_known(values: Rows) -> bool:
    """Whether the interval of the median is narrow; never for too few values to have one."""
    rank = _rank(len(values))
    if not rank:
        return False
    ordered = sorted(values)
    middle = ordered[len(ordered) // 2]
    allowed = _NARROW * abs(middle)
    return bool(ordered[-rank] - middle <= allowed and middle - ordered[rank - 1] <= allowed)


def _rank(count: int) -> int:
    """The largest k of the interval from the k-th smallest to the k-th largest; 0 for none."""
    rank, below = 0, 0
    allowed = _MEDIAN_ERROR / 2 * 2**count
    while (below := below + math.comb(count, rank)) <= allowed:
        rank += 1
    return rank
