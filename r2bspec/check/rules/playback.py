"""Playback inputs: from the bag through the preprocessors to the player.

A topic that is loaded has to reach a playback input. Each input has to come from somewhere, with
messages that can be played together or at their times.
"""

from __future__ import annotations

from r2bspec.bags.message_types import begins_with_header
from r2bspec.check.check_context import Context, window_message_counts, window_stamps
from r2bspec.check.rule import (
    PREPROCESS_FLOW,
    Finding,
    Findings,
    Pointer,
    publisher_advice,
    rule,
    topic_key,
    value_key,
)
from r2bspec.diagnostics.quote import did_you_mean, quote
from r2bspec.plan.nearest_stamps import pair_nearest
from r2bspec.plan.topic_plans import direct_bag_topic
from r2bspec.plan.wiring.wiring import PhaseWiring, WiredEndpoint
from r2bspec.record.run_record import UNPAIRED_HELP, UnplayedMessages


@rule("R2B401")
def playback_source_without_publisher(context: Context) -> Findings:
    """Playback inputs whose source topic has no publisher."""
    phase = context.wiring.preprocess
    for source in phase.endpoints_of("recorder"):
        if not phase.publishers(source.topic):
            yield _source_finding(context, phase, source)


def _source_finding(context: Context, phase: PhaseWiring, source: WiredEndpoint) -> Finding:
    shown = context.relative_name(source.topic)
    unknown = phase.possible_publishers
    instead = [
        topic
        for topic in phase.topics
        if phase.publishers(topic)
        and not phase.subscriptions(topic)
        and did_you_mean(shown, [context.relative_name(topic)])
    ]
    return Finding(
        message=f"no publisher on {quote(shown)}: neither the data loader nor a preprocessor "
        "publishes it"
        if not unknown
        else f"no known publisher on {quote(shown)}",
        path=source.path,
        help=publisher_advice(context, phase, source.topic),
        related=tuple(
            Pointer(
                f"{quote(context.relative_name(topic))} is published here and has no "
                f"{'known ' if phase.possible_subscribers else ''}subscription",
                publisher.path,
            )
            for topic in instead
            for publisher in phase.publishers(topic)[:1]
        ),
        severity="warning" if unknown else None,
        suppressed_by={topic_key(phase.phase, source.topic)}
        | {value_key(node.path) for node in unknown},
        suppresses=frozenset(
            {PREPROCESS_FLOW} | {topic_key(phase.phase, topic) for topic in instead}
        ),
    )


@rule("R2B402")
def preprocessor_cycle(context: Context) -> Findings:
    """Preprocessors that form a cycle."""
    phase = context.wiring.preprocess
    for node in phase.nodes:
        for endpoint in phase.endpoints_of(node.name):
            if not endpoint.is_publisher and phase.is_in_cycle(endpoint):
                yield Finding(
                    message=f"preprocessor {node.key} is in a cycle: its input "
                    f"{quote(context.relative_name(endpoint.topic))} depends on its own output",
                    path=endpoint.path,
                    key=endpoint.topic_is_key,
                    help="pass messages in one direction, from the data loader to the playback "
                    "inputs",
                    suppressed_by={topic_key(phase.phase, endpoint.topic)},
                    suppresses={PREPROCESS_FLOW},
                )


@rule("R2B409")
def timeline_without_timestamps(context: Context) -> Findings:
    """Timelines with inputs that have no timestamps."""
    playback = context.spec.playback
    if playback.mode != "timeline" or playback.record_timeline:
        return
    for name, played in playback.inputs.items():
        source = context.wiring.topic(played.source)
        preprocessed = not direct_bag_topic(source, context.spec, context.wiring)
        if preprocessed and begins_with_header(played.format) is False:
            yield Finding(
                message=f"{quote(name)} has no timestamps: it is the output of a preprocessor, and "
                f"{played.format} has no header",
                path=("playback", "inputs", name),
                key=True,
                help="use 'record_timeline: true' to play the messages at the times at which the "
                "preprocessor publishes them",
            )


_COUNTS_ALONE = "; only their numbers were compared, not their stamps"


@rule("R2B415")
def input_messages_unpaired(context: Context) -> Findings:
    """Inputs of which messages are not played, because they have no partner of the same stamp."""
    spec = context.spec
    if spec.playback.mode == "timeline" or spec.playback.unpaired == "drop":
        return
    for unplayed in _unplayed(context):
        if not unplayed.is_warning:
            continue
        name = next(
            name for name in spec.playback.inputs if context.wiring.topic(name) == unplayed.topic
        )
        yield Finding(
            message=f"{unplayed.clause}{_COUNTS_ALONE if unplayed.at_least else ''}",
            path=("playback", "inputs", name),
            key=True,
            help=UNPAIRED_HELP,
            severity="error" if unplayed.is_most else None,
            suppressed_by={value_key(("data_loader", "window"))},
        )


def _unplayed(context: Context) -> list[UnplayedMessages]:
    """At least so many messages of each input are not played, as far as the bag tells."""
    bag_topics: dict[str, str] = {}
    slops_ns: list[int] = []
    playback = context.spec.playback
    for name, played in playback.inputs.items():
        if begins_with_header(played.format) is False or played.rate == "recorded":
            continue
        source = context.wiring.topic(played.source)
        bag_topic = direct_bag_topic(source, context.spec, context.wiring)
        if not bag_topic or begins_with_header(played.format) is None:
            # What a preprocessor publishes, and with which stamps, only the run tells.
            return []
        bag_topics[context.wiring.topic(name)] = bag_topic
        slops_ns.append((played.pairing or playback.pairing).slop.ns)
    if len(bag_topics) < 2:
        return []
    stamps = window_stamps(context, set(bag_topics.values()))
    if stamps is None:
        return _by_counts(context, bag_topics, max(slops_ns))
    steps = pair_nearest([stamps[topic] for topic in bag_topics.values()], slops_ns)
    return [
        UnplayedMessages(topic=topic, count=total - len(steps), total=total, slop_ns=max(slops_ns))
        for topic, bag_topic in bag_topics.items()
        if (total := len(stamps[bag_topic])) > len(steps)
    ]


def _by_counts(
    context: Context, bag_topics: dict[str, str], slop_ns: int
) -> list[UnplayedMessages]:
    """An input with more messages than another has at least so many without a partner."""
    counts = window_message_counts(context)
    if not all(topic in counts and counts[topic].exact for topic in bag_topics.values()):
        return []
    fewest = min(counts[topic].messages for topic in bag_topics.values())
    return [
        UnplayedMessages(
            topic=topic, count=total - fewest, total=total, at_least=True, slop_ns=slop_ns
        )
        for topic, bag_topic in bag_topics.items()
        if (total := counts[bag_topic].messages) > fewest > 0
    ]
