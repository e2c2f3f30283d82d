"""Counts that need stamps, required of a monitor that matches by order."""

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
                    message=f"monitor {name} matches by order, which cannot count "
                    f"{quote(each.info.name)}",
                    path=each.located.path,
                    part=each.located.metric_part,
                    help="require it of a monitor that matches by stamp, or require 'missed' and "
                    "'unmatched' instead",
                    related=(Pointer("matched by order here", ("monitors", name, "match")),),
                    suppressed_by={each.located.subject},
                )


RULE = Rule(
    code="R2B525",
    title="count is not available when matching by order",
    severity="error",
    why="Duplicate and reordered outputs are detected by their stamps. When matching by order, a "
    "duplicate is taken for the next output, and the count is always 0.",
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
