"""How long a run or a comparison will take, from its plan alone: an estimate for people who wait.

What the plan declares is exact: iterations and warm-up. A search ends as soon as it can. What the
plan does not know, such as the start of processes, is a typical value. Nothing is decided by these
numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from r2bspec.diagnostics.quote import time_text
from r2bspec.language.benchmark_defaults import PROBE, SEARCH_CONFIRMATIONS, SEARCH_PROBES
from r2bspec.language.spec import StartWaits
from r2bspec.plan.comparability import pair_count, single_run_plan, without_overhead
from r2bspec.plan.plan import Plan, PlayPlan

_LOAD_S = 0.5
_PREPROCESS_S = 10.0
_HARNESS_START_S = 0.5
_HARNESS_OVERHEAD_S = 1.5
_GRAPH_START_S = 0.8
_PROCESS_START_S = 0.3
_COLLECT_S = 1.0
_LATER_START_S = 1.0
_SEGMENT_END_S = 0.2
"""Typical times."""

_TYPICAL_SEARCH = 0.5
"""Of the time that a search may take (the median of simulated ones: 0.3 to 0.7)."""

_SESSION_PHASES = ("start", "harness_overhead", "graph", "warm_up")


@dataclass(frozen=True)
class TimeEstimate:
    """The expected time of a run, or of the runs of a comparison.

    Attributes:
        phases: seconds by phase of one run, in its order; later starts are a part of ``play``.
        at_most_s: of all runs, with all additional iterations and the confirmation that the plan
            allows.
        runs: how many are made one after the other: two for each pair of a comparison.
    """

    phases: Mapping[str, float]
    at_most_s: float
    runs: int = 1

    @property
    def run_s(self) -> float:
        """The time of one run: of everything that is played in any case."""
        return sum(self.phases.values())

    @property
    def seconds(self) -> float:
        """The time of all runs."""
        return self.runs * self.run_s

    def text(self) -> str:
        """The estimate in words: ``about 40 s, up to 2 min``, ``about 3 min, 10 runs``."""
        expected, longest = time_text(self.seconds), time_text(self.at_most_s)
        at_most = f", up to {longest}" if longest != expected else ""
        return f"about {expected}{at_most}" + (f", {self.runs} runs" if self.runs > 1 else "")


def estimate_time(plan: Plan) -> TimeEstimate:
    """The time that a run of the plan will take."""
    play_s = sum(_play_s(play, play.iterations) for play in plan.plays)
    probe_s = plan.search.probe_ns / 1e9 if plan.search is not None else PROBE.seconds
    start_waits_s = sum(wait.seconds for wait in StartWaits.fields_of(plan).values())
    # Data and schedule are ready, and the harness overhead is known.
    later_starts_s = (plan.starts - 1) * (
        _LATER_START_S + _PROCESS_START_S * len(plan.processes) + start_waits_s
    )
    # Rates up to the peak are unknown before the search, but their number is not.
    phases = {
        "load": _LOAD_S if "load" in plan.phases else 0.0,
        "preprocess": _PREPROCESS_S if "preprocess" in plan.phases else 0.0,
        "start": _HARNESS_START_S,
        "harness_overhead": _HARNESS_OVERHEAD_S if "harness_overhead" in plan.phases else 0.0,
        "graph": _GRAPH_START_S + _PROCESS_START_S * len(plan.processes),
        "warm_up": start_waits_s,
        "search": _TYPICAL_SEARCH * _most_search_s(plan),
        # Only a play of its whole length shows that a rate is sustained.
        "sustained": len(plan.sustained_hz) * probe_s,
        "play": play_s + later_starts_s,
        "collect": _COLLECT_S,
    }
    phases = {name: seconds for name, seconds in phases.items() if seconds}
    longest_play_s = sum(
        _play_s(play, max(play.iterations, play.max_iterations)) for play in plan.plays
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
    """The time that interleaved runs of a base and of the plan will take.

    Args:
        plan: of the head, with all iterations.
        pairs: how many; as many as the plan has iterations if None.
    """
    once = estimate_time(without_overhead(single_run_plan(plan)))
    played = pairs or pair_count(plan)
    if plan.gate.time_budget_ns:
        played = max(1, min(played, int(plan.gate.time_budget_ns / 1e9 / (2 * once.seconds))))
    expected_s = 2 * played * once.seconds
    # A comparison that failed is confirmed by as many new pairs.
    confirmed = plan.gate.confirm and bool(plan.objectives)
    return TimeEstimate(once.phases, expected_s * (2 if confirmed else 1), runs=2 * played)


def _play_s(play: PlayPlan, iterations: int) -> float:
    return iterations * (play.duration_ns / 1e9 + _SEGMENT_END_S)


def _most_search_s(plan: Plan) -> float:
    """After this time a search plays nothing but what its bracket needs."""
    search = plan.search
    if search is None or search.max_hz <= search.min_hz:
        return 0.0
    played_ns = SEARCH_PROBES * search.probe_ns + SEARCH_CONFIRMATIONS * search.confirm_ns
    return played_ns / 1e9
