"""Monitors: whether messages reach them, and can be matched with those that were played."""

from __future__ import annotations

from r2bspec.bags.message_types import begins_with_header
from r2bspec.check.check_context import Context
from r2bspec.check.input_events import event_input
from r2bspec.check.rule import MEASURE_FLOW, Finding, Findings, Pointer, rule, topic_key, value_key
from r2bspec.datasets.catalogue import truth_names
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import did_you_mean, quote, quoted_list, suggestion
from r2bspec.judge.measure.metric_catalogue import TRUTHS
from r2bspec.language.comparison_grammar import Condition
from r2bspec.language.spec import Monitor, Reaction, Truth
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


@rule("R2B411")
def monitor_duplicate(context: Context) -> Findings:
    """Monitors that measure the same topic."""
    first: dict[tuple[str, str], str] = {}
    for name, monitor in context.spec.monitors.items():
        topic = context.wiring.topic(monitor.topic)
        # One of them may measure the latency, and any other a reaction.
        if monitor.reaction is not None:
            continue
        other = first.setdefault((topic, monitor.match), name)
        if other != name:
            yield Finding(
                message=f"monitors {other} and {name} have the same topic and the same 'match'",
                path=("monitors", name, "topic"),
                help="remove one of them",
                related=(Pointer("the other monitor", ("monitors", other, "topic")),),
            )


@rule("R2B412")
def tap_without_path(context: Context) -> Findings:
    """Taps on a path without known intermediate topics."""
    phase = context.wiring.measure
    played = {endpoint.topic for endpoint in phase.endpoints_of("player")}
    for endpoint in phase.endpoints_of("monitor"):
        if not context.spec.monitors[endpoint.monitor].taps:
            continue
        path = ("monitors", endpoint.monitor, "taps")
        if not _any_stamp(context):
            yield Finding(
                message="taps match messages by stamp, but no playback input has one",
                path=path,
                help="add a monitor with 'match: order' for each topic",
            )
            continue
        shown = quote(context.relative_name(endpoint.topic))
        path_topics = phase.downstream_of(played) & phase.upstream_of(endpoint.topic)
        if not path_topics - played - {endpoint.topic}:
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
    """Whether the player stamps messages of any input, as far as their types are known."""
    inputs = context.spec.playback.inputs.values()
    return not inputs or any(
        played.timestamp == "header" and begins_with_header(played.format) is not False
        for played in inputs
    )


@rule("R2B414")
def answered_input_unknown(context: Context) -> Findings:
    """Inputs in `answers` that do not exist, and `answers` without effect."""
    spec = context.spec
    inputs = {context.wiring.topic(name): name for name in spec.playback.inputs}
    for name, monitor in spec.monitors.items():
        path = ("monitors", name, "answers")
        if monitor.answers and spec.playback.mode != "timeline":
            yield Finding(
                message=f"'answers' has no effect with 'mode: {spec.playback.mode}'",
                path=path,
                key=True,
                help="remove it: each step has messages of all inputs",
                severity="warning",
            )
            continue
        for index, answered in enumerate(monitor.answers):
            if context.wiring.topic(answered) not in inputs:
                yield Finding(
                    message=f"'answers' of monitor {name} lists {quote(answered)}, which is not a "
                    "playback input",
                    path=(*path, index),
                    help=suggestion(answered, inputs.values(), "playback inputs"),
                )


@rule("R2B416")
def truth_unusable(context: Context) -> Findings:
    """A monitor's truth that its recording does not have, or that its messages cannot have."""
    for name, monitor in context.spec.monitors.items():
        if monitor.truth is None:
            continue
        finding = _wrong_use(context, name, monitor) or _wrong_name(context, name, monitor.truth)
        if finding is not None:
            yield finding


def _wrong_use(context: Context, name: str, monitor: Monitor) -> Finding | None:
    truth = monitor.truth
    assert truth is not None  # noqa: S101 - the caller looks
    if context.spec.live:
        return Finding(
            message="'truth' has no effect with 'mode: live', in which nothing recorded is played",
            path=("monitors", name, "truth"),
            key=True,
            help="remove it",
        )
    comparable = TRUTHS[truth.kind].format
    if monitor.format != comparable:
        return Finding(
            message=f"messages of type {monitor.format} cannot be compared with a {truth.kind}",
            path=("monitors", name, "truth", "kind"),
            help=f"'kind: {truth.kind}' is for {comparable}",
        )
    return None


def _wrong_name(context: Context, name: str, truth: Truth) -> Finding | None:
    """A name that no recording has; nothing is said where one of them cannot be looked at."""
    recordings = context.recordings
    if not recordings or any(recording.location is None for recording in recordings):
        return None
    topics = tuple(context.spec.data_loader.topics)
    truths = [truth_names(bag.location, topics) for bag in recordings if bag.location]
    names = [name for of_bag in truths if of_bag for name in getattr(of_bag, truth.kind)]
    if truth.name in names or f"/{truth.name}" in names:
        return None
    path = ("monitors", name, "truth", "name")
    if not any(truths):
        return Finding(
            message="the recording has no ground truth",
            path=path,
            help="remove 'truth', or use a synthetic dataset",
        )
    what = TRUTHS[truth.kind].named
    close = did_you_mean(truth.name, names)
    advice = f"known: {quoted_list(names)}" if names else "load the images that it is about"
    return Finding(
        message=f"the ground truth has no {truth.kind} of {quote(truth.name)}",
        path=path,
        help=f"did you mean {quote(close)}?" if close else f"it is the name of {what}; {advice}",
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
