"""Compiling a spec to the plan of its run.

Topics and monitors are in `r2bspec.plan.topic_plans`, processes in `r2bspec.plan.process_plans`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import msgspec

from r2bspec._version import __version__
from r2bspec.bags.recording import merge_indexes
from r2bspec.language.spec import BagSource, Call, Objective, Pacing, ReadyProbe, ServiceCall, Spec
from r2bspec.language.spec_benchmark import ACCEPTED, FEEDBACK
from r2bspec.plan import plan as plans
from r2bspec.plan.process_plans import plan_external, plan_lifecycle, plan_processes
from r2bspec.plan.topic_plans import plan_inputs, plan_monitors, plan_topics
from r2bspec.plan.wiring.build_wiring import build_wiring
from r2bspec.plan.wiring.companion_files import NO_COMPANION_FILES, CompanionFiles
from r2bspec.plan.wiring.wiring import Wiring

if TYPE_CHECKING:
    from r2bspec.bags.recording import BagIndex


def compile_plan(
    spec: Spec,
    bag: BagIndex | Sequence[BagIndex | None] | None,
    *,
    companion_files: CompanionFiles = NO_COMPANION_FILES,
    wiring: Wiring | None = None,
) -> plans.Plan:
    """Compile the plan of a run.

    This is a pure function: the same spec, bag metadata and version of r2bspec result in the same
    plan on every machine. It uses no clock, no environment variables and no files.

    Args:
        spec: a spec without errors of `r2bspec.check`; otherwise the plan may be incomplete and
            must not be run.
        bag: the index of the bag, or of each of several; None if unknown: the types of bag topics
            are then empty and their counts zero.
        companion_files: the companion files of the spec, such as parameter files; by default none.
        wiring: the wiring of the spec with these types and companion files, where the caller has
            built it already.
    """
    bags = list(bag) if isinstance(bag, Sequence) else [bag]
    together = merge_indexes([index for index in bags if index is not None])
    types = together.types(spec.data_loader.topics) if together is not None else None
    wiring = wiring or build_wiring(spec, bag_types=types, companion_files=companion_files)
    # An unknown recording is assumed to have all topics.
    sources = spec.data_loader.sources or (BagSource(),)
    known = [*bags, *[None] * len(sources)][: len(sources)]
    datasets = tuple(
        _dataset(spec, source, bag, wiring, only_held=len(sources) > 1 and bag is not None)
        for source, bag in zip(sources, known, strict=True)
    )
    rates = dict.fromkeys(rate.hz for rate in spec.benchmark.rates)
    play = tuple(_play_at(spec, hz) for hz in ([0.0] if spec.has_own_rate else rates))
    objectives = active_objectives(spec)
    sustained_hz = _sustained_hz(objectives)
    at_peak = any(objective.at_peak for objective in objectives.values())
    play_at_peak = _play_at(spec, 0.0) if at_peak and spec.benchmark.search is not None else None
    return plans.Plan(
        generator=f"r2bspec {__version__}",
        name=spec.name,
        title=spec.title,
        description=spec.description,
        labels=spec.labels,
        namespace=wiring.namespace,
        environment=spec.environment,
        transport=spec.transport.kind,
        largest_message_bytes=_largest_message_bytes(spec, together),
        dataset=datasets[0],
        processes=plan_processes(spec, wiring),
        topics=plan_topics(spec, wiring),
        playback_mode=spec.playback.mode,
        buffer=spec.playback.buffer,
        inputs=plan_inputs(spec, wiring, spec.playback.played),
        monitors=plan_monitors(spec, wiring),
        phases=tuple(_phases(spec, sustained_hz, plays=bool(play or play_at_peak))),
        **Pacing.fields_of(spec.benchmark),
        search=_search(spec),
        sustained_hz=sustained_hz,
        play=play,
        objectives=objectives,
        datasets=datasets if len(datasets) > 1 else (),
        timeline=_timeline(spec),
        harness=plans.HarnessPlan(placement=spec.harness.placement),
        external=plan_external(wiring),
        setup=plan_setup(spec),
        ready=plan_ready(spec, wiring),
        after_ready=plan_after_ready(spec, wiring),
        gate=gate_plan(spec),
        segment_bytes=0 if spec.transport.segment is None else spec.transport.segment.bytes,
        play_at_peak=play_at_peak,
        # A search and probes of sustained rates alone are made in one start.
        starts=spec.starts if play or play_at_peak else 1,
        unpaired=spec.playback.unpaired,
        clock=spec.playback.clock,
        requires=msgspec.UNSET if spec.requires is None else spec.requires,
        lifecycle=plan_lifecycle(wiring) or msgspec.UNSET,
        calls=plan_calls(spec, wiring) or msgspec.UNSET,
        anatomy=spec.benchmark.anatomy or msgspec.UNSET,
        latched=plan_inputs(spec, wiring, spec.playback.latched) or msgspec.UNSET,
        arrivals=spec.irregular_arrivals or msgspec.UNSET,
        network=spec.network or msgspec.UNSET,
    )


def active_objectives(spec: Spec) -> dict[str, Objective]:
    """Return the active objectives: their level is not `off`, and their `when` is true."""
    return {
        name: objective
        for name, objective in spec.slos.items()
        if objective.level != "off"
        and all(str(spec.variables.get(key)) == str(value) for key, value in objective.when.items())
    }


def _dataset(
    spec: Spec, source: BagSource, bag: BagIndex | None, wiring: Wiring, *, only_held: bool
) -> plans.DatasetPlan:
    loader = spec.data_loader
    topics = []
    for name, target in loader.topics.items():
        info = None if bag is None else bag.find(name)
        if info is None and only_held:
            continue
        topics.append(
            plans.BagTopicPlan(
                bag_topic=name if info is None else info.name,
                topic=wiring.topic(target),
                type="" if info is None else info.type,
                count=0 if info is None else info.count,
                rate_hz=0.0 if info is None else info.rate_hz,
            )
        )
    return plans.DatasetPlan(
        source=source.dataset or source.path,
        kind="synthetic" if bag is not None and bag.synthetic else "recorded",
        sha256=source.sha256,
        start_ns=loader.window.start.ns,
        end_ns=None if loader.window.end is None else loader.window.end.ns,
        topics=tuple(topics),
        publish_tf=loader.publish_tf,
        publish_tf_static=loader.publish_tf_static,
        real_time=loader.real_time,
    )


def _largest_message_bytes(spec: Spec, bag: BagIndex | None) -> int:
    """Return the largest message among the bag topics that are used, or 0 if one is unknown."""
    sizes = []
    for name in spec.data_loader.topics:
        info = None if bag is None else bag.find(name)
        if info is None or info.max_message_bytes is None:
            return 0
        sizes.append(info.max_message_bytes)
    return max(sizes, default=0)


def _search(spec: Spec) -> plans.SearchPlan | None:
    search = spec.benchmark.search
    if search is None:
        return None
    return plans.SearchPlan(
        min_hz=search.min.hz,
        max_hz=search.max.hz,
        precision=search.precision.fraction,
        probe_ns=search.probe.ns,
        holds=search.holds,
        confidence=search.confidence.fraction,
        confirm_ns=search.confirm.ns,
    )


def _timeline(spec: Spec) -> plans.TimelinePlan | None:
    if spec.playback.mode != "timeline":
        return None
    return plans.TimelinePlan(
        speed=spec.playback.timeline.speed.fraction,
        recorded=spec.playback.record_timeline,
        shift_tf=spec.playback.tf == "shift",
    )


def gate_plan(spec: Spec) -> plans.GatePlan:
    """Return how the verdicts of a spec are decided, and their consequences."""
    gate = spec.benchmark.gate
    return plans.GatePlan(
        confidence=gate.confidence.fraction,
        inconclusive=gate.inconclusive,
        confirm=gate.confirm,
        time_budget_ns=0 if gate.time_budget is None else gate.time_budget.ns,
        interference=gate.interference,
    )


def _sustained_hz(objectives: dict[str, Objective]) -> tuple[float, ...]:
    rates = {
        objective.at.hz
        for objective in objectives.values()
        if objective.at is not None
        and any(requirement.metric == "sustained" for requirement in objective.require)
    }
    return tuple(sorted(rates))


def _play_at(spec: Spec, rate_hz: float) -> plans.PlayPlan:
    return plans.PlayPlan(
        rate_hz=rate_hz,
        duration_ns=spec.benchmark.duration.ns,
        iterations=spec.benchmark.iterations,
        max_iterations=spec.benchmark.max_iterations,
    )


def _phases(spec: Spec, sustained_hz: tuple[float, ...], *, plays: bool) -> Iterator[str]:
    """Return the phases of the run, in order."""
    states = {node.lifecycle for node in spec.graph.nodes.values()}
    has_phase = {
        "setup": spec.setup,
        "load": spec.plays_topics or spec.recorded_calls,
        "preprocess": spec.preprocessors,
        "start": True,
        "graph": True,
        "configure": states & {"inactive", "active"},
        "activate": "active" in states,
        "ready": spec.ready,
        "after_ready": spec.after_ready,
        "warm_up": spec.benchmark.warm_up.ns,
        "search": spec.benchmark.search is not None,
        "sustained": sustained_hz,
        "play": plays,
        "collect": True,
    }
    return (phase for phase, is_present in has_phase.items() if is_present)


def plan_setup(spec: Spec) -> tuple[plans.SetupPlan, ...]:
    """Return the setup steps, in the order of the spec."""
    return tuple(
        plans.SetupPlan(
            name=name,
            argv=step.command,
            creates=step.creates,
            directory=step.directory,
            env=step.env,
            timeout_ns=step.timeout.ns,
        )
        for name, step in spec.setup.items()
    )


def plan_calls(spec: Spec, wiring: Wiring) -> tuple[plans.CallPlan, ...]:
    """Return the services and actions that are called, in the order of the spec."""
    return tuple(_call(name, call, wiring) for name, call in spec.playback.calls.items())


def _call(name: str, call: Call, wiring: Wiring) -> plans.CallPlan:
    action, service = call.action, call.service or ServiceCall(name="", type="")
    return plans.CallPlan(
        name=name,
        target=wiring.topic(service.name if action is None else action.name),
        type=service.type if action is None else action.type,
        request=service.request if action is None else action.goal,
        each=call.each or msgspec.UNSET,
        every=call.every if call.every > 1 else msgspec.UNSET,
        source=msgspec.UNSET if call.source is None else wiring.topic(call.source),
        success=call.success,
        accepted="" if action is None else f"{name}{ACCEPTED}",
        feedback=f"{name}{FEEDBACK}" if call.feedback else "",
    )


def plan_ready(spec: Spec, wiring: Wiring) -> tuple[plans.ProbePlan, ...]:
    """Return the readiness probes, in the order of the spec."""
    return tuple(_probe(name, probe, wiring) for name, probe in spec.ready.items())


def _probe(name: str, probe: ReadyProbe, wiring: Wiring) -> plans.ProbePlan:
    kind: plans.ProbeKind = "service" if probe.service else "topic"
    target, pattern = wiring.topic(probe.service or probe.topic), ""
    if probe.log is not None:
        kind, target, pattern = "log", probe.log.process, probe.log.pattern
    elif probe.file:
        kind, target = "file", probe.file
    return plans.ProbePlan(
        name=name, kind=kind, target=target, pattern=pattern, timeout_ns=probe.timeout.ns
    )


def plan_after_ready(spec: Spec, wiring: Wiring) -> tuple[plans.AfterReadyPlan, ...]:
    """Return the `after_ready` steps, in the order of the spec."""
    return tuple(
        plans.AfterReadyPlan(
            name=name,
            argv=step.command,
            service=wiring.topic(step.service.name) if step.service else "",
            service_type=step.service.type if step.service else "",
            request=step.service.request if step.service else {},
            timeout_ns=step.timeout.ns,
        )
        for name, step in spec.after_ready.items()
    )
