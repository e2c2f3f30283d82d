"""Ready probes that wait for a topic without a publisher."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
    quote,
    quoted_list,
    suggestion,
    topic_key,
)


def _find(context: Context) -> Findings:
    phase = context.wiring.measure
    for name, probe in context.spec.ready.items():
        topic = context.harness_topic(probe.topic) if probe.topic else ""
        if not topic or phase.publishers(topic):
            continue
        unknown = [node.key for node in phase.possible_publishers]
        published = [context.relative_name(each) for each in phase.topics if phase.publishers(each)]
        advice = suggestion(context.relative_name(topic), published, "published topics")
        if unknown:
            declaration = f"list the topics of {quoted_list(unknown)} under 'publishes:'"
            advice = f"{advice}; or {declaration}" if advice else declaration
        yield Finding(
            message=f"no {'known ' if unknown else ''}publisher on "
            f"{quote(context.relative_name(topic))}, which this probe waits for",
            path=("ready", name, "topic"),
            help=advice,
            severity="warning" if unknown else None,
            suppressed_by={topic_key(phase.phase, topic)},
        )


RULE = Rule(code="R2B413", find=_find)
