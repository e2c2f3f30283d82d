"""What a spec's plan says of processes, starts and steps, besides what tests/golden/plan shows."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from plan_specs import BAG, IMAGE, INFO, PREPROCESSED, STRAIGHT, plan, spec

from example_spec import example
from r2bspec.bags.recording import TopicInfo
from r2bspec.check.rules.benchmark import iterations_per_start, starts_of_external_nodes
from r2bspec.execute.build_schedule import align
from r2bspec.ipc.buffers import BufferIndex
from r2bspec.language.load_spec import load_spec
from r2bspec.language.spec import Spec
from r2bspec.plan.command_lines import HARNESS_ARGV, parameter_text
from r2bspec.plan.comparability import load_differences, single_run_plan
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.interim_looks import iterations_of_starts
from r2bspec.plan.nearest_stamps import pair_nearest
from r2bspec.plan.plan import JoinPlan, Plan, PlayPlan, ProcessPlan
from r2bspec.plan.process_plans import PartPlacement, find_places, graph_processes, process_names
from r2bspec.plan.wiring.build_wiring import build_wiring

# What a spec's plan says, besides what tests/golden/plan shows.


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


# Which processes of the graph get player and monitors with ``harness: {placement: graph}``.


GRAPH: dict[str, Any] = {"placement": "graph"}
FIRST = {"python": "r2bspec.nodes.RelayNode", "remappings": {"input": "image", "output": "middle"}}
SECOND = {"python": "r2bspec.nodes.RelayNode", "remappings": {"input": "middle"}}
SILENT = {"command": ["./detector"], "namespace": "left"}
EXTERNAL = {"external": True, "subscribes": {"image": IMAGE}, "publishes": {"output": IMAGE}}


def places(
    nodes: dict[str, Any],
    harness: dict[str, Any] = GRAPH,
    monitor: dict[str, Any] | None = None,
    **sections: Any,
) -> dict[str, PartPlacement]:
    """The places of the parts in a graph of these nodes."""
    one = {"topic": "output", "format": IMAGE} | (monitor or {})
    made = spec(
        STRAIGHT, harness=harness, graph={"nodes": nodes}, monitors={"out": one}, **sections
    )
    wiring = build_wiring(made)
    return {place.part: place for place in find_places(made, wiring, graph_processes(made, wiring))}


def joins(made: Plan) -> dict[str, JoinPlan]:
    return {process.name: process.join for process in made.processes if process.join is not None}


def test_the_only_process_gets_all_parts_and_no_process_of_the_harness_is_left() -> None:
    made = plan(STRAIGHT, harness=GRAPH)
    assert [(process.name, process.role) for process in made.processes] == [("relay", "host")]
    assert joins(made) == {"relay": JoinPlan(player=True, monitors=("output",))}
    assert made.harness.placement == "graph"


def test_the_player_goes_to_the_reader_and_the_monitor_to_the_publisher() -> None:
    made = plan(STRAIGHT, harness=GRAPH, graph={"nodes": {"a": FIRST, "b": SECOND}})
    assert joins(made) == {"a": JoinPlan(player=True), "b": JoinPlan(monitors=("output",))}


def test_nodes_of_one_container_have_one_process() -> None:
    nodes = {"a": FIRST | {"container": "py"}, "b": SECOND | {"container": "py"}}
    found = places(nodes, containers={"py": {"executable": "python"}})
    assert {each.process for each in found.values()} == {"py"}


def test_a_program_of_unknown_topics_is_chosen_if_it_is_alone() -> None:
    assert {place.process for place in places({"detector": SILENT}).values()} == {"detector"}


@pytest.mark.parametrize("named", ["one", "two"])
def test_of_several_readers_the_spec_names_one(named: str) -> None:
    nodes = {"one": FIRST, "two": FIRST | {"remappings": {"input": "image"}}}
    undecided = places(nodes)["player"]
    assert (undecided.process, undecided.choices) == ("", ("one", "two"))
    assert places(nodes, GRAPH | {"in": named})["player"].process == named


def test_a_monitor_can_be_named_another_process() -> None:
    nodes = {"a": FIRST, "b": SECOND}
    assert places(nodes)["out"].process == "b"
    assert places(nodes, monitor={"in": "a"})["out"].process == "a"


def test_an_unknown_name_decides_nothing() -> None:
    place = places({"a": FIRST, "b": SECOND}, GRAPH | {"in": "c"})["player"]
    assert (place.process, place.named, place.choices) == ("", "c", ("a", "b"))


def test_external_nodes_cannot_be_joined() -> None:
    found = places({"out": EXTERNAL, "other": {"command": ["true"]}})
    assert [(each.process, each.external) for each in found.values()] == [("", True)] * 2


def test_a_program_of_a_launch_file_is_named_after_its_node() -> None:
    stack = {"launch": {"path": "./stack.launch.py"}, "subscribes": {"image": IMAGE}}
    made = plan(
        STRAIGHT,
        harness=GRAPH | {"in": "stack/talker"},
        graph={"nodes": {"stack": stack}},
        monitors={"output": {"topic": "output", "format": IMAGE, "in": "stack/talker"}},
    )
    assert joins(made) == {"stack": JoinPlan(player=True, monitors=("output",), program="talker")}


def test_a_live_benchmark_has_monitors_only() -> None:
    live: dict[str, Any] = {"playback": {"mode": "live"}, "data_loader": {}, "slos": {}}
    made = plan(STRAIGHT, harness=GRAPH, **live)
    assert joins(made) == {"relay": JoinPlan(monitors=("output",))}


def test_no_metric_is_about_a_process_that_does_not_run() -> None:
    made = spec(STRAIGHT, harness=GRAPH)
    assert process_names(made, build_wiring(made)) == ("relay",)


# How many starts a run has, and which iterations each of them plays.


def spec_with(**sections: str) -> Spec:
    loaded = load_spec(example(**sections), file="example.r2b.yaml")
    assert loaded.spec is not None, loaded.diagnostics
    return loaded.spec


@pytest.mark.parametrize(
    ("benchmark", "starts"),
    [
        ("{rates: [30 Hz]}", 5),
        ("{rates: [30 Hz], iterations: 1}", 1),
        ("{rates: [30 Hz], iterations: 3}", 1),
        ("{rates: [30 Hz], iterations: 4}", 2),
        ("{rates: [30 Hz], iterations: 7}", 3),
        ("{rates: [30 Hz], iterations: 10}", 5),
        ("{rates: [30 Hz], iterations: 100}", 5),
        ("{rates: [30 Hz], iterations: 100, starts: 20}", 20),
        ("{rates: [30 Hz], iterations: 3, starts: 1}", 1),
        ("{rates: [30 Hz], iterations: 2, max_iterations: 20}", 1),
        ("{search: {min: 5 Hz, max: 50 Hz}}", 1),
    ],
)
def test_each_start_has_at_least_two_iterations(benchmark: str, starts: int) -> None:
    assert compile_plan(spec_with(benchmark=benchmark), None).starts == starts


def test_the_default_plays_for_as_long_as_before_there_were_starts() -> None:
    (play,) = compile_plan(spec_with(), None).play
    assert play.iterations * play.duration_ns == 25 * 10**9


def test_external_nodes_have_one_start() -> None:
    page = starts_of_external_nodes.page
    for written in (page.failing, page.passing):
        loaded = load_spec(written, file="example.r2b.yaml")
        assert loaded.spec is not None
        assert compile_plan(loaded.spec, None).starts == 1


def test_too_many_starts_are_an_error_with_both_ways_out() -> None:
    from r2bspec.check import check

    for iterations, ways in ((4, "set 'starts' to 2, or 'iterations' to 10"), (1, "set 'itera")):
        benchmark = f"{{iterations: {iterations}, starts: 5, rates: [30 Hz]}}"
        loaded = load_spec(example(benchmark=benchmark), file="example.r2b.yaml")
        (found,) = [
            each for each in check(loaded, offline=True) if each.code == iterations_per_start.code
        ]
        assert ways in found.help
        assert "'starts: 1'" in found.help


def test_a_run_of_a_pair_has_one_start() -> None:
    plan = compile_plan(spec_with(), None)
    assert plan.starts == 5
    assert single_run_plan(plan).starts == 1


def test_the_number_of_starts_is_part_of_how_is_measured() -> None:
    one = compile_plan(spec_with(benchmark="{rates: [30 Hz], starts: 1}"), None)
    (found,) = load_differences(one, compile_plan(spec_with(), None))
    assert str(found) == "starts: 1 -> 5"


def lengths(groups: tuple[range, ...]) -> list[int]:
    return [len(group) for group in groups]


@pytest.mark.parametrize("starts", [1, 2, 3, 5, 7])
def test_starts_share_the_iterations_evenly(starts: int) -> None:
    for iterations in range(1, 30):
        groups = iterations_of_starts(iterations, starts)
        assert [index for group in groups for index in group] == list(range(1, iterations + 1))
        assert max(lengths(groups)) - min(lengths(groups)) <= 1
        assert len(groups) == min(starts, iterations)


@pytest.mark.parametrize(
    ("iterations", "starts", "most", "expected"),
    [
        (10, 5, 0, [2, 2, 2, 2, 2]),
        (10, 5, 25, [2, 2, 2, 2, 2, 3, 2, 2, 2, 2, 2, 2]),
        (7, 3, 14, [3, 2, 2, 3, 2, 2]),
        (10, 5, 11, [2, 2, 2, 2, 2, 1]),
        (5, 1, 20, [20]),
    ],
)
def test_what_comes_on_top_is_played_in_further_starts(
    iterations: int, starts: int, most: int, expected: list[int]
) -> None:
    groups = iterations_of_starts(iterations, starts, most)
    assert lengths(groups) == expected
    played = [index for group in groups for index in group]
    assert played == list(range(1, max(iterations, most) + 1))


# Promise: messages that a synchroniser in the graph would pair are one step, and only these.


MS = 1_000_000

STAMPS = st.lists(st.integers(0, 2000), min_size=1, max_size=30, unique=True)


def recorded(topic: str, *stamps_ns: int) -> BufferIndex:
    return BufferIndex(
        topic=topic,
        type="sensor_msgs/msg/Image",
        has_header=True,
        stamps_ns=stamps_ns,
        sizes=(100,) * len(stamps_ns),
        times_ns=stamps_ns,
    )


def test_two_cameras_three_milliseconds_apart_are_pairs_and_keep_their_difference() -> None:
    left = recorded("/left", *(step * 33 * MS for step in range(10)))
    right = recorded("/right", *(step * 33 * MS + 3 * MS for step in range(10) if step != 4))
    aligned = align([left, right], 0, [10 * MS, 10 * MS])
    assert len(aligned.steps) == 9
    assert (4, 4) not in aligned.steps
    assert aligned.unpaired == {"/left": 1}
    assert set(aligned.stamp_offsets_ns) == {(-3 * MS, 0)}


def test_a_slop_that_nothing_needs_changes_nothing() -> None:
    left, right = recorded("/left", 10, 20, 30), recorded("/right", 10, 20, 30)
    assert align([left, right], 0, [5, 5]) == align([left, right], 0)


def test_the_larger_slop_of_a_pair_counts() -> None:
    assert pair_nearest([[0, 100], [8, 108]], [0, 10]) == ((0, 0), (1, 1))
    assert pair_nearest([[0, 100], [8, 108]], [0, 5]) == ()


def test_the_input_with_the_fewest_messages_leads() -> None:
    camera, imu = [0, 33, 66], list(range(1, 70, 5))
    pairs = pair_nearest([camera, imu], [10, 10])
    assert [camera[one] for one, _ in pairs] == camera
    assert [imu[other] for _, other in pairs] == [1, 31, 66]


def test_a_message_goes_to_the_nearer_one_of_two() -> None:
    assert pair_nearest([[0, 6], [5, 90]], [10, 10]) == ((1, 0),)


@given(left=STAMPS, right=STAMPS, slop=st.integers(0, 100))
def test_pairs_are_within_the_slop_ordered_and_disjoint(
    left: list[int], right: list[int], slop: int
) -> None:
    pairs = pair_nearest([left, right], [slop, slop])
    stamps = [(left[one], right[other]) for one, other in pairs]
    assert all(abs(one - other) <= slop for one, other in stamps)
    assert stamps == sorted(stamps)
    assert len({one for one, _ in pairs}) == len({other for _, other in pairs}) == len(pairs)
    # Neither of a pair has a nearer partner.
    for one, other in stamps:
        assert min(abs(one - each) for each in right) == abs(one - other)
        assert min(abs(other - each) for each in left) == abs(one - other)


@given(left=STAMPS, right=STAMPS)
def test_without_a_slop_stamps_are_equal(left: list[int], right: list[int]) -> None:
    pairs = pair_nearest([left, right], [0, 0])
    assert [left[one] for one, _ in pairs] == sorted(set(left) & set(right))
