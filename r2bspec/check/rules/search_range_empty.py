"""Searches with an empty range."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule

_SEARCH = ("benchmark", "search")


def _find(context: Context) -> Findings:
    search = context.spec.benchmark.search
    if search is not None and search.min.hz >= search.max.hz:
        yield Finding(
            message=f"search range is empty: 'max' ({search.max}) is not above 'min' "
            f"({search.min})",
            path=(*_SEARCH, "max"),
            help="set 'max', the highest rate that is tried, above 'min'",
            related=(Pointer("the search begins here", (*_SEARCH, "min")),),
        )


RULE = Rule(code="R2B508", find=_find)
