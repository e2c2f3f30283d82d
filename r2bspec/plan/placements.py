"""The ways to distribute the nodes of a graph over processes, as settings of one lever.

Of n nodes there are far more than 2^n ways. What is proposed follows from the topics: nodes that
exchange the most bytes come into one process first, then the next, until all are in one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace as with_fields
from typing import Final

import msgspec
from msgspec.structs import replace

from r2bspec.diagnostics.quote import quoted_list
from r2bspec.language.spec import Container, Node, Spec
from r2bspec.language.spec_graph import PROCESS_KEYS
from r2bspec.plan.plan import ProcessPlan
from r2bspec.plan.process_plans import (
    SHARED_CONTAINER_NAME,
    SHARED_PROCESS_NAME,
    find_places,
    graph_processes,
    reserved_names,
)
from r2bspec.plan.tuning_space import Setting
from r2bspec.plan.wiring.python_source import StartStyle
from r2bspec.plan.wiring.wiring import NodeWiring, Wiring

_MAX_GROUPINGS: Final = 4
"""Groupings by topics that are proposed, of all between no node and every node in a container."""

_SHOWN_NODES: Final = 4

_ALONE: Final[Mapping[StartStyle, str]] = {
    "ros_arguments": "a constructor without **kwargs that it passes to Node starts in a process of "
    "its own",
    "main": "what initialises ROS itself runs in a process of its own",
}
"""Why code can share no process, by the style of its start."""

_LARGE: Final = 1_000_000
_TYPICAL_BYTES: Final[Mapping[str, int]] = {
    "sensor_msgs/msg/Image": _LARGE,
    "sensor_msgs/msg/PointCloud2": _LARGE,
    "stereo_msgs/msg/DisparityImage": _LARGE,
    "sensor_msgs/msg/CompressedImage": 200_000,
    "nav_msgs/msg/OccupancyGrid": 200_000,
    "visualization_msgs/msg/MarkerArray": 20_000,
    "sensor_msgs/msg/LaserScan": 10_000,
}
_SMALL: Final = 200
"""Sizes that order topics whose messages are not recorded; nothing else follows from them."""


class Placement(msgspec.Struct, frozen=True):
    """One distribution of the nodes, and the processes of the graph that it leads to.

    Attributes:
        containers: every container that is declared with it.
    """

    setting: Setting
    processes: tuple[ProcessPlan, ...]
    containers: Mapping[str, Container]


class _Change(msgspec.Struct, frozen=True):
    """What differs from today: the placement, containers that are added, and who is in them."""

    text: str
    placement: str
    containers: dict[str, Container] = {}
    homes: dict[str, str] = {}


def find_placements(
    spec: Spec, wiring: Wiring, *, by_placement: bool, by_containers: bool
) -> tuple[tuple[Placement, ...], tuple[str, ...]]:
    """The distributions, today's first, and why others are left out.

    Args:
        spec: without errors.
        wiring: of it.
        by_placement: whether `graph.placement` may change.
        by_containers: whether nodes may change their containers, and containers be added.
    """
    finder = _Finder(spec, wiring)
    if by_placement or by_containers:
        finder.note_those_alone()
    proposed: list[_Change] = []
    if by_placement:
        proposed += finder.whole_graph()
    if by_containers:
        proposed += finder.containers()
    return finder.admitted(proposed), tuple(dict.fromkeys(finder.left_out))


def typical_bytes(message_type: str) -> int:
    """The size of a message of a type, as far as it orders topics."""
    return _TYPICAL_BYTES.get(message_type, _SMALL)


_Groups = tuple[tuple[str, ...], ...]
"""Nodes that share a container, by their names."""


class _Finder:
    """Proposes distributions, and admits those that the spec allows."""

    def __init__(self, spec: Spec, wiring: Wiring) -> None:
        self._spec = spec
        self._wiring = wiring
        self._today = tuple(graph_processes(spec, wiring))
        self._kept = set(spec.tune.keep)
        self.left_out: list[str] = []
        sharing = [node for node in wiring.measure.nodes if node.shares_process]
        self._loose = [node for node in sharing if node.node.container not in spec.containers]
        self._contained = [node for node in sharing if node.node.container in spec.containers]

    def note_those_alone(self) -> None:
        """Say of which Python nodes the code keeps them in a process of their own."""
        for style, why in _ALONE.items():
            nodes = [
                node.key
                for node in self._wiring.measure.nodes
                if node.node.kind.shares_process and node.start.style == style
            ]
            if nodes:
                self._leave_out(f"{_names(nodes)} with others", why)

    def whole_graph(self) -> Iterator[_Change]:
        """The other values of `graph.placement`, but for the process of the harness."""
        placement = self._spec.graph.placement
        if placement != "separate" and self._loose:
            yield _Change("separate", "separate")
        names = {SHARED_PROCESS_NAME, SHARED_CONTAINER_NAME} & {
            *self._spec.graph.nodes,
            *self._spec.containers,
        }
        roles = [node.role for node in self._loose]
        if placement == "shared" or len(set(roles)) == len(roles):
            return
        if names:
            self._leave_out(
                "shared", f"{quoted_list(sorted(names))} would be the name of its process"
            )
        elif lost := [node.key for node in self._loose if _has_settings(node.node)]:
            self._leave_out(
                "shared", f"settings of the process of {quoted_list(lost)} would be lost"
            )
        else:
            yield _Change("shared", "shared")

    def containers(self) -> Iterator[_Change]:
        """Nodes in containers: by their topics, in one that is declared, and each in its own."""
        loose = self._movable(self._loose, "containers")
        for groups in _spread(tuple(self._groupings(loose)), _MAX_GROUPINGS):
            text = "; ".join(f"{_names(group)} in one container" for group in groups)
            yield _Change(text, "separate", *self._new_containers(groups))
        movable = [*self._movable(self._contained, "containers"), *loose]
        for role in ("host", "container"):
            yield from self._in_declared([node for node in movable if node.role == role])
        alone = [node.key for node in movable if self._gains_alone(node)]
        if alone:
            containers = {self._free_name(f"{name}_process"): self._like(name) for name in alone}
            own = "in containers of their own" if len(alone) > 1 else "in a container of its own"
            yield _Change(
                f"{_names(alone)} {own}",
                self._spec.graph.placement,
                containers,
                dict(zip(alone, containers, strict=True)),
            )

    def _in_declared(self, nodes: Sequence[NodeWiring]) -> Iterator[_Change]:
        """All of these nodes, which are of one kind, in the first container that one has."""
        homes = [node.node.container for node in nodes]
        first = next((name for name in self._spec.containers if name in homes), "")
        moved = [node.key for node in nodes if node.node.container != first]
        if first and moved:
            text = f"{_names([node.key for node in nodes])} in {first}"
            yield _Change(text, self._spec.graph.placement, {}, dict.fromkeys(moved, first))

    def admitted(self, proposed: Iterable[_Change]) -> tuple[Placement, ...]:
        """Today's, and what is proposed, without repetitions and what the spec does not allow."""
        names = {process.name for process in self._today}
        needed = {name for name in _named_processes(self._spec) if name in names}
        kept = self._of_kept(self._today)
        limit = self._spec.tune.limits.processes
        today = Setting(text=self._spec.graph.placement)
        found = {_signature(self._today): Placement(today, self._today, self._spec.containers)}
        for change in proposed:
            spec, wiring = self._changed(change)
            processes = tuple(graph_processes(spec, wiring))
            if self._of_kept(processes) != kept:
                self._leave_out(change.text, "it would move a node of 'tune.keep'")
            elif missing := needed - {process.name for process in processes}:
                self._leave_out(change.text, f"the spec names the process {quoted_list(missing)}")
            elif limit is not None and len(processes) > limit:
                self._leave_out(change.text, f"{len(processes)} processes exceed 'tune.limits'")
            elif not _is_harness_placed(spec, wiring, processes):
                self._leave_out(change.text, "no process would be the only one for the harness")
            else:
                setting = Setting(text=change.text, sets=tuple(self._sets(change)))
                placement = Placement(setting, processes, spec.containers)
                found.setdefault(_signature(processes), placement)
        return tuple(found.values())

    def _leave_out(self, what: str, why: str) -> None:
        self.left_out.append(f"graph.placement, {what}: {why}")

    def _movable(self, nodes: Sequence[NodeWiring], what: str) -> list[NodeWiring]:
        """The nodes that may change their container, without those whose settings would be lost."""
        free = [node for node in nodes if node.key not in self._kept]
        fixed = [node.key for node in free if self._is_fixed(node)]
        if fixed:
            why = "it has settings of its process, which a container has for all of its nodes"
            self._leave_out(f"other {what} for {quoted_list(fixed)}", why)
        return [node for node in free if node.key not in fixed]

    def _is_fixed(self, node: NodeWiring) -> bool:
        container = self._spec.containers.get(node.node.container)
        if container is None:
            return _has_settings(node.node) or bool(node.node.env)
        plain = Container(
            executable=container.executable, executor=container.executor, threads=container.threads
        )
        return container != plain

    def _groupings(self, nodes: Sequence[NodeWiring]) -> Iterator[_Groups]:
        """The groups of two or more nodes, after each step of joining the heaviest pair left."""
        order = {node.key: place for place, node in enumerate(nodes)}
        group: dict[str, tuple[str, ...]] = {name: (name,) for name in order}
        # What exchanges nothing that is known is joined at last, all at once.
        for pairs in (*([pair] for pair in self._pairs(nodes)), [*_neighbours(nodes)]):
            joined = [pair for pair in pairs if group[pair[0]] != group[pair[1]]]
            for first, second in joined:
                both = tuple(sorted({*group[first], *group[second]}, key=order.__getitem__))
                group |= dict.fromkeys(both, both)
            if joined:
                yield tuple(dict.fromkeys(each for each in group.values() if len(each) > 1))

    def _pairs(self, nodes: Sequence[NodeWiring]) -> list[tuple[str, str]]:
        """Pairs of nodes of one kind that exchange messages, those with the most bytes first."""
        phase = self._wiring.measure
        known = {node.name: node for node in nodes}
        order = {node.key: place for place, node in enumerate(nodes)}
        weights: dict[tuple[str, str], int] = {}
        for topic in phase.topics:
            for publisher in phase.publishers(topic):
                sender = known.get(publisher.owner)
                for subscription in phase.subscriptions(topic) if sender is not None else ():
                    receiver = known.get(subscription.owner)
                    if sender is None or receiver is None or sender.role != receiver.role:
                        continue
                    if sender is not receiver:
                        first, second = sorted((sender.key, receiver.key), key=order.__getitem__)
                        size = typical_bytes(publisher.type or subscription.type)
                        weights[first, second] = weights.get((first, second), 0) + size
        return sorted(weights, key=lambda pair: (-weights[pair], *map(order.__getitem__, pair)))

    def _new_containers(self, groups: _Groups) -> tuple[dict[str, Container], dict[str, str]]:
        containers: dict[str, Container] = {}
        homes: dict[str, str] = {}
        for group in groups:
            name = self._free_name(f"{group[0]}_group")
            containers[name] = self._like(group[0])
            homes |= dict.fromkeys(group, name)
        return containers, homes

    def _like(self, node: str) -> Container:
        """A container for a node: as the one that it has, or of the usual kind."""
        written = self._spec.graph.nodes[node]
        usual: Container = Container(executable="python") if written.python else Container()
        return self._spec.containers.get(written.container, usual)

    def _gains_alone(self, node: NodeWiring) -> bool:
        """Whether a container of its own changes anything.

        It does where others are in its container, and for a component, whose executor only a
        container can choose.
        """
        home = node.node.container
        if home in self._spec.containers:
            return sum(each.node.container == home for each in self._contained) > 1
        return node.role == "container"

    def _free_name(self, name: str) -> str:
        taken = {*self._spec.graph.nodes, *self._spec.containers, *reserved_names(self._spec)}
        while name in taken:
            name += "_"
        return name

    def _sets(self, change: _Change) -> Iterator[str]:
        if change.placement != self._spec.graph.placement:
            yield f"graph.placement={change.placement}"
        for name, container in change.containers.items():
            keys: dict[str, str] = {"executable": container.executable}
            if container.executor != "single_threaded":
                keys["executor"] = container.executor
            if container.threads:
                keys["threads"] = str(container.threads)
            yield f"containers.{name}={{{', '.join(f'{key}: {keys[key]}' for key in keys)}}}"
        for node, home in change.homes.items():
            yield f"graph.nodes.{node}.container={home}"

    def _changed(self, change: _Change) -> tuple[Spec, Wiring]:
        spec, phase = self._spec, self._wiring.measure
        nodes = {
            name: replace(node, container=change.homes[name]) if name in change.homes else node
            for name, node in spec.graph.nodes.items()
        }
        wired = tuple(replace(node, node=nodes[node.key]) for node in phase.nodes)
        changed = replace(
            spec,
            graph=replace(spec.graph, placement=change.placement, nodes=nodes),
            containers={**spec.containers, **change.containers},
        )
        measure = with_fields(phase, nodes=wired)
        return changed, replace(self._wiring, measure=measure)

    def _of_kept(self, processes: Iterable[ProcessPlan]) -> dict[str, tuple[str, ...]]:
        """The nodes with which each node that must not change shares its process."""
        return {
            node.node: (process.name, *(each.node for each in process.nodes))
            for process in processes
            for node in process.nodes
            if node.node in self._kept
        }


