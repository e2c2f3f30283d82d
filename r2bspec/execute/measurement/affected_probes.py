"""Probes that other programs disturbed: noticed, played again, or kept out of the result.

Whether a rate is sustained is decided as a probe ends. If others used the machine meanwhile, a rate
that was sustained is sustained all the same: the graph did more in the same time. A rate that was
not, or that stayed undecided, says nothing about the graph if the interference can explain it:

    the output rate + w x the offered rate  >=  (1 - precision) x the offered rate

with w the largest share of the time that others can have taken (`r2bspec.judge.waiting_bound`).
What comes out of an overloaded graph bounds its capacity only if w is at most half the precision.
Such a probe is played again. If it is disturbed again, the search uses it to aim, but not as a
bound (`r2bspec.execute.measurement.peak_search.unexplained_end`). On a machine that is always busy
that would double every search, so after `MAX_FUTILE_REPLAYS` that were disturbed again there are
no more in a session.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final, Literal

import msgspec

from r2bspec.execute.host.resource_sampler import Interference
from r2bspec.execute.measurement.peak_search import ProbeOutcome
from r2bspec.execute.measurement.time_budget import TimeBudget
from r2bspec.record.run_record import Probe, Segment

MAX_FUTILE_REPLAYS: Final = 2


class AffectedProbes:
    """Plays probes, and again what others disturbed."""

    def __init__(
        self,
        policy: Literal["tolerate", "note", "strict"],
        precision: float,
        last_segment: Callable[[], Segment],
        interference: Callable[[int, int], Interference],
        budget: TimeBudget,
        note: Callable[[str], None],
    ) -> None:
        """Nothing is played yet.

        Args:
            policy: ``gate.interference``; with ``tolerate``, interference explains nothing.
            precision: of the search.
            last_segment: the segment that was played last.
            interference: what others did between two times; see `HostWatch.between`.
            budget: of the run; without time left, nothing is played again.
            note: receives a note about each probe that is played again.
        """
        self._policy = policy
        self._precision = precision
        self._last_segment = last_segment
        self._interference = interference
        self._budget = budget
        self._note = note
        self._futile = 0

    def play(self, probe: Callable[[], ProbeOutcome]) -> ProbeOutcome:
        """Play a probe, and once more if others disturbed it and that can explain its outcome."""
        first = self._with_interference(probe())
        if not self._wants_replay(first):
            return first
        reasons = ", ".join(first.probe.disturbed)
        self._note(f"host interference in {first.probe.segment} ({reasons}): repeating it")
        again = self._with_interference(probe())
        if again.probe.explained:
            self._futile += 1
        rerun = msgspec.structs.replace(again.probe, rerun_of=first.probe.segment)
        return replace(again, probe=rerun)

    def _wants_replay(self, outcome: ProbeOutcome) -> bool:
        found = outcome.probe
        if not found.explained or self._futile >= MAX_FUTILE_REPLAYS:
            return False
        segment = self._last_segment()
        seconds = (segment.ended_ns - segment.began_ns) / 1e9
        return self._budget.allows(
            f"no rerun of {found.segment}, which host interference affected", seconds
        )

    def _with_interference(self, outcome: ProbeOutcome) -> ProbeOutcome:
        """An outcome whose probe says what others did meanwhile, and whether that explains it."""
        segment = self._last_segment()
        found = self._interference(segment.began_ns, segment.ended_ns)
        one = msgspec.structs.replace(outcome.probe, by_player=outcome.limited_by_player)
        if found.reasons:
            one = msgspec.structs.replace(
                one,
                disturbed=found.reasons,
                taken=0.0 if self._policy == "tolerate" else found.taken,
                explained=self._policy != "tolerate"
                and one.holds is not True
                and self._can_explain(one, found.taken),
            )
        return replace(outcome, probe=one)

    def _can_explain(self, probe: Probe, taken: float) -> bool:
        if probe.purpose == "saturation":
            return taken > self._precision / 2
        possible_hz = probe.delivered_hz + taken * probe.rate_hz
        return possible_hz >= (1 - self._precision) * probe.rate_hz
