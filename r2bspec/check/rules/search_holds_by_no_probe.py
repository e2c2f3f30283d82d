"""Conditions of a search that a single probe cannot answer."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, known_metrics, quote

_PROBE_SCOPES = ("monitor", "playback")


def _find(context: Context) -> Findings:
    for each in known_metrics(context):
        if each.located.role == "holds" and each.info.scope not in _PROBE_SCOPES:
            yield Finding(
                message=f"a probe of a search does not answer {quote(each.info.name)}",
                path=each.located.path,
                part=each.located.metric_part,
                help="that the backlog does not grow is always asked; leave it out"
                if each.info.scope == "probe"
                else "conditions are on metrics of monitors, such as 'drop_rate <= 5 %'",
                suppresses={each.located.subject},
            )


RULE = Rule(
    code="R2B509",
    title="a condition of a search that no probe can answer",
    severity="error",
    why="A probe plays one rate for a few seconds and looks at what comes out.",
    failing=example(benchmark="{search: {min: 5 Hz, max: 200 Hz, holds: [cpu.relay.mean < 80 %]}}"),
    passing=example(benchmark="{search: {min: 5 Hz, max: 200 Hz, holds: [drop_rate <= 5 %]}}"),
    find=_find,
)
