"""Objectives at rates above the range of the search."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, quote


def _find(context: Context) -> Findings:
    search = context.spec.benchmark.search
    if search is None or search.min.hz >= search.max.hz:
        return
    for name, objective in context.spec.slos.items():
        if objective.at is not None and objective.at.hz > search.max.hz:
            yield Finding(
                message=f"objective {quote(name)} applies at {objective.at}, but the search ends "
                f"at {search.max}",
                path=("slos", name, "at"),
                help=f"set 'max' of the search to {objective.at} or more",
                related=(Pointer("the search ends here", ("benchmark", "search", "max")),),
            )


RULE = Rule(code="R2B517", find=_find)
