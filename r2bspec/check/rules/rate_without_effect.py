"""Rates and searches where the messages have times of their own."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, quote


def _find(context: Context) -> Findings:
    if not context.has_own_rate:
        return
    mode = context.spec.playback.mode
    whose = "the recording" if mode == "timeline" else "the graph's own source"
    benchmark = context.spec.benchmark
    for key, given in (("rates", benchmark.rates), ("search", benchmark.search)):
        if given:
            yield Finding(
                message=f"{quote(key)} has no effect with 'mode: {mode}': {whose} says how fast "
                "messages come",
                path=("benchmark", key),
                key=True,
                help="remove it, or write 'mode: looping'",
                suppresses={"rates"},
            )
    for name, objective in context.spec.slos.items():
        if objective.at is not None or objective.at_peak:
            yield Finding(
                message=f"nothing is played at a chosen rate with 'mode: {mode}'",
                path=("slos", name, "at"),
                help="remove 'at'",
                suppressed_by={"rates"},
            )


RULE = Rule(
    code="R2B408",
    title="a rate where messages have times of their own",
    severity="error",
    why="A timeline is played at the times of its recording, and a live graph has its own source. "
    "Neither can be offered at another rate.",
    failing=example(
        playback="""
            mode: timeline
            inputs:
              image: {from: image_raw, format: sensor_msgs/msg/Image}
        """,
        benchmark="{rates: [30 Hz]}",
    ),
    passing=example(
        playback="""
            mode: timeline
            inputs:
              image: {from: image_raw, format: sensor_msgs/msg/Image}
        """,
        benchmark="{duration: 5 s}",
    ),
    find=_find,
)
