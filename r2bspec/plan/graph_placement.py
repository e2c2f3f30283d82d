"""Which processes of the graph get the player and the monitors, with ``placement: graph``.

The player runs where the inputs are read, so that they need not be sent to another process; each
monitor runs where its topic is published. The spec names the process (``in``) where that is not
the only possible one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import msgspec

from r2bspec.diagnostics.diagnostic import Path
from r2bspec.language.spec import Spec
from r2bspec.plan.plan import JoinPlan, ProcessPlan
from r2bspec.wiring.build_wiring import harness_topic
from r2bspec.wiring.wiring import NodeWiring, Wiring


class Place(msgspec.Struct, frozen=True):
    """Where one part of the harness runs.

    Attributes:
        part: ``player``, or the name of a monitor.
        path: the place in the spec that can name its process.
        process: the name of its process; empty if that is not decided.
        program: as in `JoinPlan`.
        named: what the spec says.
        choices: the processes that it can run in; those of the nodes in question, if there are any.
        external: whether only external nodes read its inputs, or publish its topic.
    """

    part: str
    path: Path
    process: str = ""
    program: str = ""
    named: str = ""
    choices: tuple[str, ...] = ()
    external: bool = False


def find_places(spec: Spec, wiring: Wiring, processes: Iterable[ProcessPlan]) -> tuple[Place, ...]:
    """The place of the player, unless the benchmark is live, and of each monitor.

    Args:
        spec: with ``placement: graph``.
        wiring: which node reads and publishes which topic.
        processes: of the graph.
    """
    owners = {node.node: each.name for each in processes for node in each.nodes}
    phase = wiring.measure
    found = []
    if not spec.live:
        topics = [harness_topic(each, wiring.namespace) for each in spec.playback.inputs]
        ends = {end.owner for topic in topics for end in phase.subscriptions(topic) if end.is_node}
        known = [node for node in phase.nodes if node.name in ends]
        unknown = phase.possible_subscribers
        found.append(_place("player", ("harness",), spec.harness.process, owners, known or unknown))
    for name, monitor in spec.monitors.items():
        topic = harness_topic(monitor.topic, wiring.namespace)
        ends = {end.owner for end in phase.publishers(topic) if end.is_node}
        known = [node for node in phase.nodes if node.name in ends]
        unknown = phase.possible_publishers
        found.append(_place(name, ("monitors", name), monitor.process, owners, known or unknown))
    return tuple(found)


def _place(
    part: str, path: Path, named: str, owners: dict[str, str], nodes: Sequence[NodeWiring]
) -> Place:
    """The place of a part, whose topics these nodes read or publish."""
    processes = tuple(dict.fromkeys(owners.values()))
    if named:
        name, _, program = named.partition("/")
        process = owners.get(name, name if name in processes else "")
        return Place(part, path, process, program, named=named, choices=processes)
    likely = tuple(dict.fromkeys(owners[each.key] for each in nodes if each.key in owners))
    if nodes and not likely:
        return Place(part, path, choices=processes, external=True)
    choices = likely or processes
    return Place(part, path, choices[0] if len(choices) == 1 else "", choices=choices)


def join_processes(
    spec: Spec, wiring: Wiring, processes: Sequence[ProcessPlan]
) -> tuple[ProcessPlan, ...]:
    """The processes of the graph, with the parts of the harness that each gets.

    A part whose place is not decided, which is an error of the spec, runs in none.
    """
    places = find_places(spec, wiring, processes)
    return tuple(
        _joined(each, [one for one in places if one.process == each.name]) for each in processes
    )


def _joined(process: ProcessPlan, places: Sequence[Place]) -> ProcessPlan:
    if not places:
        return process
    programs = [each.program for each in places if each.program]
    join = JoinPlan(
        player=any(each.path == ("harness",) for each in places),
        monitors=tuple(each.part for each in places if each.path != ("harness",)),
        program=programs[0] if programs else "",
    )
    return msgspec.structs.replace(process, join=join)
