"""Searches that play the lower end of the result for a shorter time than a probe."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, example

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


RULE = Rule(
    code="R2B532",
    title="peak confirmed by less than a probe",
    severity="warning",
    why="The lower end of the result is played whole, because a graph can be faster for some "
    "seconds than it is in the long run. That shows nothing new if it is shorter than a probe.",
    failing=example(
        benchmark="{rates: [30 Hz], search: {min: 5 Hz, max: 90 Hz, probe: 20 s, confirm: 5 s}}"
    ),
    passing=example(
        benchmark="{rates: [30 Hz], search: {min: 5 Hz, max: 90 Hz, probe: 5 s, confirm: 20 s}}"
    ),
    find=_find,
)
