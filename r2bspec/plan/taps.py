"""Taps: topics on the path to a monitor that are also recorded, and the hops of the path."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from r2bspec.plan.plan import MonitorPlan, Plan, TapPlan, TopicPlan

PLAYER = "player"
"""The beginning of every path; represents all inputs, which are published together."""

_TAP_PREFIX = "tap."


def all_taps(monitors: Iterable[MonitorPlan]) -> tuple[TapPlan, ...]:
    """Return every tapped topic once, even if several monitors have it."""
    return tuple({tap.topic: tap for monitor in monitors for tap in monitor.taps}.values())


def tap_monitors(monitors: Iterable[MonitorPlan]) -> tuple[MonitorPlan, ...]:
    """Return the taps as monitors, with the QoS of their publishers."""
    return tuple(
        MonitorPlan(
            name=tap_name(tap.topic), topic=tap.topic, type=tap.type, match="stamp", qos=None
        )
        for tap in all_taps(monitors)
    )


def tap_name(topic: str) -> str:
    """Return the name of the samples of a tap.

    Neither topics nor monitors have dots in their names.
    """
    return _TAP_PREFIX + topic.strip("/").replace("/", ".")


def hops_to(
    plan: Plan, monitor: MonitorPlan, leave_out: Collection[str] = ()
) -> tuple[tuple[str, str], ...]:
    """Return the hops of the path to a tapped monitor, from the player, as (source, target).

    A hop leads from one topic to another if a node subscribes to the first and publishes the
    second. If a node has several inputs, several hops lead to its output.

    Args:
        plan: with the publishers and subscribers of the topics.
        monitor: at the end of the path.
        leave_out: taps without usable samples; the hops on both sides are joined.
    """
    if not monitor.taps:
        return ()
    topics = {topic_.name: topic_ for topic_ in plan.topics if topic_.phase == "measure"}
    inputs = {input_.topic for input_ in plan.inputs}
    on_path = [*(tap.topic for tap in monitor.taps), monitor.topic]
    hops = {
        (PLAYER if source in inputs else source, target)
        for target in on_path
        for source in (*inputs, *on_path)
        if source != target and _is_hop(topics.get(source), topics.get(target))
    }
    for topic in leave_out:
        before = [source for source, target in hops if target == topic]
        after = [target for source, target in hops if source == topic]
        hops = {hop for hop in hops if topic not in hop}
        hops |= {(source, target) for source in before for target in after if source != target}
    return _sort_by_distance(hops)


def _is_hop(source: TopicPlan | None, target: TopicPlan | None) -> bool:
    if source is None or target is None:
        return False
    return any(name.startswith("/") for name in {*source.readers} & {*target.writers})


def _sort_by_distance(hops: Collection[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    """Hops by the distance of their target, then of their source, from the player."""
    import networkx as nx

    graph: nx.DiGraph[str] = nx.DiGraph(sorted(hops))
    graph.add_node(PLAYER)
    distance = nx.single_source_shortest_path_length(graph, PLAYER)
    far = len(distance)

    def order(hop: tuple[str, str]) -> tuple[int, str, int, str]:
        source, target = hop
        return distance.get(target, far), target, distance.get(source, far), source

    return tuple(sorted(hops, key=order))
