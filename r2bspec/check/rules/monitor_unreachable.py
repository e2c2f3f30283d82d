"""Monitors that no playback input reaches."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    MEASURE_FLOW,
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    quote,
    topic_key,
)


def _find(context: Context) -> Findings:
    phase = context.wiring.measure
    if context.spec.live or phase.possible_subscribers or phase.possible_publishers:
        return
    reached = phase.downstream_of(each.topic for each in phase.endpoints_of("player"))
    for monitor in phase.endpoints_of("monitor"):
        publishers = phase.publishers(monitor.topic)
        if publishers and monitor.topic not in reached:
            yield Finding(
                message="no path from a playback input to "
                f"{quote(context.relative_name(monitor.topic))}, the topic of monitor "
                f"{monitor.monitor}",
                path=monitor.path,
                related=(
                    Pointer("published here", publishers[0].path, publishers[0].topic_is_key),
                ),
                suppressed_by=frozenset(
                    {
                        MEASURE_FLOW,
                        topic_key(phase.phase, monitor.topic),
                    },
                ),
            )


RULE = Rule(code="R2B405", find=_find)
