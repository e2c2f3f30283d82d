"""The topics of a plan, and the sources of its playback inputs."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.language.spec import QoS, Spec
from r2bspec.plan.plan import InputPlan, TopicPlan
from r2bspec.wiring.build_wiring import harness_topic
from r2bspec.wiring.wiring import Endpoint, PhaseWiring, Wiring


def plan_inputs(spec: Spec, wiring: Wiring) -> tuple[InputPlan, ...]:
    """The playback inputs, in the order of the spec."""
    translations = spec.playback.timeline.translations
    return tuple(
        InputPlan(
            topic=harness_topic(name, wiring.namespace),
            type=each.format,
            source=(source := harness_topic(each.source, wiring.namespace)),
            bag_topic=direct_bag_topic(source, spec, wiring),
            qos=each.qos,
            timestamp=each.timestamp,
            later_ns=later.ns if (later := translations.get(name)) is not None else 0,
            slop_ns=(each.pairing or spec.playback.pairing).slop.ns,
            recorded_rate=each.rate == "recorded",
        )
        for name, each in spec.playback.inputs.items()
    )


def direct_bag_topic(source: str, spec: Spec, wiring: Wiring) -> str:
    """The bag topic that is loaded as `source` without preprocessing; empty if there is none."""
    if any(each.is_node for each in wiring.preprocess.publishers(source)):
        return ""
    for bag_topic, target in spec.data_loader.topics.items():
        if harness_topic(target, wiring.namespace) == source:
            return bag_topic
    return ""


def plan_topics(spec: Spec, wiring: Wiring) -> tuple[TopicPlan, ...]:
    """All topics of the run, by phase and name.

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
            each
            for each in phase.subscriptions(name)
            if not (straight and each.owner == "recorder")
        )
        if (
            readers
            or phase.possible_subscribers
            or any(each.is_node for each in phase.publishers(name))
        ):
            yield _topic(phase, name, readers)


def _topic(phase: PhaseWiring, name: str, readers: tuple[Endpoint, ...] | None = None) -> TopicPlan:
    writers = phase.publishers(name)
    readers = phase.subscriptions(name) if readers is None else readers
    types = (each.type for each in (*writers, *readers) if each.type)
    return TopicPlan(
        name=name,
        type=next(types, ""),
        phase=phase.phase,
        writers=_owners(writers),
        readers=_owners(readers),
        qos=_qos_profiles((*writers, *readers)),
    )


def _qos_profiles(endpoints: tuple[Endpoint, ...]) -> dict[str, QoS]:
    """The known profiles of nodes; those of the harness are in inputs and monitors."""
    return {each.owner: each.qos for each in endpoints if each.is_node and each.qos is not None}


def _owners(endpoints: tuple[Endpoint, ...]) -> tuple[str, ...]:
    # The loader is also the recorder: one process has both roles.
    names = ("loader" if each.owner == "recorder" else each.owner for each in endpoints)
    return tuple(dict.fromkeys(names))
