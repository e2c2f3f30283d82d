"""Ready probes that wait for a topic which nobody publishes."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
    example,
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
        advice = suggestion(context.relative_name(topic), published, "topics that there are")
        if unknown:
            advice += f"; or state what {quoted_list(unknown)} publishes under 'publishes:' there"
        yield Finding(
            message=(
                f"nobody publishes {quote(context.relative_name(topic))}, so this probe never holds"
            )
            if not unknown
            else (
                f"nobody is known to publish {quote(context.relative_name(topic))}, which is "
                "waited for"
            ),
            path=("ready", name, "topic"),
            help=advice,
            severity="warning" if unknown else None,
            suppressed_by={topic_key(phase.phase, topic)},
        )


RULE = Rule(
    code="R2B413",
    title="a ready probe that waits for a topic which nobody publishes",
    severity="error",
    why="The run would wait until the timeout of the probe, and then give up.",
    failing=example(ready="{relay: {topic: outptu}}"),
    passing=example(ready="{relay: {topic: output}}"),
    find=_find,
)
