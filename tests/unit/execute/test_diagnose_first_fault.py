"""What is wrong on the path of the messages, and what of it is certain before a start is over."""

from __future__ import annotations

import dataclasses

import pytest

from graph_facts import IMAGE, TEXT, end, graph, topic
from r2bspec.execute.bringup.node_faults import RemappedTopic
from r2bspec.execute.diagnose.diagnosis import EarlyDiagnosis
from r2bspec.execute.diagnose.facts import GraphFacts, TopicFacts
from r2bspec.execute.diagnose.first_fault import find_input_fault, first_fault, path_to, unmatched
from r2bspec.ipc.protocol import QosMismatch
from r2bspec.record.run_record import Difference

IN = topic("/in", "player", "/a")
MID = topic("/mid", "/a", "/b")
OUT = topic("/out", "/b", "monitor", passed=0)


def found(*topics: TopicFacts) -> Difference:
    one = first_fault(graph(*topics), "/out")
    assert one is not None
    return one


BOTH_QOS = "best effort publisher and reliable subscription"
UNPLANNED = ("", "")
NO_MID = topic("/mid", "", "/b", planned=("/a", "/b"), passed=None)


STOPS = "R2B641 /b: /b publishes nothing on /out, although it subscribes to /mid (10 messages)"
ANOTHER_TYPE = f"R2B210 /b: /b publishes /out as {TEXT}, but its type in the spec is {IMAGE}"
MASK = topic("/mask", "", "/b", passed=None)
BOTH = topic("/out", "/b /c", "monitor", passed=0)
MISSPELT = topic("/mdi", "", "/b", planned=UNPLANNED, passed=None)
QOS = (QosMismatch("/a", "/b", "/mid", BOTH_QOS),)
FAULTS: dict[str, tuple[TopicFacts, ...]] = {
    STOPS: (IN, MID, OUT),
    "R2B641 /b: /b and /c publish nothing on /out, although they subscribe to /mid": (
        IN,
        MID,
        BOTH,
    ),
    # It may be an optional input of the node, so it is no fault by itself.
    f"{STOPS}; it also subscribes to /mask, which has no publisher": (IN, MID, OUT, MASK),
    "R2B641 player: 10 messages were played on /in, but none arrived": (
        topic("/in", "player", "/a", passed=0),
        MID,
        OUT,
    ),
    "R2B207 /a: no publisher on /mid, to which /b subscribes; the closest name is /middle, publ": (
        IN,
        NO_MID,
        OUT,
        topic("/middle", "/a", "", planned=UNPLANNED),
    ),
    "R2B207 : no publisher on /out, to which monitor subscribes; /x, published by /a, has no su": (
        IN,
        topic("/x", "/a", "", planned=UNPLANNED),
        topic("/out", "", "monitor"),
    ),
    "R2B208 /b: no subscription to /mid, on which 10 messages were published; the closest name ": (
        IN,
        topic("/mid", "/a", "", planned=("/a", "/b")),
        OUT,
        MISSPELT,
    ),
    f"R2B210 /b: /b subscribes to /mid as {IMAGE}, but /a publishes /mid as {TEXT}; ROS does": (
        IN,
        topic("/mid", "/a", "/b", kinds=(TEXT, IMAGE)),
        OUT,
    ),
    # A monitor waits for a publisher of its type.
    ANOTHER_TYPE: (
        IN,
        MID,
        topic("/out", "/b", "", planned=("/b", "monitor"), kinds=(TEXT, IMAGE)),
    ),
    f"R2B216 /b: /b requests a QoS on /mid that /a does not offer ({BOTH_QOS}); ROS": (
        IN,
        topic("/mid", "/a", "/b", qos_mismatches=QOS),
        OUT,
    ),
    "R2B207 : no publisher on /out": (IN,),
}


@pytest.mark.parametrize("said", FAULTS)
def test_the_first_fault_on_the_path(said: str) -> None:
    one = found(*FAULTS[said])
    assert f"{one.code} {one.owner}: {one.message}".startswith(said)


