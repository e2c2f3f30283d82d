"""Searches that play the lower end of the result for a shorter time than a probe."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule

_SEARCH = ("benchmark", "search")


def _find(context: Context) -> Findings:
    search = context.spec.benchmark.search
    if search is not None and 0 < search.confirm.ns < search.probe.ns:
        yield Finding(
            message=f"'confirm' ({search.confirm}) is shorter than 'probe' ({search.probe}), so it "
            "shows less than the probes do",
            path=(*_SEARCH, "confirm"),
            help="make it longer than a probe, or write 'confirm: 0 s' to play no rate whole",
            related=(Pointer("a probe lasts up to this", (*_SEARCH, "probe")),),
        )


RULE = Rule(code="R2B532", find=_find)
