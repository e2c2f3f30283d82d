"""The first break on the way of the messages, decided on facts that a test writes down."""

from __future__ import annotations

import msgspec
import pytest

from r2bspec.execute.diagnosis.find_break import (
    Fault,
    find_input_fault,
    first_fault,
    full_path,
    path_lines,
    path_to,
)
from r2bspec.execute.diagnosis.graph_facts import GraphFacts, TopicFacts, gather_facts
from r2bspec.ipc.protocol import Endpoint, QosMismatch
from r2bspec.plan.plan import TopicPlan
from run_simulation import Simulation

IMAGE, TEXT = "sensor_msgs/msg/Image", "std_msgs/msg/String"


def end(node: str, kind: str = IMAGE) -> Endpoint:
    return Endpoint(node=node, type=kind, reliability="reliable", durability="volatile")


def topic(
    name: str,
    writers: str = "",
    readers: str = "",
    *,
    planned: tuple[str, str] | None = None,
    passed: int | None = 10,
    kinds: tuple[str, str] = (IMAGE, IMAGE),
    qos_mismatches: tuple[QosMismatch, ...] = (),
) -> TopicFacts:
    """A topic with these real ends; planned are the same ones, unless it is said otherwise."""
    of_writers, of_readers = planned or (writers, readers)
    return TopicFacts(
        name=name,
        type=IMAGE,
        planned_publishers=tuple(of_writers.split()),
        planned_subscribers=tuple(of_readers.split()),
        writers=tuple(end(node, kinds[0]) for node in writers.split()),
        readers=tuple(end(node, kinds[1]) for node in readers.split()),
        qos_mismatches=qos_mismatches,
        passed=passed,
    )


def graph(*topics: TopicFacts, played: int | None = 10) -> GraphFacts:
    return GraphFacts(
        topics={each.name: each for each in topics},
        inputs=tuple(each.name for each in topics if "player" in each.planned_publishers),
        played=played,
        nodes=frozenset({"/a", "/b", "/c"}),
    )


IN = topic("/in", "player", "/a")
MID = topic("/mid", "/a", "/b")
OUT = topic("/out", "/b", "monitor", passed=0)


def found(*topics: TopicFacts, silent: str = "/out", played: int | None = 10) -> Fault:
    one = first_fault(graph(*topics, played=played), silent)
    assert one is not None
    return one


def test_a_node_that_publishes_nothing_although_messages_reach_it() -> None:
    one = found(IN, MID, OUT)
    assert (one.kind, one.topic, one.owner, one.code) == ("swallowed", "/out", "/b", "R2B641")
    assert one.sentence == "/mid: 10 messages passed, and /b reads it; /b publishes nothing on /out"


def test_the_first_of_several_silent_topics_decides() -> None:
    one = found(IN, topic("/mid", "/a", "/b", passed=0), OUT)
    assert (
        one.sentence
        == "/in: 10 messages were played, and /a reads it; /a publishes nothing on /mid"
    )


def test_an_input_that_nobody_writes_is_named_with_the_node_that_waits_for_it() -> None:
    mask = topic("/mask", "", "/b", passed=None)
    # It may be an option of the node, so it is no break by itself.
    assert found(IN, MID, OUT, mask).sentence == (
        "/mid: 10 messages passed, and /b reads it; /b publishes nothing on /out; "
        "it also reads /mask, which nobody writes"
    )


def test_messages_that_are_played_and_reach_nobody() -> None:
    one = found(topic("/in", "player", "/a", passed=0), MID, OUT)
    assert one.sentence == "/in: 10 messages were played, but none of them arrived"


def test_a_topic_that_nobody_writes_and_the_name_that_was_meant() -> None:
    wrong = topic("/middle", "/a", "", planned=("", ""))
    one = found(IN, topic("/mid", "", "/b", planned=("/a", "/b"), passed=None), OUT, wrong)
    assert (one.kind, one.code) == ("unwritten", "R2B207")
    assert one.sentence == "/mid: nobody writes it; the nearest name is /middle, which /a writes"


@pytest.mark.parametrize(
    ("elsewhere", "nodes", "words"),
    [
        (topic("/x", "/a", "", planned=("", "")), {"/a"}, "/a, which should, writes /x"),
        (topic("/x", "/c", "", planned=("", "")), {"/c"}, "/a, which should, is not there"),
        (topic("/x", "/c", "", planned=("", "")), {"/a"}, "/a, which should, writes nothing"),
    ],
)
def test_a_topic_that_nobody_writes_and_nothing_is_called_alike(
    elsewhere: TopicFacts, nodes: set[str], words: str
) -> None:
    missing = topic("/mid", "", "/b", planned=("/a", "/b"), passed=None)
    facts = graph(IN, missing, OUT, elsewhere)
    facts = GraphFacts(facts.topics, facts.inputs, facts.played, frozenset(nodes))
    one = first_fault(facts, "/out")
    assert one is not None
    assert one.sentence == f"/mid: nobody writes it; {words}"


