"""Requirements on the peak outside the range of the search."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    known_metrics,
    quote,
)

_SEARCH = ("benchmark", "search")


def _find(context: Context) -> Findings:
    search = context.spec.benchmark.search
    if search is None or search.min.hz >= search.max.hz:
        return
    for each in known_metrics(context):
        bound = each.located.requirement.bound
        if each.info.statistic != "search" or bound is None or bound.dimension != "rate":
            continue
        if search.min.hz < bound.value <= search.max.hz:
            continue
        end = "max" if bound.value > search.max.hz else "min"
        limit = search.max if end == "max" else search.min
        yield Finding(
            message=f"a search from {search.min} to {search.max} cannot decide "
            f"{quote(each.located.requirement.text)}",
            path=each.located.path,
            part=each.located.bound_part,
            help=f"set {quote(end)} of the search {'above' if end == 'max' else 'below'} "
            f"{bound.value:g} Hz",
            related=(
                Pointer(
                    f"the search {'ends' if end == 'max' else 'begins'} at {limit}", (*_SEARCH, end)
                ),
            ),
            suppressed_by={each.located.subject},
        )


RULE = Rule(code="R2B507", find=_find)
