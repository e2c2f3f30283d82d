"""The topics of a plan: the sources of its playback inputs, its and monitors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from r2bspec.language.spec import Monitor, MonitorSettings, PlaybackInput, Spec
from r2bspec.plan.plan import InputPlan, MonitorPlan, TopicPlan
from r2bspec.plan.wiring.build_wiring import latched_qos
from r2bspec.plan.wiring.wiring import PhaseWiring, WiredEndpoint, Wiring


def plan_inputs(
    spec: Spec, wiring: Wiring, inputs: Mapping[str, PlaybackInput]
) -> tuple[InputPlan, ...]:
    """Return the plans of playback inputs, in the order of the spec."""
    translations = spec.playback.timeline.translations
    return tuple(
        InputPlan(
            topic=wiring.topic(name),
            type=played.format,
            source=(source := wiring.topic(played.source)),
            bag_topic=direct_bag_topic(source, spec, wiring),
            qos=latched_qos(played),
            timestamp=played.timestamp,
            later_ns=later.ns if (later := translations.get(name)) is not None else 0,
            slop_ns=(played.pairing or spec.playback.pairing).slop.ns,
            recorded_rate=played.rate == "recorded",
            ahead_ns=played.clock_ahead.ns,
        )
        for name, played in inputs.items()
    )


def direct_bag_topic(source: str, spec: Spec, wiring: Wiring) -> str:
    """Return the bag topic that is loaded as `source` without preprocessing.

    Empty if there is none.
    """
    if any(publisher.is_node for publisher in wiring.preprocess.publishers(source)):
        return ""
    for bag_topic, target in spec.data_loader.topics.items():
        if wiring.topic(target) == source:
            return bag_topic
    return ""


def plan_topics(spec: Spec, wiring: Wiring) -> tuple[TopicPlan, ...]:
    """Return all topics of the run, by phase and name.

    In the preprocess phase the loader publishes only topics to which a preprocessor subscribes or,
    if its interface is unknown, may subscribe. It records only outputs of preprocessors.
    """
    before = _preprocess_topics(spec, wiring) if wiring.preprocess.nodes else ()
    return (*before, *(_topic(wiring.measure, name) for name in wiring.measure.topics))


def _preprocess_topics(spec: Spec, wiring: Wiring) -> Iterator[TopicPlan]:
    phase = wiring.preprocess
    for name in phase.topics:
        straight = bool(direct_bag_topic(name, spec, wiring))
        readers = tuple(
            endpoint
            for endpoint in phase.subscriptions(name)
            if not (straight and endpoint.owner == "recorder")
        )
        if (
            readers
            or phase.possible_subscribers
            or any(endpoint.is_node for endpoint in phase.publishers(name))
        ):
            yield _topic(phase, name, readers)


def _topic(
    phase: PhaseWiring, name: str, readers: tuple[WiredEndpoint, ...] | None = None
) -> TopicPlan:
    writers = phase.publishers(name)
    readers = phase.subscriptions(name) if readers is None else readers
    return TopicPlan(
        name=name,
        type=_type((*writers, *readers)),
        phase=phase.phase,
        writers=_owners(writers),
        readers=_owners(readers),
        # Those of the harness are in inputs and monitors.
        qos={
            endpoint.owner: endpoint.qos
            for endpoint in (*writers, *readers)
            if endpoint.is_node and endpoint.qos is not None
        },
    )


def _owners(endpoints: tuple[WiredEndpoint, ...]) -> tuple[str, ...]:
    # The loader is also the recorder: one process has both roles.
    names = ("loader" if endpoint.owner == "recorder" else endpoint.owner for endpoint in endpoints)
    return tuple(dict.fromkeys(names))


def plan_monitors(spec: Spec, wiring: Wiring) -> tuple[MonitorPlan, ...]:
    """Return the monitors, in the order of the spec."""
    calls = {end: name for name, call in spec.recorded_calls.items() for end in call.answers(name)}
    return tuple(
        MonitorPlan(
            name=name,
            topic=wiring.topic(monitor.topic),
            type=monitor.format,
            **MonitorSettings.fields_of(monitor),
            ratio_inputs=monitor.ratio.inputs,
            ratio_outputs=monitor.ratio.outputs,
            answers=answered_inputs(monitor, spec, wiring, calls.get(name, "")),
        )
        for name, monitor in spec.outputs.items()
    )


def answered_inputs(
    monitor: Monitor, spec: Spec, wiring: Wiring, call: str = ""
) -> tuple[str, ...]:
    """Return the inputs of a timeline that a monitor answers, in the order of the spec.

    Without `answers`, they are those with a known path to the monitor; all if there is none. A
    monitor of a recorded `call` answers the call itself.
    """
    if spec.playback.mode != "timeline":
        return ()
    if call:
        return (call,)
    inputs = [wiring.topic(name) for name in spec.playback.played]
    named = {wiring.topic(name) for name in monitor.answers}
    topic = wiring.topic(monitor.topic)
    known = wiring.measure.upstream_of(topic)
    return tuple(
        [topic for topic in inputs if topic in named]
        or [topic for topic in inputs if topic in known]
        or inputs
    )


def _type(endpoints: tuple[WiredEndpoint, ...]) -> str:
    return next((endpoint.type for endpoint in endpoints if endpoint.type), "")