def test_a_topic_of_an_unknown_writer_and_what_is_written_in_vain() -> None:
    one = found(
        IN,
        topic("/x", "/a", "", planned=("", "")),
        topic("/out", "", "monitor", passed=None),
        played=None,
    )
    assert one.sentence == "/out: nobody writes it; nobody reads /x, which /a writes"


def test_a_topic_that_nobody_reads_and_the_name_that_was_meant() -> None:
    wrong = topic("/mdi", "", "/b", planned=("", ""), passed=None)
    one = found(IN, topic("/mid", "/a", "", planned=("/a", "/b")), OUT, wrong)
    assert (one.kind, one.owner, one.code) == ("unread", "/b", "R2B208")
    assert one.sentence == (
        "/mid: 10 messages passed, but nobody reads it; the nearest name is /mdi, which /b reads"
    )


def test_types_that_differ_never_connect() -> None:
    one = found(IN, topic("/mid", "/a", "/b", kinds=(TEXT, IMAGE)), OUT)
    assert (one.kind, one.owner, one.code) == ("types", "/b", "R2B210")
    assert one.sentence.startswith(f"/mid: /a writes {TEXT}, but /b reads {IMAGE}")


def test_a_monitor_that_waits_for_a_writer_of_its_type() -> None:
    one = found(IN, MID, topic("/out", "/b", "", planned=("/b", "monitor"), kinds=(TEXT, IMAGE)))
    assert one.sentence == f"/out: /b writes {TEXT}, where the spec says {IMAGE}"


def test_qos_that_never_matches() -> None:
    pair = QosMismatch("/a", "/b", "/mid", "best effort publisher and reliable subscription")
    one = found(IN, topic("/mid", "/a", "/b", qos_mismatches=(pair,)), OUT)
    assert (one.kind, one.code) == ("qos", "R2B216")
    assert "what /a offers is less than /b asks for (best effort publisher" in one.sentence


def test_a_pair_that_never_matches_off_the_way_is_no_break() -> None:
    pair = QosMismatch("/a", "/c", "/mid", "best effort publisher and reliable subscription")
    one = found(IN, topic("/mid", "/a", "/b /c", qos_mismatches=(pair,)), OUT)
    assert one.kind == "swallowed"


def test_where_everything_passes_there_is_no_break() -> None:
    assert first_fault(graph(IN, MID, topic("/out", "/b", "monitor")), "/out") is None


def test_without_playing_silence_is_no_break() -> None:
    unheard = (
        topic("/in", "player", "/a", passed=None),
        topic("/out", "/a", "monitor", passed=None),
    )
    assert first_fault(graph(*unheard, played=None), "/out") is None


def test_a_silent_topic_that_is_neither_planned_nor_seen() -> None:
    assert found(IN, silent="/nowhere").sentence == "/nowhere: nobody writes it"


def test_a_loop_is_walked_once() -> None:
    back = topic("/back", "/b", "/a")
    facts = graph(topic("/in", "player", "/a"), MID, back, OUT)
    assert path_to(facts, "/out") == ("/in", "/mid", "/back", "/out")


def test_the_way_of_a_graph_that_joins() -> None:
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
    assert (
        one.sentence
        == "/right: 10 messages were played, and /c reads it; /c publishes nothing on /r"
    )


def test_where_no_way_is_known_all_that_is_reached_is_shown() -> None:
    facts = graph(IN, topic("/x", "/a", ""), topic("/out", "", "monitor"))
    assert path_to(facts, "/out") == ("/out",)
    assert full_path(facts, "/out") == ("/in", "/x", "/out")


def test_an_input_that_nobody_reads() -> None:
    facts = graph(
        topic("/inptu", "player", "", passed=None), topic("/input", "", "/a", passed=None)
    )
    one = find_input_fault(facts, "/inptu")
    assert one is not None
    assert one.sentence == "/inptu: nobody reads it; the nearest name is /input, which /a reads"
    assert find_input_fault(graph(IN), "/in") is None


def test_the_way_in_lines() -> None:
    soft = Endpoint(node="/b", type=TEXT, reliability="best_effort", durability="transient_local")
    facts = graph(TopicFacts("/out", IMAGE, writers=(soft,), passed=3))
    writer = f"/b ({TEXT}, best_effort, transient_local)"
    assert path_lines(facts, ["/out", "/gone"]) == [
        f"  /out ({IMAGE}): writers: {writer}; readers: none; 3 passed",
        "  /gone (type unknown): writers: none; readers: none",
    ]


def test_the_harness_is_called_as_plans_call_it_and_whoever_only_looks_is_left_out() -> None:
    planned = TopicPlan(
        name="/in", type=IMAGE, phase="measure", writers=("player",), readers=("/a",)
    )
    facts = gather_facts(
        msgspec.structs.replace(Simulation().plan(), topics=(planned,)),
        "measure",
        {"/in": ((end("/r2bspec/player"),), (end("/a"), end("/r2bspec/monitor")))},
        passed={"/in": 4},
        played=10,
    )
    seen = facts.topics["/in"]
    assert facts.inputs == ("/in",)
    assert [each.node for each in seen.writers] == ["player"]
    assert [each.node for each in seen.readers] == ["/a"]
    assert seen.passed == 4