@pytest.mark.parametrize(
    ("elsewhere", "nodes", "words"),
    [
        (topic("/x", "/a", "", planned=UNPLANNED), {"/a"}, "/a publishes on /x"),
        (topic("/x", "/c", "", planned=UNPLANNED), {"/c"}, "/a is not running"),
        (topic("/x", "/c", "", planned=UNPLANNED), {"/a"}, "/a publishes nothing"),
    ],
)
def test_a_topic_without_publisher_and_without_a_close_name(
    elsewhere: TopicFacts, nodes: set[str], words: str
) -> None:
    facts = dataclasses.replace(graph(IN, NO_MID, OUT, elsewhere), nodes=frozenset(nodes))
    one = first_fault(facts, "/out")
    assert one is not None
    assert one.message == (
        f"no publisher on /mid, to which /b subscribes; its planned publisher {words}"
    )


def test_what_carries_messages_or_was_not_observed_has_no_fault() -> None:
    assert first_fault(graph(IN, MID, topic("/out", "/b", "monitor")), "/out") is None
    unobserved = (
        topic("/in", "player", "/a", passed=None),
        topic("/out", "/a", "monitor", passed=None),
    )
    assert first_fault(graph(*unobserved, played=None), "/out") is None


def test_the_path_of_a_graph_that_joins() -> None:
    facts = graph(
        topic("/left", "player", "/a"),
        topic("/right", "player", "/c"),
        topic("/l", "/a", "/b"),
        topic("/r", "/c", "/b", passed=0),
        topic("/else", "/a", ""),
        OUT,
    )
    assert path_to(facts, "/out") == ("/left", "/right", "/l", "/r", "/out")
    one = first_fault(facts, "/out")
    assert one is not None
    assert one.message.startswith("/c publishes nothing on /r")


@pytest.mark.parametrize(
    ("topics", "message"),
    [
        (
            (topic("/in", "player", "", passed=None), topic("/inn", "", "/a", passed=None)),
            "the closest name is /inn, to which /a subscribes",
        ),
        (
            (topic("/in", "player", passed=None), topic("/camera", "", "/x", planned=UNPLANNED)),
            "/camera, to which /x subscribes, has no publisher",
        ),
    ],
)
def test_an_input_without_subscription(topics: tuple[TopicFacts, ...], message: str) -> None:
    one = find_input_fault(graph(*topics), "/in")
    assert one is not None
    assert one.message == f"no subscription to /in, which is played; {message}"
    assert find_input_fault(graph(IN), "/in") is None


INPUT = "/r2b/image"


def mismatched() -> GraphFacts:
    facts = graph(topic(INPUT, "player", planned=("player", "/r2b/a")))
    played = dataclasses.replace(
        facts.topics[INPUT],
        subscriptions=(end("/r2b/a"),),
        qos_mismatches=(QosMismatch("player", "/r2b/a", INPUT, "reliability"),),
    )
    return dataclasses.replace(facts, topics={INPUT: played})


def test_a_subscription_that_is_not_there_yet_may_come() -> None:
    now = [0.0]
    facts = graph(topic(INPUT, "player", planned=("player", "/r2b/a")))
    watch = EarlyDiagnosis(20.0, lambda: facts, clock=lambda: now[0])
    while now[0] < 20:
        assert not watch.is_hopeless([INPUT])
        now[0] += 0.25


def test_endpoints_that_never_match_end_a_start_once_the_graph_does_not_change() -> None:
    now = 0.0
    looks: list[float] = []

    def look() -> GraphFacts:
        looks.append(now)
        # Until 3 s, each look shows another node.
        return dataclasses.replace(mismatched(), nodes=frozenset({f"/{min(now, 3.0)}"}))

    watch = EarlyDiagnosis(20.0, look, clock=lambda: now)
    while not watch.is_hopeless([INPUT]):
        now += 0.25
    assert now == 7.0
    assert looks == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]


def test_a_remapping_without_effect_is_found_by_the_topics_of_its_node() -> None:
    rule = RemappedTopic("/r2b/a", "camera/msk", INPUT, own_node_name=True)
    assert [*unmatched(graph(topic(INPUT, "player")), [rule])] == [rule]
    assert [*unmatched(graph(topic(INPUT, "player", "/r2b/a")), [rule])] == []
