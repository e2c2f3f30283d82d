"""Duplicate requirements."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, quote
from r2bspec.check.spec_requirements import LocatedRequirement


def _find(context: Context) -> Findings:
    first: dict[tuple[object, ...], LocatedRequirement] = {}
    for located in context.requirements:
        requirement = located.requirement
        normalized = "".join(requirement.text.split())
        key = (located.role, located.at, located.needs_rate, _when(context, located), normalized)
        other = first.setdefault(key, located)
        if other is not located:
            yield Finding(
                message=f"duplicate requirement {quote(requirement.text.strip())}",
                path=located.path,
                help="remove one of them",
                related=(Pointer("first required here", other.path),),
                suppressed_by={located.subject},
            )


def _when(context: Context, located: LocatedRequirement) -> str:
    """The conditions under which a requirement applies."""
    objective = context.spec.slos.get(located.objective)
    return "" if objective is None else repr((objective.when, objective.at_peak, objective.level))


RULE = Rule(code="R2B516", find=_find)
