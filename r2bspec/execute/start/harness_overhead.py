"""The harness overhead: the latency of the harness and its transport without a graph.

Before nodes are created, the player plays for at most about a second (below 11 Hz longer) to a
subscription in the process of the monitor, on the topics of the inputs and with their QoS. Every
latency of the run contains this overhead. It is reported but not subtracted: a graph of several
processes transfers messages more than once, and the cost of a transfer depends on rate and load.

A second of messages is played, but at least 11 and at most 299. Of n independent values, the median
of their distribution lies between the k-th smallest and the k-th largest with probability
1 - 2 P(B < k), where B is binomial with n and 1/2 (David and Nagaraja, Order Statistics, 7.1): for
11 values and k = 2 this is 98.8 %. The 99th percentile is bounded by the largest of n values with
probability 1 - 0.99^n: 299 values are enough for 95 %. Of fewer than 100 values, the largest is
also what is reported as the 99th percentile (nearest rank), which says what to expect, and not how
likely more is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.execute.diagnose.facts import wait_for_quiet
from r2bspec.execute.processes.supervisor import REPLY_TIMEOUT_S, ManagedProcess
from r2bspec.execute.run_context import Interference, RunContext
from r2bspec.execute.start.segments import PLAYBACK_ROWS
from r2bspec.ipc import protocol
from r2bspec.ipc.playback_file import PlaybackReader
from r2bspec.ipc.sample_files import ArrivalReader, RowReader
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

_FEWEST_STEPS: Final = 11
_MOST_STEPS: Final = math.ceil(math.log(0.05) / math.log(0.99))


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
        """Measure the overhead; takes at most `DURATION_S`, and longer below 11 Hz.

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
        steps = overhead_steps(self.schedule.steps_within(rate_hz, round(DURATION_S * 1e9)))
        warm_up_hz = max(rate_hz, _WARM_UP_HZ) if rate_hz else 0.0
        self._play(files, warm_up_hz, min(_WARM_UP_STEPS, steps))

        def measure() -> tuple[Interference, tuple[HarnessOverheadRecord, ...]]:
            began_ns = time.monotonic_ns()
            first, before = played.count(), [rows.count() for rows in files]
            self._play(files, rate_hz, steps)
            interference = self.context.host.between(began_ns, time.monotonic_ns())
            sent = played.read(first)
            return interference, tuple(
                msgspec.structs.replace(
                    overhead_record(
                        watch.topic,
                        rate_hz,
                        select_expected_steps(sent, self.plan.inputs, watch),
                        step_stamps.replace(file.read(start), sent, first),
                    ),
                    disturbed=interference.reasons,
                    placement=self.plan.harness.placement,
                    processes=1 if self.player.process is self.monitor.process else 2,
                )
                for watch, file, start in zip(watches, files, before, strict=True)
            )

        return _quietest(measure)

    def _play(self, files: Sequence[RowReader], rate_hz: float, steps: int) -> None:
        """Play, and wait until all messages have arrived, or none has arrived for a while.

        Args:
            files: the rows of the monitor.
            rate_hz: steps per second; 0 for the rate of the recording.
            steps: how many are played.
        """
        supervisor = self.context.supervisor
        goal = [rows.count() + steps for rows in files]
        timeout_s = self.schedule.span_ns(rate_hz, steps) / 1e9 * 1.5 + REPLY_TIMEOUT_S
        command = protocol.Play(rate_hz=rate_hz, steps=steps)
        supervisor.request(self.player, command, protocol.Played, timeout_s)
        wait_for_quiet(supervisor, files, _QUIET_PERIOD_S, goal=goal)

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
    """Return True if no message of the measurement is kept for subscriptions of the graph."""
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
    """Return the rate at which the overhead of a plan is measured: the lowest of its rates."""
    rates = [*(play.rate_hz for play in plan.play), *plan.sustained_hz]
    rates += [plan.search.min_hz] if plan.search and not rates else []
    return min(rates, default=_DEFAULT_HZ)


def overhead_record(
    topic: str, rate_hz: float, playback: Rows, received: Rows
) -> HarnessOverheadRecord:
    """Return the overhead on one input.

    Args:
        topic: the input.
        rate_hz: the rate at which it was played.
        playback: rows of type `PLAYBACK_DTYPE`.
        received: rows of type `MONITOR_DTYPE`; stamps are 0 where the type has no header.
    """
    matches = match(playback, received, "stamp" if (received["stamp_ns"] != 0).any() else "order")
    answered = matches.first_row >= 0
    arrived_ns = received["received_ns"][matches.first_row[answered]]
    latency_ns = arrived_ns - playback["published_ns"][answered]
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


def _quantile(values_ns: Rows, q: float) -> int | None:
    value = percentile(values_ns.astype(float), q)
    return None if value is None else round(value)


def overhead_steps(usual: int) -> int:
    """Return the number of steps to play.

    Args:
        usual: how many a second has, or as much of one as the recording.
    """
    return min(max(usual, _FEWEST_STEPS), _MOST_STEPS)