def _is_harness_placed(spec: Spec, wiring: Wiring, processes: tuple[ProcessPlan, ...]) -> bool:
    """Whether it is decided which processes the parts of the harness join, if they do."""
    if spec.harness.placement != "graph":
        return True
    return all(place.process for place in find_places(spec, wiring, processes))


def _neighbours(nodes: Iterable[NodeWiring]) -> Iterator[tuple[str, str]]:
    """Pairs that connect all nodes of each kind."""
    before: dict[str | None, str] = {}
    for node in nodes:
        if node.role in before:
            yield before[node.role], node.key
        before[node.role] = node.key


def _has_settings(node: Node) -> bool:
    return any(getattr(node, key) != getattr(_NO_SETTINGS, key) for key in PROCESS_KEYS)


_NO_SETTINGS: Final = Node()


def _signature(processes: Iterable[ProcessPlan]) -> frozenset[tuple[bool, tuple[str, ...]]]:
    """What tells two distributions apart.

    That is the nodes of each process, and whether it is a container of the spec, which has settings
    of its own.
    """
    return frozenset(
        (bool(process.container), tuple(node.node for node in process.nodes))
        for process in processes
    )


def _named_processes(spec: Spec) -> Iterator[str]:
    """Words of the spec that may name a process of the graph."""
    metrics = [each.metric for objective in spec.slos.values() for each in objective.require]
    if spec.benchmark.search is not None:
        metrics += [each.metric for each in spec.benchmark.search.holds]
    for metric in (*metrics, spec.tune.minimize):
        family, _, rest = metric.partition(".")
        process = rest.rpartition(".")[0]
        # In a metric, 'graph' means all of its processes, whatever they are.
        if family in {"cpu", "memory"} and process != SHARED_PROCESS_NAME:
            yield process
    yield from (probe.log.process for probe in spec.ready.values() if probe.log is not None)
    for place in (spec.harness.process, *(each.process for each in spec.monitors.values())):
        name = place.partition("/")[0]
        # A node is found in any process.
        if name not in spec.graph.nodes:
            yield name


def _names(nodes: Sequence[str]) -> str:
    if len(nodes) > _SHOWN_NODES:
        return f"{len(nodes)} nodes ({', '.join(nodes[: _SHOWN_NODES - 1])}, ...)"
    return " and ".join((", ".join(nodes[:-1]), nodes[-1])) if len(nodes) > 1 else nodes[0]


def _spread(found: Sequence[_Groups], most: int) -> list[_Groups]:
    """The first, the last, and evenly spaced ones between."""
    if len(found) <= most:
        return list(found)
    return [found[round(place * (len(found) - 1) / (most - 1))] for place in range(most)]
