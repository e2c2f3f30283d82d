"""Taps on a path without known intermediate topics."""

from __future__ import annotations

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, quoted_list


def _find(context: Context) -> Findings:
    phase = context.wiring.measure
    played = {each.topic for each in phase.endpoints_of("player")}
    for each in phase.endpoints_of("monitor"):
        if not context.spec.monitors[each.monitor].taps:
            continue
        path = ("monitors", each.monitor, "taps")
        if not _any_stamp(context):
            yield Finding(
                message="taps match messages by stamp, but no playback input has one",
                path=path,
                help="add a monitor with 'match: order' for each topic",
            )
            continue
        shown = quote(context.relative_name(each.topic))
        path_topics = phase.downstream_of(played) & phase.upstream_of(each.topic)
        if not path_topics - played - {each.topic}:
            unknown = [
                node.key for node in (*phase.possible_subscribers, *phase.possible_publishers)
            ]
            yield Finding(
                message=f"no known topic between the playback inputs and {shown}",
                path=path,
                help=f"list the topics of {quoted_list(unknown)} under 'subscribes:' and "
                "'publishes:'"
                if unknown
                else "remove 'taps': a single node has no intermediate topics",
            )


def _any_stamp(context: Context) -> bool:
    inputs = context.spec.playback.inputs.values()
    return not inputs or any(
        each.timestamp == "header" and begins_with_header(each.format) is not False
        for each in inputs
    )


RULE = Rule(code="R2B412", find=_find)
