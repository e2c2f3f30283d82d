"""Timelines with inputs that have no timestamps."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote
from r2bspec.plan.topic_plans import direct_bag_topic


def _find(context: Context) -> Findings:
    playback = context.spec.playback
    if playback.mode != "timeline" or playback.record_timeline:
        return
    for name, each in playback.inputs.items():
        source = context.harness_topic(each.source)
        preprocessed = not direct_bag_topic(source, context.spec, context.wiring)
        if preprocessed and begins_with_header(each.format) is False:
            yield Finding(
                message=f"{quote(name)} has no timestamps: it is the output of a preprocessor, and "
                f"{each.format} has no header",
                path=("playback", "inputs", name),
                key=True,
                help="use 'record_timeline: true' to play the messages at the times at which the "
                "preprocessor publishes them",
            )


RULE = Rule(code="R2B409", find=_find)
