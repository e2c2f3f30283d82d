"""What is certain about endpoints that do not match, and what a longer wait may still mend."""

from __future__ import annotations

import dataclasses

import pytest

from r2bspec.execute.bringup.find_fault import RemappedTopic, certain_topics, unmatched
from r2bspec.execute.bringup.graph_matching import EarlyDiagnosis
from r2bspec.execute.bringup.observe_graph import GraphFacts, TopicFacts
from r2bspec.ipc.protocol import Endpoint, QosMismatch
from run_simulation import Simulation

IMAGE, TEXT = "sensor_msgs/msg/Image", "std_msgs/msg/String"
INPUT = "/r2b/image"


def ends(nodes: str, kind: str = IMAGE) -> tuple[Endpoint, ...]:
    return tuple(
        Endpoint(node=each, type=kind, reliability="reliable", durability="volatile")
        for each in nodes.split()
    )


def topic(
    name: str,
    publishers: str = "",
    subscriptions: str = "",
    *,
    planned: tuple[str, str] = ("", ""),
    kind: str = IMAGE,
) -> TopicFacts:
    return TopicFacts(
        name=name,
        type=IMAGE if any(planned) else "",
        planned_publishers=tuple(planned[0].split()),
        planned_subscribers=tuple(planned[1].split()),
        publishers=ends(publishers, kind),
        subscriptions=ends(subscriptions, kind),
    )


def graph(*others: TopicFacts, planned: str = "/r2b/a", nodes: str = "/r2b/a") -> GraphFacts:
    """A graph whose input has no subscription."""
    played = topic(INPUT, "player", planned=("player", planned))
    return GraphFacts(
        topics={each.name: each for each in (played, *others)},
        inputs=(INPUT,),
        nodes=frozenset(nodes.split()),
    )


def certain(facts: GraphFacts, *remapped: RemappedTopic) -> bool:
    return certain_topics(facts, [INPUT], remapped) == {INPUT}


def test_a_subscription_that_is_not_there_yet_may_come() -> None:
    assert not certain(graph())
    assert not certain(graph(nodes=""))
    # The publisher of a node whose subscriptions wait for a subscriber says nothing.
    assert not certain(graph(topic("/r2b/out", "/r2b/a")))


@pytest.mark.parametrize("name", ["/image", "/other/image", "/r2b/imgae"])
def test_an_unused_subscription_with_a_similar_name_was_meant(name: str) -> None:
    assert certain(graph(topic(name, "", "/r2b/a")))
    assert certain(graph(topic(name, "", "/image_node"), planned="", nodes="/image_node"))


@pytest.mark.parametrize(
    "other",
    [
        topic("/camera/mask", "", "/r2b/a"),
        topic("/image", "", "/r2b/a", kind=TEXT),
        topic("/image", "/r2b/a", ""),
        topic("/image", "/r2b/b", "/r2b/a"),
        topic("/image", "", "/r2b/a", planned=("", "/r2b/a")),
        topic("/image", "", "monitor"),
        topic("/image", "", "/r2b/other"),
    ],
    ids=["other name", "other type", "other side", "in use", "planned", "harness", "other node"],
)
def test_an_endpoint_that_may_be_right_proves_nothing(other: TopicFacts) -> None:
    assert not certain(graph(other))


def test_a_planned_node_in_another_namespace_has_its_endpoints_there() -> None:
    elsewhere = topic("/camera/mask", "", "/a")
    assert certain(graph(elsewhere, nodes="/a"))
    assert not certain(graph(elsewhere, nodes="/a /r2b/a"))
    assert not certain(graph(topic("/camera/mask", "", "/b"), nodes="/b"))
    assert not certain(graph(topic("/camera/mask", "", "/a", kind=TEXT), nodes="/a"))


def test_a_remapping_without_effect_explains_an_endpoint_of_any_name() -> None:
    rule = RemappedTopic("/r2b/a", "camera/msk", INPUT, own_node_name=True)
    facts = graph(topic("/camera/mask", "", "/r2b/a"))
    assert certain(facts, rule)
    assert [*unmatched(facts, [rule])] == [rule]
    other = topic("/camera/mask", "", "/r2b/a", kind=TEXT)
    assert not certain(graph(other), rule)


def test_a_remapping_with_effect_is_not_unmatched() -> None:
    facts = graph(topic("/r2b/out", "/r2b/a"), topic("/r2b/last", "/plain"))

    def has_no_effect(node: str, name: str, *, own: bool) -> bool:
        return bool([*unmatched(facts, [RemappedTopic(node, "o", name, own_node_name=own)])])

    assert not has_no_effect("/r2b/a", "/r2b/out", own=True)
    assert has_no_effect("/r2b/b", "/r2b/out", own=True)
    # A program may have nodes of any name, but not those of other nodes in the plan.
    assert not has_no_effect("/r2b/b", "/r2b/last", own=False)
    assert has_no_effect("/r2b/b", "/r2b/out", own=False)


def test_an_incompatible_profile_is_certain() -> None:
    facts = graph()
    played = dataclasses.replace(
        facts.topics[INPUT],
        subscriptions=ends("/r2b/a"),
        qos_mismatches=(QosMismatch("player", "/r2b/a", INPUT, "reliability"),),
    )
    assert certain(dataclasses.replace(facts, topics={INPUT: played}))


def test_nothing_is_certain_while_the_graph_changes() -> None:
    now = 0.0
    facts = graph(topic("/image", "", "/r2b/a"))
    looks: list[float] = []

    def look() -> GraphFacts:
        looks.append(now)
        # Until 3 s, each look shows another node.
        return dataclasses.replace(facts, nodes=frozenset({"/r2b/a", f"/{min(now, 3.0)}"}))

    watch = EarlyDiagnosis(Simulation().plan(), (), look, clock=lambda: now)
    said: list[float] = []
    while not said and now < 20:
        if watch.certain([INPUT]):
            said.append(now)
        now += 0.25
    assert said == [7.0]
    assert looks == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]


def test_the_topics_of_a_node_of_unknown_name_are_those_of_nodes_outside_of_the_plan() -> None:
    facts = graph(topic("/image", "", "/plain"), topic("/out", "/plain"))
    assert facts.topics_of("/r2b/b") == ("/image", "/out")
    assert facts.topics_of("/plain") == ("/image", "/out")
