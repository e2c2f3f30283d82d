"""Bounds that everything obeys, or nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding
from r2bspec.check.requirement_metrics import Known, known_metrics
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.diagnostics.quote import quote

_SIGNED = frozenset({"latency", "latency_from_due"})


def _find(context: Context) -> Iterator[Finding]:
    for each in known_metrics(context):
        requirement = each.placed.requirement
        if requirement.bound is None or requirement.bound.of_baseline:
            continue
        outcome = _outcome(each)
        if outcome is not None:
            yield Finding(
                message=f"nothing can fail {quote(requirement.text)}"
                if outcome
                else f"nothing can pass {quote(requirement.text)}",
                path=each.placed.path,
                part=each.placed.bound_part,
                help="it lies between 0 % and 100 %"
                if each.info.name == "drop_rate"
                else "it is never less than 0",
                severity=Severity.WARNING if outcome else Severity.ERROR,
                about=frozenset({each.placed.subject}),
            )


def _at(each: Known) -> float:
    bound = each.placed.requirement.bound
    return 0.0 if bound is None else bound.value


def _outcome(each: Known) -> bool | None:
    """What always comes out; None if that depends on the run."""
    if each.info.family in _SIGNED and each.info.statistic == "mean":
        return None
    op, value = each.placed.requirement.op, _at(each)
    # Processor time of several cores adds up to more than one.
    most = 1.0 if each.info.name == "drop_rate" else math.inf
    if (op == ">=" and value <= 0) or (op == ">" and value < 0):
        return True
    if (op == "<=" and value >= most) or (op == "<" and value > most):
        return True
    if (op == "<" and value <= 0) or (op in {"<=", "=="} and value < 0):
        return False
    if (op == ">" and value >= most) or (op in {">=", "=="} and value > most):
        return False
    return None


RULE = Rule(
    code="R2B515",
    title="a bound that nothing can fail, or nothing can pass",
    severity=Severity.WARNING,
    why="It looks as if something were guarded. A bound that nothing can pass is an error.",
    failing=example(slos="{fast: {at: 30 Hz, require: [drop_rate <= 100 %]}}"),
    passing=example(slos="{fast: {at: 30 Hz, require: [drop_rate <= 5 %]}}"),
    find=_find,
)
