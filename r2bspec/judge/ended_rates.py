"""Ending a rate whose requirements can no longer be met, and the verdict on what was played of it.

A requirement can no longer be met if it passes with no rest of the run. With k of n messages over
the limit so far, the rests that are tried have a share x of messages that are, from 0 to k / n,
spread evenly, in every further iteration. x = 0 is not always the best: where the first iterations
have some, further ones without any show that iterations differ, which widens the bounds. These are
convex in the shares of the remaining iterations, and treat them alike, so that the best rest has
the same share in all of them. Messages over the limit are lost, late by days, or there at once (for
a lower limit). Iterations that host interference affected may be repeated, so that they count as
not yet played.

The verdict is the one that the rest could not have changed:

    FAIL            it fails on what was played, and with every rest (`r2bspec.judge.curtailment`)
    INCONCLUSIVE    no rest makes it pass, and some leave it open

A FAIL of the second kind would be wrong more often than stated: whether to go on was decided by
what was measured. Either way the run does not pass.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.affected_iterations import find_affected_iterations, without_affected
from r2bspec.judge.curtailment import (
    EXTREME_TIMES_S,
    Extreme,
    extreme_iteration,
    in_start,
    lost_requirements,
    requirement_key,
)
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.judge_samples import judge
from r2bspec.judge.methods.method_registry import METHODS
from r2bspec.judge.outcome import outcome_of
from r2bspec.judge.verdict import EXIT_CODES, RequirementVerdict, Verdict
from r2bspec.language.spec import Objective
from r2bspec.measure.matching import NO_MATCH
from r2bspec.measure.samples import MonitorSamples, RunSamples, SegmentSamples

_OPEN = (
    "It fails on what was played. The rate was ended early: no rest could have made it pass, and "
    "some would have left it open."
)
_REMEDY = "Run without --abort-on-fail."

_KINDS: Final[tuple[tuple[Extreme | None, Extreme], ...]] = (
    (None, "endless"),
    ("instant", "endless"),
    (None, "lost"),
    ("instant", "lost"),
    (None, "instant"),
    ("endless", "instant"),
)
"""What the messages within a limit are (None: as those were that were within it), and those over
it. Iterations that do not differ from those that were played make bounds the narrowest."""

_PARTS: Final = tuple(each / 20 for each in range(21))
"""Of the share of messages over the limit so far."""


def unreachable_requirements(
    objectives: Mapping[str, Objective], samples: RunSamples, policy: DecisionPolicy
) -> Iterator[RequirementVerdict]:
    """The requirements that no rest of the run can make pass.

    Where an inconclusive verdict counts as a PASS, only a FAIL that no rest can change is one.

    Args:
        objectives: by name.
        samples: of the run so far.
        policy: of the plan, with all iterations that it declares.
    """
    now = judge(objectives, samples, policy)
    if policy.inconclusive == "pass":
        yield from lost_requirements(objectives, samples, policy, policy.declared, now)
        return
    known = _unaffected(samples, policy)
    left = {
        requirement_key(one): one
        for one in now.requirements
        if _is_open(one, known) and not _is_unusable(one, now)
    }
    most = max((one.over / one.n for one in left.values() if one.over and one.n), default=0.0)
    for good, bad in _KINDS:
        for share in (most * part for part in _PARTS):
            if not left:
                return
            rest = _with_share(known, policy.declared, good, bad, share=share, most=most)
            asked = {name: objectives[name] for name in {one.objective for one in left.values()}}
            for one in judge(asked, rest, policy).requirements:
                if one.outcome == "pass":
                    left.pop(requirement_key(one), None)
    yield from left.values()


def _with_share(
    samples: RunSamples,
    declared: Mapping[float, Sequence[int]],
    good: Extreme | None,
    bad: Extreme,
    *,
    share: float,
    most: float,
) -> RunSamples:
    """The run after all declared iterations, where a share of each further one is bad.

    Args:
        samples: of the run so far.
        declared: as in `DecisionPolicy`.
        good: what the others are.
        bad: what these are.
        share: from 0 to 1.
        most: the share that is bad in what was played.
    """
    iterations = dict(samples.iterations)
    for rate, played in samples.iterations.items():
        starts = declared.get(rate, ())[len(played) :]
        if not played or not starts:
            continue
        made = [
            extreme_iteration(played, good)
            if good is not None
            else _repaired(each, most, largest=bad != "instant")
            for each in played
        ]
        iterations[rate] = played + tuple(
            in_start(_spoiled(made[number % len(made)], bad, share, number), start, number)
            for number, start in enumerate(starts, start=1)
        )
    return replace(samples, iterations=iterations)


def _repaired(one: SegmentSamples, share: float, *, largest: bool) -> SegmentSamples:
    """An iteration whose worst messages, a share of all, are as its others were."""
    return replace(
        one,
        monitors={
            name: _repaired_monitor(seen, share, largest=largest)
            for name, seen in one.monitors.items()
        },
        interference=None,
    )


def _repaired_monitor(seen: MonitorSamples, share: float, *, largest: bool) -> MonitorSamples:
    steps = seen.steps
    late_ns = (steps.received_ns - steps.published_ns).astype(np.float64)
    late_ns[~steps.answered] = np.nan
    repaired_ns = _without_worst(late_ns, steps.received_ns.size, share, largest=largest)
    return replace(
        seen,
        steps=replace(steps, received_ns=steps.published_ns + repaired_ns.astype(np.int64)),
        times={
            family: _without_worst(each, seen.expected, share, largest=largest)
            for family, each in seen.times.items()
        },
        answered=seen.expected,
        received=seen.expected,
        duplicates=0,
        reordered=0,
        unmatched=0,
        late=0,
        early=0,
        overdue=0,
    )


def _without_worst(
    values: NDArray[np.float64], size: int, share: float, *, largest: bool
) -> NDArray[np.float64]:
    """So many values; the worst, and those that are not there, are the median of the others."""
    made = np.full(size, np.nan)
    made[: min(size, values.size)] = values[:size]
    known = np.flatnonzero(np.isfinite(made))
    order = known[np.argsort(made[known], kind="stable")]
    worst = math.ceil(share * order.size)
    if worst:
        made[order[-worst:] if largest else order[:worst]] = np.nan
    left = made[np.isfinite(made)]
    made[~np.isfinite(made)] = np.median(left) if left.size else 1e-9
    return made


def _spoiled(one: SegmentSamples, bad: Extreme, share: float, number: int) -> SegmentSamples:
    """An iteration of which a share is bad; over several, rounding does not change the share."""
    return replace(
        one,
        monitors={
            name: _spoiled_monitor(seen, bad, share, number) for name, seen in one.monitors.items()
        },
    )


def _spoiled_monitor(
    seen: MonitorSamples, bad: Extreme, share: float, number: int
) -> MonitorSamples:
    count = round(number * share * seen.expected) - round((number - 1) * share * seen.expected)
    received_ns = seen.steps.received_ns.copy()
    steps = _spread(received_ns.size, count)
    times = {family: values.copy() for family, values in seen.times.items()}
    if bad == "lost":
        received_ns[steps] = NO_MATCH
        times = {name: np.delete(each, _spread(each.size, count)) for name, each in times.items()}
    else:
        received_ns[steps] = seen.steps.published_ns[steps] + round(EXTREME_TIMES_S[bad] * 1e9)
        for each in times.values():
            each[_spread(each.size, count)] = EXTREME_TIMES_S[bad]
    arrived = seen.answered - (count if bad == "lost" else 0)
    return replace(
        seen,
        steps=replace(seen.steps, received_ns=received_ns),
        times=times,
        answered=arrived,
        received=arrived,
    )


def _spread(size: int, count: int) -> NDArray[np.int64]:
    """So many places, evenly spread."""
    if not size or not count:
        return np.empty(0, np.int64)
    return ((np.arange(min(count, size)) + 0.5) * size / min(count, size)).astype(np.int64)


def _unaffected(samples: RunSamples, policy: DecisionPolicy) -> RunSamples:
    if policy.interference == "tolerate":
        return samples
    disturbed = find_affected_iterations(samples)
    return without_affected(samples, disturbed) if disturbed else samples


def _is_open(one: RequirementVerdict, known: RunSamples) -> bool:
    """Whether a requirement may end its rate: some iterations at it are known to be unaffected."""
    return (
        one.level == "error"
        and one.outcome != "pass"
        and METHODS[one.method].curtails
        and one.at_hz is not None
        and any(
            math.isclose(rate, one.at_hz) and bool(played)
            for rate, played in known.iterations.items()
        )
    )


def _is_unusable(one: RequirementVerdict, verdict: Verdict) -> bool:
    """Whether nothing can be judged at its rate, which says nothing about the graph."""
    return any(
        one.at_hz is not None and math.isclose(each.offered_hz, one.at_hz)
        for each in verdict.unusable
    )


def weaken_ended(
    verdict: Verdict,
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy,
) -> Verdict:
    """The verdict on a run of which rates were ended: a FAIL is open if a rest could leave it open.

    Args:
        verdict: on what was played.
        objectives: by name.
        samples: of the run.
        policy: of the plan.
    """
    ended = [each.rate_hz for each in samples.record.ended_rates]
    if not ended or verdict.outcome != "fail":
        return verdict
    lost = {
        requirement_key(one)
        for one in lost_requirements(objectives, samples, policy, policy.declared, verdict)
    }
    requirements = tuple(
        msgspec.structs.replace(
            one, outcome="inconclusive", notes=(*one.notes, _OPEN), remedy=_REMEDY
        )
        if _ended_open(one, ended) and requirement_key(one) not in lost
        else one
        for one in verdict.requirements
    )
    outcome, reason = outcome_of(requirements, policy.inconclusive, verdict.starts)
    return msgspec.structs.replace(
        verdict,
        outcome=outcome,
        exit_code=EXIT_CODES[outcome],
        reason=reason,
        requirements=requirements,
    )


def _ended_open(one: RequirementVerdict, ended: Sequence[float]) -> bool:
    return (
        one.outcome == "fail"
        and METHODS[one.method].curtails
        and one.at_hz is not None
        and any(math.isclose(rate, one.at_hz) for rate in ended)
    )
