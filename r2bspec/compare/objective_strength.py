"""Which requirements of a base are implied by the requirements of a head.

Objectives are compared by their content, so that their names do not matter. A requirement of the
base with level ``error`` is implied by one of the head with

- the same metric of the same monitor, at the same rate,
- a bound that admits no value that the base's bound excludes,
- the same windows, and at least the same share of them,
- level ``error``,
- no condition in ``when`` that the base's does not have, and active if the base's is active,
- at least the same confidence.

A requirement on all monitors is a requirement on each of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from r2bspec.compare.gate_change import GateChange, spec_of
from r2bspec.judge.measure.metric_catalogue import MetricError, Subjects, resolve
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.spec import Objective
from r2bspec.plan.prepared_benchmark import PreparedBenchmark


@dataclass(frozen=True)
class _Demand:
    """One requirement on one monitor, with everything that its effect depends on.

    Attributes:
        subject: the monitor by its name in the head, empty if it is of none, and the metric.
        confidence: that applies: the objective's own, or that of the gate.
        active: whether the plan has its objective.
    """

    name: str
    index: int
    requirement: Requirement
    objective: Objective
    subject: tuple[str, str]
    confidence: float
    active: bool

    @property
    def at(self) -> tuple[float | None, bool]:
        """The rate in hertz, and whether it is the highest one that the search finds."""
        return (self.objective.at.hz if self.objective.at else None, self.objective.at_peak)

    @property
    def kind(self) -> tuple[int, bool, bool]:
        """The length of its windows, and what its bound is relative to."""
        bound = self.requirement.bound
        if bound is None:
            return (0, False, False)
        return (self.requirement.window_ns, bound.of_offered, bound.of_baseline)

    @property
    def conditions(self) -> frozenset[tuple[str, str]]:
        """The conditions under which it applies."""
        return frozenset((key, str(value)) for key, value in self.objective.when.items())

    @property
    def text(self) -> str:
        """The requirement with what is unusual about it."""
        objective = self.objective
        parts = [" ".join(self.requirement.text.split())]
        if objective.at is not None:
            parts[0] += f" at {objective.at}"
        elif objective.at_peak:
            parts[0] += " at the peak rate"
        if objective.level != "error":
            parts.append(f"level {objective.level}")
        if objective.when:
            conditions = (f"{key}={value}" for key, value in sorted(self.conditions))
            parts.append(f"when {', '.join(conditions)}")
        if objective.confidence is not None:
            parts.append(f"confidence {objective.confidence}")
        if not self.active and objective.level != "off":
            parts.append("not active")
        return ", ".join(parts)


def objective_changes(
    base: PreparedBenchmark, head: PreparedBenchmark, monitors: Mapping[str, str]
) -> Iterator[GateChange]:
    """Requirements of one side that the other side does not imply.

    Args:
        base: to compare with.
        head: that is compared.
        monitors: the name in the head of each monitor of the base that the head still has.
    """
    before = list(_demands(base, monitors))
    after = list(_demands(head, {monitor.name: monitor.name for monitor in head.plan.monitors}))
    for demand in before:
        closest = _closest(demand, after)
        if demand.objective.level == "error" and _shortfalls(demand, closest):
            path = _path(demand, closest)
            yield GateChange(
                f"objective {demand.name}", path, demand.text, _text(closest), weaker=True
            )
    for demand in after:
        closest = _closest(demand, before)
        if demand.objective.level == "error" and _shortfalls(demand, closest):
            path = ("slos", demand.name, "require", demand.index)
            yield GateChange(
                f"objective {demand.name}", path, _text(closest), demand.text, weaker=False
            )


def implies(stronger: Requirement, weaker: Requirement) -> bool:
    """Whether what meets a requirement meets another one on the same metric."""
    if weaker.op is None or stronger.op is None:
        return weaker.op == stronger.op
    if stronger.window_ns != weaker.window_ns:
        return False
    return (stronger.windows_share or 0) >= (weaker.windows_share or 0) and _bound_implies(
        stronger, weaker
    )


def _bound_implies(stronger: Requirement, weaker: Requirement) -> bool:
    """Whether no value meets the stronger bound without meeting the weaker one."""
    tight, loose = stronger.bound, weaker.bound
    if tight is None or loose is None:
        return tight == loose
    if (tight.dimension, tight.of_offered, tight.of_baseline) != (
        loose.dimension,
        loose.of_offered,
        loose.of_baseline,
    ):
        return False
    # Values that meet the stronger bound are below, at or above that of the weaker one.
    below = tight.value < loose.value or stronger.op == "<"
    above = tight.value > loose.value or stronger.op == ">"
    at_most = stronger.op in {"<", "<=", "=="} and tight.value <= loose.value
    at_least = stronger.op in {">", ">=", "=="} and tight.value >= loose.value
    match weaker.op:
        case "<":
            return at_most and below
        case "<=":
            return at_most
        case ">":
            return at_least and above
        case ">=":
            return at_least
        case "==":
            return stronger.op == "==" and tight.value == loose.value
    same = stronger.op == "!=" and tight.value == loose.value
    return same or (at_most and below) or (at_least and above)


def _demands(side: PreparedBenchmark, monitors: Mapping[str, str]) -> Iterator[_Demand]:
    """Every requirement of every objective, for each monitor that it is about."""
    spec = spec_of(side)
    objectives = spec.slos if spec is not None else side.plan.objectives
    for name, objective in objectives.items():
        confidence = side.plan.gate.confidence
        if objective.confidence is not None:
            confidence = objective.confidence.fraction
        for index, requirement in enumerate(objective.require):
            for subject in subjects(requirement, side, monitors):
                active = name in side.plan.objectives
                yield _Demand(name, index, requirement, objective, subject, confidence, active)


def subjects(
    requirement: Requirement, side: PreparedBenchmark, monitors: Mapping[str, str]
) -> list[tuple[str, str]]:
    """The monitors and the metric that a requirement is about.

    Monitors have the names of the head. A requirement on all of them is about those that the head
    still has: a monitor that is gone is a difference of its own.
    """
    names = [monitor_plan.name for monitor_plan in side.plan.monitors]
    try:
        monitor, metric = resolve(requirement.metric, names, Subjects.of_plan(side.plan))
    except MetricError:
        return [("", requirement.metric)]
    if metric.scope != "monitor":
        return [("", metric.name)]
    if monitor is not None:
        return [(monitors.get(monitor, monitor), metric.name)]
    left = [monitors[name] for name in names if name in monitors]
    return [(name, metric.name) for name in left or names]


def _closest(demand: _Demand, others: Sequence[_Demand]) -> _Demand | None:
    """The requirement of the other side that falls short of another one least, if there is one.

    One at another rate, or of another kind, in an objective with another name is about something
    else.
    """
    candidates = [
        other
        for other in others
        if other.subject == demand.subject
        and (other.name == demand.name or (other.at, other.kind) == (demand.at, demand.kind))
    ]
    return min(
        candidates,
        key=lambda other: (len(_shortfalls(demand, other)), other.name != demand.name),
        default=None,
    )


def _shortfalls(demand: _Demand, other: _Demand | None) -> tuple[str, ...]:
    """The keys by which another requirement does not imply this one; empty if it does."""
    if other is None:
        return ("require",)
    own_confidence = demand.objective.confidence or other.objective.confidence
    keys = {
        "require": not implies(other.requirement, demand.requirement),
        "at": other.at != demand.at,
        "level": other.objective.level != "error",
        "when": not other.conditions <= demand.conditions or (demand.active and not other.active),
        # Without one of its own it is that of the gate, which is compared as such.
        "confidence": own_confidence is not None and other.confidence < demand.confidence,
    }
    return tuple(key for key, falls_short in keys.items() if falls_short)


def _path(demand: _Demand, closest: _Demand | None) -> tuple[str | int, ...]:
    """The place in the head of what makes a requirement of the base weaker."""
    if closest is None:
        return ("slos", demand.name)
    key = _shortfalls(demand, closest)[0]
    index = (closest.index,) if key == "require" else ()
    return ("slos", closest.name, key, *index)


def _text(demand: _Demand | None) -> str:
    return demand.text if demand is not None else ""
