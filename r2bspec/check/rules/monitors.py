"""Monitors: whether messages reach them, and can be matched with those that were played."""

from __future__ import annotations

from r2bspec.bags.message_types import begins_with_header
from r2bspec.check.check_context import Context
from r2bspec.check.input_events import event_input
from r2bspec.check.rule import MEASURE_FLOW, Finding, Findings, Pointer, rule, topic_key, value_key
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import quote, quoted_list, suggestion
from r2bspec.language.comparison_grammar import Condition
from r2bspec.language.spec import Monitor, Reaction
from r2bspec.plan.message_conditions import ConditionMistake, message_condition


@rule("R2B405")
def monitor_unreachable(context: Context) -> Findings:
    """Monitors that no playback input reaches."""
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
    """Monitors that match by stamp, of messages without a header."""
    for name, monitor in context.spec.monitors.items():
        path = ("monitors", name)
        if monitor.match == "stamp" and begins_with_header(monitor.format) is False:
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
    """Monitors that match by stamp, where no playback input has one."""
    if _any_stamp(context):
        return
    first, played = next(iter(context.spec.playback.inputs.items()))
    headerless = played.timestamp == "header"
    for name, monitor in context.spec.monitors.items():
        if monitor.match == "stamp":
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
    """Whether the player stamps messages of any input, as far as their types are known."""
    inputs = context.spec.playback.inputs.values()
    return not inputs or any(
        played.timestamp == "header" and begins_with_header(played.format) is not False
        for played in inputs
    )


@rule("R2B417")
def reaction_unusable(context: Context) -> Findings:
    """Reactions without an input event, or to fields that messages do not have."""
    for name, monitor in context.spec.monitors.items():
        if monitor.reaction is None:
            continue
        path = ("monitors", name, "reaction")
        wrong = _wrong_input(context, path, monitor.reaction)
        if wrong is not None:
            yield wrong
            continue
        yield from _unfit(monitor.reaction.when, monitor.format, (*path, "when"))
        if monitor.reaction.source is not None:
            event = _event_monitor if context.spec.live else event_input
            begins = event(context, monitor.reaction)
            if begins is not None:
                yield from _unfit(monitor.reaction.source, begins.format, (*path, "from"))


def _event_monitor(context: Context, reaction: Reaction) -> Monitor:
    """The monitor whose messages begin the events of a live graph, which exists."""
    wanted = context.wiring.topic(reaction.input)
    monitors = context.spec.outputs.values()
    return next(each for each in monitors if context.wiring.topic(each.topic) == wanted)


def _wrong_input_of_a_live_graph(
    context: Context, path: Path, reaction: Reaction
) -> Finding | None:
    topics = [each.topic for each in context.spec.outputs.values()]
    if not reaction.input:
        return Finding(
            message="with 'mode: live' no input is played: an event begins with a message that "
            "another monitor sees, and 'input' has to name its topic",
            path=path,
            key=True,
            help="monitor the topic that the graph reacts to, and add 'input:' with it",
        )
    if context.wiring.topic(reaction.input) in map(context.wiring.topic, topics):
        return None
    return Finding(
        message=f"no monitor sees {quote(reaction.input)}, and with 'mode: live' nothing else "
        "sees where an event begins",
        path=(*path, "input"),
        help=f"add a monitor of this topic, or choose one of {quoted_list(dict.fromkeys(topics))}",
    )


def _wrong_input(context: Context, path: Path, reaction: Reaction) -> Finding | None:
    """What is wrong with the input of the events."""
    inputs = {context.wiring.topic(name): name for name in context.spec.playback.inputs}
    if context.spec.live:
        return _wrong_input_of_a_live_graph(context, path, reaction)
    if reaction.input and context.wiring.topic(reaction.input) not in inputs:
        return Finding(
            message=f"{quote(reaction.input)} is not a playback input",
            path=(*path, "input"),
            help=suggestion(reaction.input, inputs.values(), "playback inputs"),
        )
    if reaction.source is None:
        return None
    if len(inputs) != 1 and not reaction.input:
        several = f"the playback has {len(inputs)} inputs, and 'from' is about one of them"
        return Finding(
            message=several if inputs else "'from' needs a playback input, and there is none",
            path=(*path, "from"),
            key=True,
            help=f"add 'input:' with one of {quoted_list(inputs.values())}"
            if inputs
            else "remove 'from': each step is then an event",
        )
    played = event_input(context, reaction)
    if played is not None and played.rate == "recorded":
        return Finding(
            message="an event begins with a step, and this input is played between the steps",
            path=(*path, "input") if reaction.input else (*path, "from"),
            help="choose an input without 'rate: recorded'",
        )
    return None


def _unfit(condition: Condition, format_: str, path: Path) -> Findings:
    found = message_condition(condition, format_)
    if not isinstance(found, ConditionMistake):
        return
    rest = condition.text[found.column :].split()
    yield Finding(
        message=f"{quote(condition.text)}: {found.message}",
        path=path,
        part=(found.column, len(rest[0]) if rest else 1),
        help=found.help,
    )
