"""Taps on a way of which no topic is known."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote, quoted_list


def _find(context: Context) -> Findings:
    phase = context.wiring.measure
    played = {each.topic for each in phase.endpoints_of("player")}
    for each in phase.endpoints_of("monitor"):
        if not context.spec.monitors[each.monitor].taps:
            continue
        path = ("monitors", each.monitor, "taps")
        if not _any_stamp(context):
            yield Finding(
                message="taps find messages by their stamp, which no playback input carries",
                path=path,
                help="watch each topic with a monitor that matches by order",
            )
            continue
        shown = quote(context.relative_name(each.topic))
        path_topics = phase.downstream_of(played) & phase.upstream_of(each.topic)
        if not path_topics - played - {each.topic}:
            unknown = [
                node.key for node in (*phase.possible_subscribers, *phase.possible_publishers)
            ]
            yield Finding(
                message=f"no topic is known between the inputs and {shown}",
                path=path,
                help=f"say what {quoted_list(unknown)} 'subscribes:' and 'publishes:'"
                if unknown
                else "one node alone has no hops to tell apart",
            )


def _any_stamp(context: Context) -> bool:
    inputs = context.spec.playback.inputs.values()
    return not inputs or any(
        each.timestamp == "header" and begins_with_header(each.format) is not False
        for each in inputs
    )


RULE = Rule(
    code="R2B412",
    title="taps where there is nothing to tap",
    severity="info",
    why="Taps split the latency of a graph into that of its hops. They are set on the topics "
    "between the playback inputs and the monitored one, as far as these are known.",
    failing=example(
        monitors="{output: {topic: output, format: sensor_msgs/msg/Image, taps: true}}"
    ),
    passing=example(
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image, output: relayed}
              again: {python: r2bspec.nodes.RelayNode, remappings: {input: relayed}}
        """,
        monitors="{output: {topic: output, format: sensor_msgs/msg/Image, taps: true}}",
    ),
    find=_find,
)
