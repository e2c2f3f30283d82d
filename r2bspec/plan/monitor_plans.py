"""The monitors of a plan, and the topics on the paths to them."""

from __future__ import annotations

from r2bspec.language.spec import Monitor, Spec
from r2bspec.plan.plan import MonitorPlan, TapPlan
from r2bspec.wiring.build_wiring import harness_topic
from r2bspec.wiring.wiring import PhaseWiring, Wiring


def plan_monitors(spec: Spec, wiring: Wiring) -> tuple[MonitorPlan, ...]:
    """The monitors, in the order of the spec."""
    return tuple(
        MonitorPlan(
            name=name,
            topic=harness_topic(each.topic, wiring.namespace),
            type=each.format,
            match=each.match,
            qos=each.qos,
            ratio_inputs=each.ratio.inputs,
            ratio_outputs=each.ratio.outputs,
            label=each.label,
            answers=_answers(each, spec, wiring),
            taps=_taps(each, wiring) if each.taps else (),
        )
        for name, each in spec.monitors.items()
    )


def _answers(monitor: Monitor, spec: Spec, wiring: Wiring) -> tuple[str, ...]:
    """The inputs of a timeline that a monitor answers, in the order of the spec.

    Without `answers`, they are those with a known path to the monitor; all if there is none.
    """
    if spec.playback.mode != "timeline":
        return ()
    inputs = [harness_topic(name, wiring.namespace) for name in spec.playback.inputs]
    named = {harness_topic(name, wiring.namespace) for name in monitor.answers}
    topic = harness_topic(monitor.topic, wiring.namespace)
    known = wiring.measure.upstream_of(topic)
    return tuple(
        [each for each in inputs if each in named]
        or [each for each in inputs if each in known]
        or inputs
    )


def _taps(monitor: Monitor, wiring: Wiring) -> tuple[TapPlan, ...]:
    """The topics of known type between the player and a monitor."""
    phase = wiring.measure
    topic = harness_topic(monitor.topic, wiring.namespace)
    played = [
        each.topic for each in phase.endpoints_of("player") if each.topic_is_key and each.qos_path
    ]
    between = phase.downstream_of(played) & phase.upstream_of(topic)
    return tuple(
        TapPlan(topic=name, type=kind)
        for name in phase.topics
        if name in between - {topic, *played} and (kind := _type(phase, name))
    )


def _type(phase: PhaseWiring, topic: str) -> str:
    ends = (*phase.publishers(topic), *phase.subscriptions(topic))
    return next((each.type for each in ends if each.type), "")
