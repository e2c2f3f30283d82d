"""Monitors: whether messages reach them, and can be matched with those that were played."""

from __future__ import annotations

from r2bspec.bags.message_types import begins_with_header
from r2bspec.check.check_context import Context
from r2bspec.check.rule import MEASURE_FLOW, Finding, Findings, Pointer, rule, topic_key, value_key
from r2bspec.diagnostics.quote import quote


@rule("R2B405")
def monitor_unreachable(context: Context) -> Findings:
    """Find monitors that no playback input reaches."""
    phase = context.wiring.measure
    if not context.spec.plays_topics or phase.possible_subscribers or phase.possible_publishers:
        return
    reached = phase.downstream_of(played.topic for played in phase.endpoints_of("player"))
    for monitor in phase.endpoints_of("monitor"):
        publishers = phase.publishers(monitor.topic)
        own_pace = context.spec.monitors[monitor.monitor].own_pace
        if publishers and monitor.topic not in reached and not own_pace:
            yield Finding(
                message="no path from a playback input to "
                f"{quote(context.relative_name(monitor.topic))}, the topic of monitor "
                f"{monitor.monitor}",
                path=monitor.path,
                related=(
                    Pointer("published here", publishers[0].path, publishers[0].topic_is_key),
                ),
                suppressed_by={MEASURE_FLOW, topic_key(phase.phase, monitor.topic)},
            )


@rule("R2B406")
def monitor_without_header(context: Context) -> Findings:
    """Find monitors that match by stamp, of messages without a header."""
    for name, monitor in context.spec.monitors.items():
        path = ("monitors", name)
        by_stamp = monitor.match in {"stamp", "any"}
        if by_stamp and begins_with_header(monitor.format) is False:
            yield Finding(
                message=f"monitor {name} matches by stamp, but {monitor.format} has no header",
                path=(*path, "format"),
                help="use 'match: order' if each input has one output, or 'match: own_pace' if it "
                "comes at a pace of its own",
                suppressed_by={value_key((*path, "format"))},
                suppresses={value_key((*path, "match"))},
            )


@rule("R2B407")
def inputs_without_stamp(context: Context) -> Findings:
    """Find monitors that match by stamp if no playback input has a stamp."""
    if _any_stamp(context):
        return
    first, played = next(iter(context.spec.playback.played.items()))
    headerless = played.timestamp == "header"
    for name, monitor in context.spec.monitors.items():
        if monitor.match in {"stamp", "any"}:
            yield Finding(
                message=f"monitor {name} matches by stamp, but the player stamps no playback input",
                path=("monitors", name),
                key=True,
                help="use 'match: order' if each input has one output",
                related=(
                    Pointer(
                        f"{played.format} has no header"
                        if headerless
                        else "its recorded stamp is kept",
                        ("playback", "inputs", first, "format" if headerless else "timestamp"),
                    ),
                ),
                suppressed_by={value_key(("monitors", name, "match"))},
            )


def _any_stamp(context: Context) -> bool:
    """Return whether the player stamps messages of any input, as far as their types are known."""
    inputs = context.spec.playback.played.values()
    return not inputs or any(
        played.timestamp == "header" and begins_with_header(played.format) is not False
        for played in inputs
    )
