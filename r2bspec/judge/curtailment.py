"""Whether the rest of a run can still change a failure: curtailed sampling.

A requirement can no longer be met if its verdict is FAIL on the iterations so far, and would also
be FAIL after all declared ones if the rest were ideal: no output lost, and every output as fast as
the fastest so far. To end such a rate early changes no verdict and costs no error probability: the
test of the full length would give the same answer, whatever the rest shows.

Only verdicts on single messages are curtailed: percentiles, shares and observed values. A mean over
iterations is not monotonic in this sense, because an ideal iteration also widens its interval.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.judge_samples import judge
from r2bspec.judge.methods.method_registry import Method
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.language.spec import Objective
from r2bspec.measure.samples import MonitorSamples, RunSamples, SegmentSamples

_CURTAILED: Final[frozenset[Method]] = frozenset({"exact binomial", "observation"})


def lost_requirements(
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy,
    declared: Mapping[float, int],
    verdict: Verdict | None = None,
) -> Iterator[RequirementVerdict]:
    """The requirements that no rest of the run can meet any more.

    Args:
        objectives: by name.
        samples: of the run so far.
        policy: of the plan.
        declared: the number of iterations by offered rate, with all that may be added.
        verdict: on the run so far, if it is known.
    """
    now = verdict if verdict is not None else judge(objectives, samples, policy)
    if not any(_is_lost(one) for one in now.requirements):
        return
    ideal = judge(objectives, with_ideal_rest(samples, declared), policy)
    for one, best in zip(now.requirements, ideal.requirements, strict=True):
        if _is_lost(one) and _is_lost(best):
            yield one


def _is_lost(one: RequirementVerdict) -> bool:
    return one.level == "error" and one.outcome == "fail" and one.method in _CURTAILED


def with_ideal_rest(samples: RunSamples, declared: Mapping[float, int]) -> RunSamples:
    """The run after all declared iterations, if those that are missing were ideal."""
    iterations = {}
    for rate, played in samples.iterations.items():
        missing = max(0, declared.get(rate, len(played)) - len(played))
        iterations[rate] = played
        if played and missing:
            iterations[rate] += (_ideal(played),) * missing
    return replace(samples, iterations=iterations)


def _ideal(played: tuple[SegmentSamples, ...]) -> SegmentSamples:
    """An iteration in which everything went as well as it ever did."""
    last = played[-1]
    return replace(
        last,
        monitors={
            name: _ideal_monitor([one.monitors[name] for one in played]) for name in last.monitors
        },
        surroundings=None,
    )


def _ideal_monitor(seen: list[MonitorSamples]) -> MonitorSamples:
    """Every expected output, each with the shortest time of its family."""
    last = seen[-1]
    expected = last.expected
    shortest = {
        family: min(
            (float(one.times[family].min()) for one in seen if one.times[family].size), default=0.0
        )
        for family in last.times
    }
    latency_ns = round(shortest["latency"] * 1e9)
    return replace(
        last,
        steps=replace(last.steps, received_ns=last.steps.published_ns + latency_ns),
        times={family: np.full(expected, value) for family, value in shortest.items()},
        answered=expected,
        received=expected,
        duplicates=0,
        reordered=0,
        unmatched=0,
        late=0,
        early=0,
        overdue=0,
        throughput_hz=max(one.throughput_hz for one in seen),
    )
