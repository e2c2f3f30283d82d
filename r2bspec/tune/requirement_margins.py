"""How far the requirements of a run are from their limits."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.language.spec import Objective
from r2bspec.tune.tuning_result import MAX_EXCESS, RequirementMargin


def margins_of(
    requirements: Sequence[RequirementVerdict], objectives: Mapping[str, Objective]
) -> tuple[RequirementMargin, ...]:
    """How far each requirement that counts is from its limit; those of a baseline are left out."""
    written = {
        (name, requirement.text): requirement
        for name, objective in objectives.items()
        for requirement in objective.require
    }
    several = len({one.at_hz for one in requirements}) > 1
    times = Counter((one.text, one.at_hz) for one in requirements)
    found = []
    for one in requirements:
        requirement = written.get((one.objective, one.text))
        of_baseline = (
            requirement is not None
            and requirement.bound is not None
            and requirement.bound.of_baseline
        )
        if one.level != "error" or requirement is None or of_baseline:
            continue
        text = f"{one.text} at {one.at_hz:g} Hz" if several and one.at_hz else one.text
        if one.monitor and times[one.text, one.at_hz] > 1:
            text = f"{one.monitor}.{text}"
        found.append(
            RequirementMargin(
                text=text,
                outcome=one.outcome,
                estimate=one.estimate,
                limit=one.limit,
                unit=one.unit,
                excess=_excess(one, requirement),
            )
        )
    return tuple(found)


def _excess(one: RequirementVerdict, requirement: Requirement) -> float:
    """By how much a requirement is missed; see `RequirementMargin`."""
    missed = MAX_EXCESS if one.outcome == "fail" else 0.0
    if one.lost:
        return MAX_EXCESS
    if one.estimate is None or one.limit is None or requirement.op in {None, "==", "!="}:
        return missed
    over = (one.estimate, one.limit)
    above, below = over if requirement.op in {"<", "<="} else over[::-1]
    if above <= 0 < below:
        return -MAX_EXCESS
    if below <= 0:
        # No ratio to nothing: of a share that must be 0 each percent counts as such.
        return min(MAX_EXCESS, max(0.0, above - below))
    return max(-MAX_EXCESS, min(MAX_EXCESS, math.log(above / below)))
