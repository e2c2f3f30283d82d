"""From a spec to the plan of its run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from r2bspec._version import __version__
from r2bspec.plan.model import (
    BagTopicPlan,
    DatasetPlan,
    MonitorPlan,
    Plan,
    PlayPlan,
    SearchPlan,
)
from r2bspec.plan.processes import plan_processes
from r2bspec.plan.topics import plan_inputs, plan_topics
from r2bspec.spec.model import Spec
from r2bspec.wiring.build import build_wiring, harness_topic
from r2bspec.wiring.interfaces import Table
from r2bspec.wiring.model import Wiring

if TYPE_CHECKING:
    from r2bspec.data.model import BagIndex


def compile_plan(spec: Spec, bag: BagIndex | None, *, table: Table | None = None) -> Plan:
    """Work out everything that a run of a spec will do.

    A pure function: the same spec, bag metadata and version of r2bspec give the same plan on every
    machine. It reads no clock, no environment and no path.

    Args:
        spec: a spec in which `r2bspec.check` finds no error; otherwise the plan is as good as it
            can be, and running it makes no sense.
        bag: what is known of the bag; None leaves types of bag topics empty and counts zero.
        table: interfaces of Python nodes; by default those of the reference nodes.
    """
    wiring = build_wiring(spec, bag_types=bag_types(spec, bag), table=table)
    dataset = _dataset(spec, bag, wiring)
    play = tuple(_play(spec))
    sustained_hz = _sustained_hz(spec)
    return Plan(
        generator=f"r2bspec {__version__}",
        name=spec.name,
        title=spec.title,
        description=spec.description,
        labels=spec.labels,
        namespace=wiring.namespace,
        environment=spec.environment,
        transport=spec.transport,
        largest_message_bytes=_largest_message_bytes(spec, bag),
        dataset=dataset,
        processes=plan_processes(spec, wiring),
        topics=plan_topics(spec, wiring),
        playback_mode=spec.playback.mode,
        buffer=spec.playback.buffer,
        inputs=plan_inputs(spec, wiring),
        monitors=_monitors(spec, wiring),
        phases=tuple(_phases(spec, sustained_hz, play)),
        warm_up_ns=spec.benchmark.warm_up.ns,
        start_timeout_ns=spec.benchmark.start_timeout.ns,
        search=_search(spec),
        sustained_hz=sustained_hz,
        play=play,
        objectives=spec.slos,
    )


def bag_types(spec: Spec, bag: BagIndex | None) -> dict[str, str]:
    """The types of the bag topics that a spec names, by the name that it uses."""
    if bag is None:
        return {}
    found = {name: bag.find(name) for name in spec.data_loader.topics}
    return {name: info.type for name, info in found.items() if info is not None}


def _dataset(spec: Spec, bag: BagIndex | None, wiring: Wiring) -> DatasetPlan:
    source, window = spec.data_loader.bag, spec.data_loader.window
    topics = []
    for name, target in spec.data_loader.topics.items():
        info = None if bag is None else bag.find(name)
        topics.append(
            BagTopicPlan(
                bag_topic=name if info is None else info.name,
                topic=harness_topic(target, wiring.namespace),
                type="" if info is None else info.type,
                count=0 if info is None else info.count,
                rate_hz=0.0 if info is None else info.rate_hz,
            )
        )
    return DatasetPlan(
        source=source.dataset or source.path,
        kind="synthetic" if bag is not None and bag.synthetic else "recorded",
        sha256=source.sha256,
        start_ns=window.start.ns,
        end_ns=None if window.end is None else window.end.ns,
        topics=tuple(topics),
    )


def _largest_message_bytes(spec: Spec, bag: BagIndex | None) -> int:
    """The largest message among the bag topics that are used, or 0 if one is unknown."""
    sizes = []
    for name in spec.data_loader.topics:
        info = None if bag is None else bag.find(name)
        sizes.append(None if info is None else info.max_message_bytes)
    known = [size for size in sizes if size is not None]
    return max(known, default=0) if len(known) == len(sizes) else 0


def _monitors(spec: Spec, wiring: Wiring) -> tuple[MonitorPlan, ...]:
    return tuple(
        MonitorPlan(
            name=name,
            topic=harness_topic(each.topic, wiring.namespace),
            type=each.format,
            match=each.match,
            qos=each.qos,
        )
        for name, each in spec.monitors.items()
    )


def _search(spec: Spec) -> SearchPlan | None:
    search = spec.benchmark.search
    if search is None:
        return None
    return SearchPlan(
        min_hz=search.min.hz,
        max_hz=search.max.hz,
        precision=search.precision.fraction,
        probe_ns=search.probe.ns,
        holds=search.holds,
    )


def _sustained_hz(spec: Spec) -> tuple[float, ...]:
    rates = {
        objective.at.hz
        for objective in spec.slos.values()
        if objective.at is not None
        and any(each.metric == "sustained" for each in objective.require)
    }
    return tuple(sorted(rates))


def _play(spec: Spec) -> Iterator[PlayPlan]:
    for rate in dict.fromkeys(spec.benchmark.rates):
        yield PlayPlan(
            rate_hz=rate.hz,
            duration_ns=spec.benchmark.duration.ns,
            iterations=spec.benchmark.iterations,
        )


def _phases(
    spec: Spec, sustained_hz: tuple[float, ...], play: tuple[PlayPlan, ...]
) -> Iterator[str]:
    yield "load"
    if spec.preprocessors:
        yield "preprocess"
    yield "start"
    if spec.benchmark.warm_up.ns:
        yield "warm_up"
    if spec.benchmark.search is not None:
        yield "search"
    if sustained_hz:
        yield "sustained"
    if play:
        yield "play"
    yield "collect"
