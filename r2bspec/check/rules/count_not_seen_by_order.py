"""Counts of odd messages, required of a monitor that cannot see them."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    example,
    known_metrics,
    quote,
)

_NEED_STAMPS = frozenset({"duplicates", "reordered"})


def _find(context: Context) -> Findings:
    monitors = context.spec.monitors
    for each in known_metrics(context):
        if each.info.name not in _NEED_STAMPS:
            continue
        for name in [each.monitor] if each.monitor else monitors:
            if monitors[name].match == "order":
                yield Finding(
                    message=f"monitor {name} matches by order, and cannot tell {each.info.name}",
                    path=each.located.path,
                    part=each.located.metric_part,
                    help=f"require it of a topic whose messages have a header, or {quote('missed')}"
                    " and 'unmatched', which are counted",
                    related=(Pointer("it says so here", ("monitors", name, "match")),),
                    suppressed_by={each.located.subject},
                )


RULE = Rule(
    code="R2B525",
    title="a count that matching by order cannot see",
    severity="error",
    why="Only a stamp tells that an answer came twice, or before another. By order, the second of "
    "two equal messages is taken for the next answer, and the count is always 0.",
    failing=example(
        graph="""
            nodes:
              counter:
                command: [sh, ./counter.sh]
                subscribes: {image: sensor_msgs/msg/Image}
                publishes: {output: std_msgs/msg/Float32}
        """,
        monitors="{output: {topic: output, format: std_msgs/msg/Float32, match: order}}",
        slos="{once: {at: 30 Hz, require: [duplicates == 0]}}",
    ),
    passing=example(
        graph="""
            nodes:
              counter:
                command: [sh, ./counter.sh]
                subscribes: {image: sensor_msgs/msg/Image}
                publishes: {output: std_msgs/msg/Float32}
        """,
        monitors="{output: {topic: output, format: std_msgs/msg/Float32, match: order}}",
        slos="{all: {at: 30 Hz, require: [unmatched == 0]}}",
    ),
    find=_find,
)
