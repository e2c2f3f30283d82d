"""Objectives whose condition no declared value meets."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, suggestion
from r2bspec.language.located_tree import ListNode, to_plain


def _find(context: Context) -> Findings:
    for name, objective in context.spec.slos.items():
        for variable, value in objective.when.items():
            allowed = _values(context, variable)
            if allowed and str(value) not in allowed:
                yield Finding(
                    message=f"{quote(variable)} is never {value}, so objective {quote(name)} never "
                    "applies",
                    path=("slos", name, "when", variable),
                    help=suggestion(str(value), allowed, "possible values"),
                )


def _values(context: Context, variable: str) -> list[str]:
    """All values that a variable may have; empty if the document does not list them."""
    for path in (("variables", variable, "choices"), ("matrix", "axes", variable)):
        listed_here = context.value_at(path)
        if isinstance(listed_here, ListNode):
            return [str(to_plain(each)) for each in listed_here.items]
    return []


RULE = Rule(code="R2B518", find=_find)
