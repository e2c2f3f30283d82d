"""Playback inputs: from the bag through the preprocessors to the player.

A topic that is loaded has to reach a playback input. Each input has to come from somewhere, with
messages that can be played together or at their times.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from r2bspec.bags.message_types import begins_with_header
from r2bspec.bags.recorded_times import TopicTimes
from r2bspec.check.check_context import Context, clocks_ahead, messages_in_window
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
from r2bspec.language.quantities import Duration
from r2bspec.language.spec import PlaybackInput
from r2bspec.plan.nearest_stamps import LONGEST_DELAY_NS, pair_nearest
from r2bspec.plan.topic_plans import answered_inputs, direct_bag_topic
from r2bspec.plan.wiring.wiring import PhaseWiring, WiredEndpoint
from r2bspec.record.run_record import UNPAIRED_HELP, UnplayedMessages


@rule("R2B401")
def playback_source_without_publisher(context: Context) -> Findings:
    """Find playback inputs whose source topic has no publisher."""
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
    """Find preprocessors that form a cycle."""
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
    """Find timelines with inputs that have no timestamps."""
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


@rule("R2B419")
def latched_input_not_recorded(context: Context) -> Findings:
    """Find latched inputs that a preprocessor produces."""
    for name, played in context.spec.playback.latched.items():
        source = context.wiring.topic(played.source)
        if not direct_bag_topic(source, context.spec, context.wiring):
            yield Finding(
                message=f"{quote(name)} is published once, but no recorded topic is loaded as "
                f"{quote(context.relative_name(source))}",
                path=("playback", "inputs", name, "rate"),
                help="load its topic directly, without a preprocessor, or remove 'rate: once'",
                suppressed_by={topic_key("preprocess", source)},
            )


@rule("R2B420")
def arrivals_without_period(context: Context) -> Findings:
    """Find searches, and requirements on rates and intervals, with irregular arrivals."""
    arrivals = context.spec.irregular_arrivals
    if arrivals is None or context.spec.has_own_rate:
        return
    if context.spec.benchmark.search is not None:
        yield Finding(
            message=f"a search probes rates at equal intervals, not with {arrivals.kind} arrivals",
            path=("benchmark", "search"),
            key=True,
            help="list 'rates' and require latency at them, or write 'arrivals: fixed'",
        )
    for metric in context.known_metrics:
        family = metric.info.metric.name
        if metric.info.statistic == "sequential":
            why = "is probed at equal intervals"
        elif family in {"interval", "jitter"}:
            why = "is mostly that of the arrivals"
        else:
            continue
        yield Finding(
            message=f"{quote(metric.info.name)} {why}, and the playback has {arrivals.kind} "
            "arrivals",
            path=metric.path,
            part=metric.metric_part,
            help="require latency or drop_rate, or write 'arrivals: fixed'",
            severity="warning" if family in {"interval", "jitter"} else None,
        )


@rule("R2B658")
def monitor_without_steps(context: Context) -> Findings:
    """Find monitors of a timeline that answer inputs which no step has together."""
    spec, playback = context.spec, context.spec.playback
    if playback.mode != "timeline":
        return
    for name, monitor in spec.monitors.items():
        topics = answered_inputs(monitor, spec, context.wiring)
        answered = {
            key: each
            for key, each in playback.played.items()
            if context.wiring.topic(key) in topics
        }
        stamps = _stamps_of_inputs(context, answered) if len(answered) > 1 else None
        if stamps is None:
            continue
        slops_ns = [(each.pairing or playback.pairing).slop.ns for each in answered.values()]
        if all(stamps) and pair_nearest(stamps, slops_ns):
            continue
        slowest = min(answered, key=lambda key: len(stamps[list(answered).index(key)]) or math.inf)
        yield Finding(
            message=f"no step of the timeline has messages of all inputs of monitor {name}: "
            f"{', '.join(answered)}",
            path=("monitors", name),
            key=True,
            help=_clock_advice(context, answered)
            or f"write 'answers: [{slowest}]', or the input whose messages it answers; with "
            "'pairing: {slop: ...}' messages with near stamps are one step",
            suppressed_by={value_key(("data_loader", "window"))},
        )


def _clock_advice(context: Context, inputs: Mapping[str, PlaybackInput]) -> str:
    """Return which clocks to correct; empty if they do not differ by a constant."""
    times = {name: each for name, each in context.input_times.items() if name in inputs}
    ahead = clocks_ahead(times, LONGEST_DELAY_NS) if len(times) == len(inputs) else {}
    wrong = [f"'clock_ahead: {by}' for {name}" for name, by in ahead.items() if by.ns]
    return f"write {' and '.join(wrong)}" if wrong else ""


def _stamps_of_inputs(
    context: Context, inputs: Mapping[str, PlaybackInput]
) -> list[list[int]] | None:
    """Return the stamps of each input, none of one without a header; None if they are not read."""
    if context.spec.playback.record_timeline:
        return None
    later = context.spec.playback.timeline.translations
    stamps = []
    for name, played in inputs.items():
        shift_ns = later[name].ns if name in later else 0
        found = context.input_times.get(name)
        if found is None and begins_with_header(played.format) is not False:
            return None
        stamps.append([stamp_ns + shift_ns for stamp_ns in found.stamps_ns] if found else [])
    return stamps


@rule("R2B415")
def input_messages_unpaired(context: Context) -> Findings:
    """Find inputs with messages that are not played, for lack of a partner with the same stamp."""
    spec = context.spec
    if spec.playback.mode == "timeline" or spec.playback.unpaired == "drop":
        return
    messages = _messages_of_steps(context)
    missing = [unplayed for unplayed in _unplayed(context, messages) if unplayed.is_warning]
    times = {each.name: each.times for each in messages if each.times is not None}
    slop_ns = max((each.slop_ns for each in messages), default=0)
    clocks = clocks_ahead(times, slop_ns) if missing else {}
    for unplayed in missing:
        name = next(
            name for name in spec.playback.inputs if context.wiring.topic(name) == unplayed.topic
        )
        ahead = clocks.get(name, Duration(0))
        if not ahead.ns and any(other.ns for other in clocks.values()):
            continue
        because = f": its clock was {ahead} ahead" if ahead.ns else ""
        advice = _other_rate(messages) or UNPAIRED_HELP
        yield Finding(
            message=f"{unplayed.clause}{_COUNTS_ALONE if unplayed.at_least else ''}{because}",
            path=("playback", "inputs", name),
            key=True,
            help=f"write 'clock_ahead: {ahead}'; 'pairing: {{slop: ...}}' allows what still differs"
            if because
            else advice,
            severity="error" if unplayed.is_most else None,
            suppressed_by={value_key(("data_loader", "window"))},
        )


def _other_rate(inputs: Sequence[_StepInput]) -> str:
    """Return what to do about inputs of other rates, and without stamps; empty if it is neither."""
    counts = {each.name: len(each.times.stamps_ns) for each in inputs if each.times is not None}
    single = [name for name, count in counts.items() if count == 1 < max(counts.values())]
    if single:
        return f"write 'rate: once' for {' and '.join(single)}: it is played before the first step"
    stuck = [each.name for each in inputs if each.times is not None and each.times.is_stuck]
    if stuck and len(stuck) < len(inputs):
        return f"write 'rate: recorded' for {' and '.join(stuck)}, whose stamps are all the same"
    return ""


class _StepInput(NamedTuple):
    """An input of which each step has a message.

    Attributes:
        name: as in the spec.
        topic: as it is played.
        bag_topic: that it is loaded from.
        slop_ns: see `Pairing`.
        times: the times of its messages in the window; None if they are not read.
    """

    name: str
    topic: str
    bag_topic: str
    slop_ns: int
    times: TopicTimes | None = None


def _messages_of_steps(context: Context) -> tuple[_StepInput, ...]:
    """Return the inputs that are paired by their stamps; none where only the run knows them."""
    inputs = []
    playback = context.spec.playback
    for name, played in playback.inputs.items():
        if begins_with_header(played.format) is False or played.rate != "step":
            continue
        source = context.wiring.topic(played.source)
        bag_topic = direct_bag_topic(source, context.spec, context.wiring)
        if not bag_topic or begins_with_header(played.format) is None:
            # What a preprocessor publishes, and with which stamps, only the run tells.
            return ()
        slop_ns = (played.pairing or playback.pairing).slop.ns
        inputs.append(_StepInput(name, context.wiring.topic(name), bag_topic, slop_ns))
    if len(inputs) < 2:
        return ()
    times = context.input_times
    if any(step_input.name not in times for step_input in inputs):
        return tuple(inputs)
    return tuple(step_input._replace(times=times[step_input.name]) for step_input in inputs)


def _unplayed(context: Context, inputs: Sequence[_StepInput]) -> list[UnplayedMessages]:
    """At least so many messages of each input are not played, as far as the bag tells."""
    if not inputs:
        return []
    slops_ns = [step_input.slop_ns for step_input in inputs]
    stamps = [step_input.times.stamps_ns for step_input in inputs if step_input.times is not None]
    if len(stamps) < len(inputs):
        bag_topics = {step_input.topic: step_input.bag_topic for step_input in inputs}
        return _by_counts(context, bag_topics, max(slops_ns))
    steps = pair_nearest(stamps, slops_ns)
    return [
        UnplayedMessages(
            topic=step_input.topic,
            count=len(stamped) - len(steps),
            total=len(stamped),
            slop_ns=max(slops_ns),
        )
        for step_input, stamped in zip(inputs, stamps, strict=True)
        if len(stamped) > len(steps)
    ]


def _by_counts(
    context: Context, bag_topics: dict[str, str], slop_ns: int
) -> list[UnplayedMessages]:
    """Return an input with more messages than another has at least so many without a partner."""
    counts = messages_in_window(context)
    if not all(topic in counts for topic in bag_topics.values()):
        return []
    fewest = min(counts[topic] for topic in bag_topics.values())
    return [
        UnplayedMessages(
            topic=topic, count=total - fewest, total=total, at_least=True, slop_ns=slop_ns
        )
        for topic, bag_topic in bag_topics.items()
        if (total := counts[bag_topic]) > fewest > 0
    ]
