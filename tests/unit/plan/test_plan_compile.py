"""What a spec's plan says, besides what tests/golden/plan shows."""

from __future__ import annotations

from typing import Any

import pytest
from plan_specs import BAG, IMAGE, INFO, PREPROCESSED, STRAIGHT, plan, spec

from r2bspec.bags.recording import TopicInfo
from r2bspec.plan.command_lines import HARNESS_ARGV, parameter_text
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.plan import PlayPlan, ProcessPlan
from r2bspec.plan.process_plans import process_names
from r2bspec.plan.wiring.build_wiring import build_wiring


def process(name: str, **sections: Any) -> ProcessPlan:
    return next(listed for listed in plan(**sections).processes if listed.name == name)


def test_without_preprocessors_nothing_is_loaded_by_a_process() -> None:
    straight = plan(STRAIGHT)
    assert [listed.name for listed in straight.processes] == ["player", "relay", "monitor"]
    assert {topic.phase for topic in straight.topics} == {"measure"}


def test_python_nodes_share_a_process_if_asked_to() -> None:
    nodes = {
        "a": {"python": "m.A", "env": {"X": "1"}},
        "b": {"python": "m.B", "env": {"Y": "2"}},
        "c": {"command": ["x"]},
    }
    shared = plan(graph={"placement": "shared", "nodes": nodes})
    hosts = [listed for listed in shared.processes if listed.phase == "measure"]
    assert [host.name for host in hosts] == ["player", "c", "graph", "monitor"]
    graph = hosts[2]
    assert [node.node for node in graph.nodes] == ["a", "b"]
    assert graph.env == {"X": "1", "Y": "2"}
    assert graph.argv == HARNESS_ARGV


def test_the_names_of_processes_that_metrics_can_ask_for() -> None:
    document = spec(PREPROCESSED)
    assert process_names(document, build_wiring(document)) == (
        "player",
        "relay",
        "driver",
        "script",
        "monitor",
    )


def test_a_command_gets_ros_arguments_if_the_spec_says_anything_of_ros() -> None:
    nodes = {"n": {"command": ["x"], "arguments": ["-v"], "remappings": {"a": "b"}}}
    assert process("n", graph={"nodes": nodes}).argv == (
        *("x", "-v", "--ros-args"),
        *("-r", "__ns:=/r2b", "-r", "a:=b"),
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1, "1"),
        (1.0, "1.0"),
        (1e-7, "1e-07"),
        (True, "true"),
        ("10", '"10"'),
        ("über", '"über"'),
        ('a "b"', '"a \\"b\\""'),
        ([0.5, 1.5], "[0.5, 1.5]"),
        (["a", "b"], '["a", "b"]'),
        (float("inf"), ".inf"),
        (float("-inf"), "-.inf"),
        (float("nan"), ".nan"),
    ],
)
def test_parameters_on_the_command_line_keep_their_type(value: Any, text: str) -> None:
    assert parameter_text(value) == text


def test_what_a_preprocessor_writes_does_not_come_straight_from_the_bag() -> None:
    resize = PREPROCESSED["preprocessors"]["resize"]
    remappings = {**resize["remappings"], "resize/camera_info": "loaded/info"}
    changed = plan(preprocessors={"resize": {**resize, "remappings": remappings}})
    assert changed.inputs[1].bag_topic == ""


def test_the_dataset_is_named_as_in_the_spec() -> None:
    dataset = plan().dataset
    assert (dataset.source, dataset.kind) == ("kitchen", "recorded")
    assert (dataset.start_ns, dataset.end_ns) == (500_000_000, 1_000_000_000)
    assert plan(STRAIGHT).dataset.source == "./bags/kitchen"
    assert plan(STRAIGHT).dataset.end_ns is None


def test_the_largest_message_is_known_only_if_all_sizes_are() -> None:
    assert plan().largest_message_bytes == 900_000
    topics = {
        **BAG.topics,
        "/camera/info": TopicInfo(name="/camera/info", type=INFO, count=1, rate_hz=0.0),
    }
    import msgspec

    unknown = msgspec.structs.replace(BAG, topics=topics)
    assert compile_plan(spec(PREPROCESSED), unknown).largest_message_bytes == 0
    assert compile_plan(spec(PREPROCESSED), None).largest_message_bytes == 0


def test_without_a_bag_the_plan_says_what_the_spec_knows() -> None:
    blind = compile_plan(spec(PREPROCESSED), None)
    assert [topic.count for topic in blind.dataset.topics] == [0, 0]
    assert blind.dataset.topics[1].bag_topic == "camera/info"
    assert next(topic.type for topic in blind.topics if topic.name == "/r2b/image") == IMAGE


def test_only_phases_that_happen_are_listed() -> None:
    assert plan().phases == (
        *("load", "preprocess", "start", "harness_overhead", "graph", "warm_up"),
        *("search", "sustained", "play", "collect"),
    )
    assert plan(STRAIGHT).phases == (
        "load",
        "start",
        "harness_overhead",
        "graph",
        "play",
        "collect",
    )


def test_each_rate_is_played_once_and_sustained_rates_are_sorted() -> None:
    full = plan()
    assert full.play == tuple(
        PlayPlan(rate_hz=rate, duration_ns=4_000_000_000, iterations=3) for rate in (10.0, 30.0)
    )
    assert full.sustained_hz == (20.0, 30.0)
    assert full.search is not None
    assert (full.search.min_hz, full.search.max_hz, full.search.precision) == (5.0, 60.0, 0.02)


def test_an_objective_at_the_peak_has_something_played_there() -> None:
    at_peak = {"at_peak": True, "level": "info", "require": ["latency.p50 < 100 ms"]}
    assert plan().play_at_peak is None
    # At which rate only the search can tell.
    assert plan(slos={"at_its_limit": at_peak}).play_at_peak == PlayPlan(
        rate_hz=0.0, duration_ns=4_000_000_000, iterations=3
    )
    assert plan(slos={"at_its_limit": at_peak | {"level": "off"}}).play_at_peak is None
