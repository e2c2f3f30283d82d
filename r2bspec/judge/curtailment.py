"""Whether the rest of a run can still change a failure: curtailed sampling.

A requirement can no longer be met if its verdict is FAIL on the iterations so far, and would also
be FAIL after all declared ones, whatever the rest is. The test of the full length would give the
same answer, so that to end such a rate early changes no verdict and costs no error probability.

The rest lies between two extremes: every output arrives, as fast as the fastest so far; or as slow
as the slowest so far, or not at all. The extremes alone do not show it: where iterations and starts
differ, the variation between them leaves a verdict open, so that a rest that is far worse than what
was played can turn a FAIL into INCONCLUSIVE. A lower bound "mean less t standard errors" is concave
in the values of the remaining iterations. Its minimum is therefore in a corner, where each of them
is one of the two extremes, and these mixtures are judged, too: some bad iterations at the beginning
of the rest or at its end, which makes whole starts bad. They are not where even an ideal rest has
no output on the right side of the limit: no mixture has one either.

What was seen so far bounds the rest only as far as it shows how starts differ. So where several
starts are declared, the first one alone ends nothing but what was observed for good.

Only verdicts on single messages are curtailed: percentiles, shares and observed values
(`MethodTraits.curtails`). Of a mean it is not known how far an iteration can be from the others.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, Literal

import msgspec
import numpy as np

from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.judge_samples import judge
from r2bspec.judge.methods.method_registry import METHODS
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.language.spec import Objective
from r2bspec.measure.matching import NO_MATCH
from r2bspec.measure.samples import MonitorSamples, RunSamples, SegmentSamples, starts_of

Extreme = Literal["ideal", "slow", "lost", "instant", "endless"]
"""What an iteration of the rest can be: as good, or as bad, as it ever was; without outputs; with
all outputs at once; or with all after days."""

EXTREME_TIMES_S: Final[Mapping[Extreme, float]] = {"instant": 1e-9, "endless": 1e6}
"""The time of every output, where an extreme has one."""

RequirementKey = tuple[str, str, float | None, str | None]

_MIXTURES: Final = 10
"""So many numbers of bad iterations are tried, where the rest is longer."""


def lost_requirements(
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy,
    declared: Mapping[float, Sequence[int]],
    verdict: Verdict | None = None,
) -> Iterator[RequirementVerdict]:
    """The requirements that no rest of the run can meet any more.

    Args:
        objectives: by name.
        samples: of the run so far.
        policy: of the plan.
        declared: by offered rate, the start in which each iteration is played, with all iterations
            that may be added.
        verdict: on the run so far, if it is known.
    """
    now = verdict if verdict is not None else judge(objectives, samples, policy)
    lost = {
        requirement_key(one): one
        for one in now.requirements
        if _is_lost(one) and not _rests_on_first_start(one, samples, declared)
    }
    never_met: set[RequirementKey] = set()
    for number, rest in enumerate(_rests(samples, declared)):
        if not lost:
            return
        asked = {name: objectives[name] for name in {one.objective for one in lost.values()}}
        found = {
            requirement_key(one): one
            for one in judge(asked, rest, policy).requirements
            if _is_lost(one)
        }
        if number == 0:
            never_met = {key for key, one in found.items() if one.over == one.n}
        lost = {key: one for key, one in lost.items() if key in found or key in never_met}
    yield from lost.values()


def requirement_key(one: RequirementVerdict) -> RequirementKey:
    """What identifies a requirement among the verdicts of a run."""
    return one.objective, one.text, one.at_hz, one.monitor


def _is_lost(one: RequirementVerdict) -> bool:
    return one.level == "error" and one.outcome == "fail" and METHODS[one.method].curtails


def _rests_on_first_start(
    one: RequirementVerdict, samples: RunSamples, declared: Mapping[float, Sequence[int]]
) -> bool:
    """Whether a test has seen only the first of several starts; an observation needs no more."""
    return METHODS[one.method].grows and any(
        len(set(starts_of(played))) < 2 <= len(set(declared.get(rate, ())))
        for rate, played in samples.iterations.items()
        if one.at_hz is not None and math.isclose(rate, one.at_hz)
    )


def _rests(samples: RunSamples, declared: Mapping[float, Sequence[int]]) -> Iterator[RunSamples]:
    """The run with each rest that is tried, the ideal one first."""
    missing = max(
        (len(declared.get(rate, ())) - len(one) for rate, one in samples.iterations.items()),
        default=0,
    )
    if missing < 1:
        return
    yield with_rest(samples, declared, ())
    numbers = {round(each) for each in np.linspace(1, missing, min(missing, _MIXTURES))}
    for bad in sorted(numbers, reverse=True):
        for extreme in ("slow", "lost"):
            yield with_rest(samples, declared, (extreme,) * bad)
            if bad < missing:
                yield with_rest(samples, declared, ("ideal",) * (missing - bad), then=extreme)


def with_rest(
    samples: RunSamples,
    declared: Mapping[float, Sequence[int]],
    begins: Sequence[Extreme],
    then: Extreme = "ideal",
) -> RunSamples:
    """The run after all declared iterations.

    Args:
        samples: of the run so far.
        declared: as for `lost_requirements`.
        begins: what the first iterations of the rest are.
        then: what the others are.
    """
    iterations = {}
    for rate, played in samples.iterations.items():
        iterations[rate] = played
        starts = declared.get(rate, ())[len(played) :]
        if not played or not starts:
            continue
        made = {each: extreme_iteration(played, each) for each in {*begins, then}}
        kinds = (*begins[: len(starts)], *(then,) * (len(starts) - len(begins)))
        iterations[rate] += tuple(
            in_start(made[kind], start, number)
            for number, (kind, start) in enumerate(zip(kinds, starts, strict=True), start=1)
        )
    return replace(samples, iterations=iterations)


def in_start(made: SegmentSamples, start: int, number: int) -> SegmentSamples:
    """An iteration of the rest, which has an id of its own: no rerun takes its place."""
    segment = made.segment
    return replace(
        made,
        segment=msgspec.structs.replace(segment, id=f"{segment.id}-rest-{number}", start=start),
    )


def extreme_iteration(played: tuple[SegmentSamples, ...], extreme: Extreme) -> SegmentSamples:
    """An iteration in which everything went as an extreme says."""
    last = played[-1]
    return replace(
        last,
        monitors={
            name: _monitor([one.monitors[name] for one in played], extreme)
            for name in last.monitors
        },
        interference=None,
    )


def _monitor(seen: list[MonitorSamples], extreme: Extreme) -> MonitorSamples:
    """Every expected output, each with one time, such as the shortest of its family; or none."""
    last = seen[-1]
    pick = np.min if extreme == "ideal" else np.max
    known = {family: np.concatenate([one.times[family] for one in seen]) for family in last.times}
    limits = {family: float(pick(each)) if each.size else 0.0 for family, each in known.items()}
    if extreme in EXTREME_TIMES_S:
        limits = dict.fromkeys(limits, EXTREME_TIMES_S[extreme])
    arrived = 0 if extreme == "lost" else last.expected
    received_ns = last.steps.published_ns + round(limits.get("latency", 0.0) * 1e9)
    rates = [one.throughput_hz for one in seen]
    return replace(
        last,
        steps=replace(
            last.steps,
            received_ns=received_ns if arrived else np.full_like(received_ns, NO_MATCH),
        ),
        times={family: np.full(arrived, value) for family, value in limits.items()},
        answered=arrived,
        received=arrived,
        duplicates=0,
        reordered=0,
        unmatched=0,
        late=0,
        early=0,
        overdue=0,
        throughput_hz=(max(rates) if extreme in {"ideal", "instant"} else min(rates))
        if arrived
        else 0.0,
    )
