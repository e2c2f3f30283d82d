"""Bounds in a unit that the metric does not have."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, known_metrics, quote

_EXAMPLES = {
    "time": "a time, such as 50 ms",
    "rate": "a rate, such as 30 Hz, or a share of the offered one, such as 97 % of offered",
    "size": "a size, such as 64 MiB",
    "share": "a share, such as 2 %",
    "count": "a whole number",
}


def _find(context: Context) -> Findings:
    for each in known_metrics(context):
        bound = each.located.requirement.bound
        if bound is not None and not each.info.accepts(bound):
            given = (
                "relative"
                if bound.of_baseline
                else "a rate"
                if bound.of_offered
                else _EXAMPLES[bound.dimension].partition(",")[0]
            )
            yield Finding(
                message=f"{quote(each.info.name)} is not {given}",
                path=each.located.path,
                part=each.located.bound_part,
                help=f"its bound is {_EXAMPLES[each.info.dimension]}",
                suppresses={each.located.subject},
            )


RULE = Rule(
    code="R2B502",
    title="a bound of the wrong dimension",
    severity="error",
    why="A time cannot be compared with a rate, nor a share with a count.",
    failing=example(slos="{fast: {at: 30 Hz, require: [latency.p90 < 2 %]}}"),
    passing=example(slos="{fast: {at: 30 Hz, require: [latency.p90 < 50 ms]}}"),
    find=_find,
)
