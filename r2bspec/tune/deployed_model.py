"""The model of a graph as a plan deploys it, from what was observed of another deployment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from r2bspec.language.spec import ProcessSettings
from r2bspec.plan.plan import GRAPH_ROLES, NodePlan, Plan, ProcessPlan
from r2bspec.tune.observed_graph import NotKnownError, ObservedProcess, ObservedSegment
from r2bspec.tune.queue_model import ExecutorModel, GraphModel, Observed, Reaction, Seconds

_SAME_FIELDS: Final = (
    *("namespace", "environment", "transport", "segment_bytes", "dataset", "datasets", "buffer"),
    *("playback_mode", "inputs", "harness", "external", "lifecycle", "calls", "clock", "unpaired"),
)
"""Of a plan: what the model does not know the effect of."""

_KNOWN_SETTINGS: Final = frozenset({"cpus", "executor", "threads"})
"""Of a process: what the model knows the effect of."""

_SAME_SETTINGS: Final = (
    *(name for name in ProcessSettings.__struct_fields__ if name not in _KNOWN_SETTINGS),
    "env",
    "join",
)
"""Of a process: the rest."""

_FURTHER_NODE: Final = 0.15
"""By how much each further node makes the executor's own work longer: its entities are waited for,
too. Measured with rclpy, two and three nodes."""

_DEFAULT_DEPTH: Final = 10

_FEW: Final = 0.01
"""Messages for each step, of a topic that need not be played: parameters, say."""


@dataclass(frozen=True)
class Draw:
    """What a run does not show, drawn for one simulation.

    Attributes:
        segments: the places of the observed segments to take.
        within: the transport within a process, as a share of that between two.
        overhead: a factor of the work of executors whose nodes change.
        slowness: a factor of all work.
        order: the seed of the order in which executors of rclpy, whose nodes are a set, look at
            them.
    """

    segments: tuple[int, ...]
    within: float
    overhead: float
    slowness: float
    order: int


def draw(segments: Sequence[int], scatter: float, random: np.random.Generator) -> Draw:
    """Draw what a run does not show.

    Args:
        segments: the places of those that may be taken.
        scatter: the standard deviation of the logarithm of the work, from one iteration to another.
        random: the source.
    """
    taken = random.choice(segments, len(segments))
    return Draw(
        segments=tuple(int(place) for place in taken),
        within=float(np.exp(random.uniform(np.log(0.1), 0.0))),
        overhead=float(np.exp(random.normal(0.0, 0.2))),
        slowness=float(np.exp(random.normal(0.0, scatter))),
        order=int(random.integers(1 << 32)),
    )


def check_changes(before: Plan, after: Plan) -> None:
    """Refuse deployments that differ in what the model does not know.

    Raises:
        NotKnownError: they do.
    """
    for name in _SAME_FIELDS:
        if getattr(before, name) != getattr(after, name):
            raise NotKnownError(f"the model does not know what another {name} changes")
    if any(each.recorded_rate for each in after.inputs):
        raise NotKnownError("an input is played at the rate of its recording")
    if after.external:
        raise NotKnownError(f"{after.external[0].name} is external: it was not observed")
    nodes = {node.name: (process, node) for process, node in _nodes(before)}
    for process, node in _nodes(after):
        if node.name not in nodes:
            raise NotKnownError(f"{node.node} was not observed")
        of, same = nodes.pop(node.name)
        for name in NodePlan.__struct_fields__:
            if getattr(node, name) != getattr(same, name):
                raise NotKnownError(f"the model does not know what other {name} of {node.node} do")
        for name in _SAME_SETTINGS:
            if getattr(process, name) != getattr(of, name):
                raise NotKnownError(f"the model does not know what {name} of {node.node} changes")
        if process.role != of.role:
            raise NotKnownError(f"{node.node} becomes another kind of program")
    other_qos = _fixed_qos(before).items() ^ _fixed_qos(after).items()
    for topic, _ in sorted(topic for topic, _ in other_qos):
        raise NotKnownError(f"the model knows of the QoS of {topic} the depth only")
    if nodes:
        raise NotKnownError(f"{next(iter(nodes))} is no longer part of the graph")


def _fixed_qos(plan: Plan) -> dict[tuple[str, str], tuple[str, ...]]:
    """What may not change of the profiles of each end of a topic."""
    return {
        (topic.name, owner): (qos.reliability, qos.durability, qos.history)
        for topic in plan.topics
        if topic.phase == "measure"
        for owner, qos in topic.qos.items()
    }


def _check_topics(plan: Plan, segment: ObservedSegment) -> None:
    """Refuse nodes whose messages come from somewhere else, and monitors without any.

    Raises:
        NotKnownError: there is one.
    """
    published = {topic.topic for topic in plan.inputs}
    published |= {
        topic
        for inputs in segment.inputs.values()
        for each in inputs
        for callback in each.callbacks
        for topic, _ in callback.outputs
    }
    for node, inputs in segment.inputs.items():
        for each in inputs:
            known = each.topic in published and (each.topic, node) in segment.transports
            if each.topic and not known and len(each.callbacks) > _FEW * segment.steps:
                raise NotKnownError(f"{node} takes {each.topic}, which the model does not play")
    for monitor in plan.monitors:
        if (
            monitor.topic not in published
            or (monitor.topic, monitor.name) not in segment.transports
        ):
            raise NotKnownError(f"no message of {monitor.name} was seen")


def _nodes(plan: Plan) -> Iterator[tuple[ProcessPlan, NodePlan]]:
    for process in graph_processes(plan):
        for node in process.nodes:
            yield process, node


def graph_nodes(plan: Plan) -> frozenset[str]:
    """The full names of the nodes of the graph under test."""
    return frozenset(node.name for _, node in _nodes(plan))


def graph_processes(plan: Plan) -> Iterator[ProcessPlan]:
    """The processes of the graph under test."""
    for process in plan.processes:
        if (
            process.phase == "measure"
            and process.role in {*GRAPH_ROLES, "harness"}
            and process.nodes
        ):
            yield process


class DeployedModel:
    """Makes models of a graph as a plan deploys it.

    Args:
        segments: what was observed, with one plan.
        before: that plan.
        after: the plan that is predicted.
        own_cores: of the machine of that run.
        cores: of the machine it is for.

    Raises:
        NotKnownError: the model does not know a part of the deployment.
    """

    def __init__(
        self,
        segments: Sequence[ObservedSegment],
        before: Plan,
        after: Plan,
        *,
        own_cores: int,
        cores: int,
    ) -> None:
        check_changes(before, after)
        self._segments = segments
        self._before, self._after = before, after
        self._own_cores = own_cores
        self._cores = cores
        self._homes = {
            name: dict(_homes(plan, segments[0]))
            for name, plan in (("old", before), ("new", after))
        }
        for process in graph_processes(after):
            for node in process.nodes:
                if not all(node.node in segment.inputs for segment in segments):
                    raise NotKnownError(
                        f"no callback of {node.node} was seen: its program has no anatomy, or its "
                        "nodes have other names"
                    )
        for name, home in self._homes["old"].items():
            if not all(home in segment.processes for segment in segments):
                raise NotKnownError(f"no callback of {name} was seen in its process, {home}")
        for process in graph_processes(after):
            self._check_executor(process)
        for segment in segments:
            _check_topics(after, segment)

    def counts(self, drawn: Draw) -> list[int]:
        """The steps of the segments of a draw."""
        return [self._segments[place].steps for place in drawn.segments]

    def model(self, drawn: Draw) -> GraphModel:
        """The model with what was drawn."""
        segments = [self._segments[place] for place in drawn.segments]
        executors = [
            self._executor(process, nodes, segments, drawn)
            for process in graph_processes(self._after)
            for nodes in _executors(process)
        ]
        return GraphModel(
            executors=tuple(executors),
            inputs=tuple(each.topic for each in self._after.inputs),
            monitors={monitor.name: monitor.topic for monitor in self._after.monitors},
            transports=self._transports(segments, drawn),
            cores=self._cores * float(np.mean([each.cores for each in segments])) / self._own_cores,
            others=float(np.mean([segment.others for segment in segments])),
            slowness=drawn.slowness,
        )

    def _check_executor(self, process: ProcessPlan) -> None:
        names = tuple(node.node for node in process.nodes)
        if process.role == "command":
            seen = self._segments[0].processes.get(process.name)
            if seen is not None and (len(seen.nodes) > 1 or seen.threads > 1):
                raise NotKnownError(
                    f"{process.name} starts several nodes or threads, whose executors are not seen"
                )
        if process.role == "host" and _threads(process, self._cores) > 1:
            same = next(
                (
                    each
                    for each in graph_processes(self._before)
                    if tuple(node.node for node in each.nodes) == names
                ),
                None,
            )
            if same is None or (same.executor, same.threads) != (process.executor, process.threads):
                raise NotKnownError(
                    f"{process.name} gets a multi-threaded executor of Python, whose cost was not "
                    "observed"
                )

    def _executor(
        self,
        process: ProcessPlan,
        nodes: tuple[str, ...],
        segments: Sequence[ObservedSegment],
        drawn: Draw,
    ) -> ExecutorModel:
        old = {name: self._homes["old"][name] for name in nodes}
        seen = [
            segment.processes[home]
            for segment in segments
            for home in dict.fromkeys(old.values())
            if home in segment.processes
        ]
        same = len(set(old.values())) == 1 and set(seen[0].nodes) == set(nodes)
        longer = 1.0
        if not same:
            before = float(np.mean([len(each.nodes) for each in seen]))
            longer = drawn.overhead * (1 + _FURTHER_NODE * (len(nodes) - before))
        is_python = process.role in {"host", "harness"}
        order = np.random.default_rng(drawn.order).permutation(len(nodes))
        reactions = [
            reaction
            for name in ([nodes[place] for place in order] if is_python else nodes)
            for reaction in sorted(
                self._reactions(name, segments), key=lambda each: bool(each.topic)
            )
        ]
        return ExecutorModel(
            process=process.name,
            # rclcpp looks at all timers before all subscriptions, rclpy at those of each node.
            reactions=tuple(
                sorted(reactions, key=lambda each: bool(each.topic)) if not is_python else reactions
            ),
            threads=_threads(process, self._cores),
            wake_s=np.concatenate([each.wake_s for each in seen]),
            lead_s=_mean(seen, "lead_s"),
            tail_s=longer * _mean(seen, "tail_s"),
            idle_s=longer * _mean(seen, "idle_s"),
            processor_share=_mean(seen, "processor_share"),
            is_python=is_python,
            cpus=frozenset(process.cpus),
        )

    def _reactions(self, node: str, segments: Sequence[ObservedSegment]) -> Iterator[Reaction]:
        by_segment = [
            {(each.topic, each.number): each for each in segment.inputs.get(node, ())}
            for segment in segments
        ]
        joins = segments[0].joins.get(node, frozenset())
        for key in dict.fromkeys(key for inputs in by_segment for key in inputs):
            observed = [inputs.get(key) for inputs in by_segment]
            callbacks: Observed = tuple(each.callbacks if each else () for each in observed)
            topic, _ = key
            if topic and not any((topic, node) in segment.transports for segment in segments):
                continue
            fused = topic in joins
            if fused:
                alone = _only(callbacks, publishing=False)
                callbacks = _only(callbacks, publishing=True)
                if sum(map(len, callbacks)) < sum(map(len, alone)) / 10:
                    everything = [each for inputs in by_segment for each in inputs.values()]
                    callbacks = _only((each.callbacks for each in everything), publishing=True)
                    callbacks = (sum(callbacks, ()),) * len(segments)
            yield Reaction(
                node=node,
                topic=topic,
                callbacks=callbacks,
                depth=self._depth(node, topic),
                period_s=next((each.period_s for each in observed if each), 0.0),
                joins=joins if fused else frozenset(),
                alone=alone if fused else (),
            )

    def _depth(self, node: str, topic: str) -> int:
        full = {plan.node: plan.name for _, plan in _nodes(self._after)}.get(node, node)
        for plan in self._after.topics:
            if plan.name == topic and plan.phase == "measure" and full in plan.qos:
                qos = plan.qos[full]
                return qos.depth if qos.history == "keep_last" else 1 << 30
        return _DEFAULT_DEPTH

    def _transports(
        self, segments: Sequence[ObservedSegment], drawn: Draw
    ) -> Mapping[tuple[str, str], tuple[Seconds, ...]]:
        writers = {
            topic: node
            for segment in segments
            for node, inputs in segment.inputs.items()
            for each in inputs
            for callback in each.callbacks
            for topic, _ in callback.outputs
        }
        found = {}
        for topic, reader in dict.fromkeys(key for each in segments for key in each.transports):
            observed = tuple(each.transports.get((topic, reader), np.zeros(0)) for each in segments)
            was, becomes = (
                self._homes[name].get(writers.get(topic, "")) == self._homes[name].get(reader, "-")
                for name in ("old", "new")
            )
            if was == becomes:
                found[topic, reader] = observed
            else:
                factor = drawn.within if becomes else 1 / drawn.within
                found[topic, reader] = tuple(each * factor for each in observed)
        return found


def _homes(plan: Plan, segment: ObservedSegment) -> Iterator[tuple[str, str]]:
    for process in graph_processes(plan):
        for node in process.nodes:
            yield node.node, process.name
        if process.role == "command" and process.name in segment.processes:
            for name in segment.processes[process.name].nodes:
                yield name, process.name


def _executors(process: ProcessPlan) -> Iterator[tuple[str, ...]]:
    """The nodes of each executor of a process."""
    nodes = tuple(node.node for node in process.nodes)
    if any("component_container_isolated" in word for word in process.argv):
        yield from ((node,) for node in nodes)
    else:
        yield nodes


def _threads(process: ProcessPlan, cores: int) -> int:
    many = process.executor == "multi_threaded" or any(
        "component_container_mt" in word for word in process.argv
    )
    return (process.threads or cores) if many else 1


def _only(observed: Iterator[tuple] | Observed, *, publishing: bool) -> Observed:  # type: ignore[type-arg]
    return tuple(
        tuple(each for each in callbacks if bool(each.outputs) == publishing)
        for callbacks in observed
    )


def _mean(seen: Sequence[ObservedProcess], name: str) -> float:
    return float(np.mean([getattr(each, name) for each in seen]))
