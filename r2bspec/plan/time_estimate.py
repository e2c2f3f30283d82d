"""How long a run or a comparison will take, from its plan alone: an estimate for people who wait.

What the plan declares is exact: iterations and warm-up. A search ends as soon as it can, and a
comparison when it is decided, so that minimum and maximum are stated. What the plan does not know,
such as the start of processes, has a typical value. Nothing is decided by these numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from r2bspec.diagnostics.quote import time_text
from r2bspec.language.benchmark_defaults import PROBE, SEARCH_CONFIRMATIONS, SEARCH_PROBES
from r2bspec.language.spec import StartWaits
from r2bspec.plan.comparability import pair_count, single_run_plan
from r2bspec.plan.interim_looks import FIRST_LOOK_BY_TURNS, pairs_that_confirm
from r2bspec.plan.plan import Plan, PlayPlan

_LOAD_S = 0.5
_PREPROCESS_S = 10.0
_HARNESS_START_S = 0.5
_GRAPH_START_S = 0.8
_PROCESS_START_S = 0.3
_COLLECT_S = 1.0
_LATER_START_S = 1.0
_SEGMENT_END_S = 0.2
_SIDES_START_S = 5.0
"""Typical times."""

_TYPICAL_SEARCH = 0.5
"""Of the time that a search may take (the median of simulated ones: 0.3 to 0.7)."""

_SESSION_PHASES = ("start", "graph", "warm_up")


@dataclass(frozen=True)
class TimeEstimate:
    """The expected time of a run, or of the runs of a comparison.

    Attributes:
        phases: seconds by phase of one run, in its order; later starts are a part of ``play``.
        at_most_s: of all runs, with all additional iterations and the confirmation that the plan
            allows.
        runs: how many are made one after the other, if none is left out: two for each pair of a
            comparison, and one for each start of both its sides.
        least_runs: after so many a comparison may be decided; `runs` if 0.
        noun: what a run is called.
        once_s: the time before the first one.
    """

    phases: Mapping[str, float]
    at_most_s: float
    runs: int = 1
    least_runs: int = 0
    noun: str = "runs"
    once_s: float = 0.0

    @property
    def run_s(self) -> float:
        """The time of one run: of everything that is played in any case."""
        return sum(self.phases.values())

    @property
    def seconds(self) -> float:
        """The time of all runs."""
        return self.once_s + self.runs * self.run_s

    @property
    def least_s(self) -> float:
        """The time of the fewest runs that may decide a comparison."""
        return self.once_s + (self.least_runs or self.runs) * self.run_s

    def text(self) -> str:
        """Return the estimate in words.

        Such as ``about 40 s, up to 2 min``, or, of a comparison, ``about 50 s to 2 min (5 to 12
        starts of both sides), up to 3 min with a confirmation``.
        """
        expected, longest = time_text(self.seconds), time_text(self.at_most_s)
        at_most = f", up to {longest}" if longest != expected else ""
        if self.runs == 1:
            return f"about {expected}{at_most}"
        number = f"{self.least_runs} to {self.runs}" if self.is_open else str(self.runs)
        confirmed = f"{at_most} with a confirmation" if at_most else ""
        return f"{range_text(self.least_s, self.seconds)} ({number} {self.noun}){confirmed}"

    @property
    def is_open(self) -> bool:
        """Whether a comparison may be decided before all its runs are played."""
        return 0 < self.least_runs < self.runs


def range_text(least_s: float, most_s: float) -> str:
    """Return a time between a minimum and a maximum, in words."""
    least, most = time_text(least_s), time_text(most_s)
    return f"about {most}" if least == most else f"about {least} to {most}"


def estimate_time(plan: Plan) -> TimeEstimate:
    """Return the time that a run of the plan will take."""
    play_s = sum(_play_s(play, play.iterations) for play in plan.plays)
    probe_s = plan.search.probe_ns / 1e9 if plan.search is not None else PROBE.seconds
    start_waits_s = sum(wait.seconds for wait in StartWaits.fields_of(plan).values())
    # Data and schedule are ready.
    later_starts_s = (plan.starts - 1) * (
        _LATER_START_S + _PROCESS_START_S * len(plan.processes) + start_waits_s
    )
    # Rates up to the peak are unknown before the search, but their number is not.
    phases = {
        "load": _LOAD_S if "load" in plan.phases else 0.0,
        "preprocess": _PREPROCESS_S if "preprocess" in plan.phases else 0.0,
        "start": _HARNESS_START_S,
        "graph": _GRAPH_START_S + _PROCESS_START_S * len(plan.processes),
        "warm_up": start_waits_s,
        "search": _TYPICAL_SEARCH * _most_search_s(plan),
        # Only a play of its whole length shows that a rate is sustained.
        "sustained": len(plan.sustained_hz) * probe_s,
        "play": play_s + later_starts_s,
        "collect": _COLLECT_S,
    }
    phases = {name: seconds for name, seconds in phases.items() if seconds}
    # By order, a single lost answer lets a drain take its whole time.
    by_order = any(monitor.match == "order" for monitor in plan.monitors)
    drain_s = plan.drain_timeout.seconds if by_order else 0.0
    longest_play_s = sum(
        _play_s(play, most) + most * drain_s
        for play in plan.plays
        for most in [max(play.iterations, play.max_iterations)]
    )
    most_search_s = _most_search_s(plan)
    longest = sum(phases.values()) + longest_play_s - play_s
    longest += most_search_s - phases.get("search", 0.0)
    if plan.gate.confirm and plan.objectives and not plan.external:
        measured = longest_play_s + most_search_s + phases.get("sustained", 0.0)
        session_s = sum(phases.get(play, 0.0) for play in _SESSION_PHASES)
        longest += measured + session_s + later_starts_s
    if plan.gate.time_budget_ns:
        declared = sum(phases.values())
        longest = max(declared, min(longest, declared - play_s + plan.gate.time_budget_ns / 1e9))
    return TimeEstimate(phases, longest)


def estimate_pairs(plan: Plan, pairs: int | None = None) -> TimeEstimate:
    """Return the time that interleaved runs of a base and of the plan will take.

    Args:
        plan: of the head, with all iterations.
        pairs: how many; as many as the plan has iterations if None.
    """
    once = estimate_time(single_run_plan(plan))
    played = pairs or pair_count(plan)
    if plan.gate.time_budget_ns:
        played = max(1, min(played, int(plan.gate.time_budget_ns / 1e9 / (2 * once.seconds))))
    most = played + pairs_that_confirm(played) if _may_be_confirmed(plan) else played
    return TimeEstimate(once.phases, 2 * most * once.seconds, 2 * played)


BOTH_SIDES: Final = "both_sides"
"""The phase of a start of both sides."""


def estimate_turns(plan: Plan, starts: int, steps: int, *, base_alone: bool) -> TimeEstimate:
    """Return the time that starts of both sides, played by turns, will take.

    Args:
        plan: of the head, with all iterations.
        starts: the most of them.
        steps: of each side, at each rate, in each start, by turns.
        base_alone: whether the base is also played alone.
    """
    once = estimate_time(single_run_plan(plan)).phases
    loaded_s = once.get("load", 0.0) + once.get("preprocess", 0.0)
    turns_s = sum(steps / play.rate_hz + _SEGMENT_END_S for play in plan.plays if play.rate_hz)
    # The processes of both sides start at once, on the same cores.
    up_s = once.get("start", 0.0) + once.get("graph", 0.0)
    alone_s = once.get("play", 0.0) if base_alone else 0.0
    start_s = sum(once.values()) - loaded_s + up_s + turns_s + alone_s
    most = starts + pairs_that_confirm(starts) if _may_be_confirmed(plan) else starts
    once_s = _SIDES_START_S + loaded_s
    return TimeEstimate(
        {BOTH_SIDES: start_s},
        once_s + most * start_s,
        starts,
        min(starts, FIRST_LOOK_BY_TURNS),
        "starts of both sides",
        once_s,
    )


def _may_be_confirmed(plan: Plan) -> bool:
    return plan.gate.confirm and bool(plan.objectives)


def _play_s(play: PlayPlan, iterations: int) -> float:
    return iterations * (play.duration_ns / 1e9 + _SEGMENT_END_S)


def _most_search_s(plan: Plan) -> float:
    """After this time a search plays nothing but what its bracket needs."""
    search = plan.search
    if search is None or search.max_hz <= search.min_hz:
        return 0.0
    played_ns = SEARCH_PROBES * search.probe_ns + SEARCH_CONFIRMATIONS * search.confirm_ns
    return played_ns / 1e9
