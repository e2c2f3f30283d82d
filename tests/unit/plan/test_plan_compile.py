"""What a spec's plan says of processes, starts and steps, besides what tests/golden/plan shows."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from plan_specs import BAG, IMAGE, INFO, PREPROCESSED, STRAIGHT, plan, spec

from example_spec import example
from r2bspec.bags.recording import TopicInfo
from r2bspec.execute.build_schedule import align
from r2bspec.ipc.buffers import BufferIndex
from r2bspec.language.load_spec import load_spec
from r2bspec.language.spec import Spec
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.command_lines import flow_yaml
from r2bspec.plan.comparability import graph_differences
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.interim_looks import iterations_of_starts
from r2bspec.plan.nearest_stamps import clock_ahead, pair_nearest
from r2bspec.plan.process_plans import PartPlacement, find_places, graph_processes, process_names
from r2bspec.plan.wiring.build_wiring import build_wiring
from r2bspec.plan.wiring.companion_files import CompanionFiles
from r2bspec.plan.wiring.parameter_files import ParameterFile

CASES = yaml.safe_load(Path(__file__).with_name("plans.yaml").read_text(encoding="utf-8"))


def has(found: Any, expected: Any) -> bool:
    """Whether a value of a plan has what is expected of it; a list has its items, and no others."""
    if isinstance(expected, dict):
        return all(key in found and has(found[key], value) for key, value in expected.items())
    if isinstance(expected, list):
        return len(found) == len(expected) and all(map(has, found, expected))
    return bool(found == expected)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_a_part_of_a_plan(case: dict[str, Any]) -> None:
    document = {"straight": STRAIGHT, "preprocessed": PREPROCESSED}[case.get("of", "straight")]
    found = json.loads(canonical_json(plan(document, **case.get("with", {}))))
    assert has(found, case["plan"]), found
    for key, names in case.get("names", {}).items():
        assert list(found[key]) == names


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
    assert flow_yaml(value) == text


def test_the_largest_message_is_known_only_if_all_sizes_are() -> None:
    assert plan().largest_message_bytes == 900_000
    topics = {
        **BAG.topics,
        "/camera/info": TopicInfo(name="/camera/info", type=INFO, count=1, rate_hz=0.0),
    }
    unknown = msgspec.structs.replace(BAG, topics=topics)
    assert compile_plan(spec(PREPROCESSED), unknown).largest_message_bytes == 0
    assert compile_plan(spec(PREPROCESSED), None).largest_message_bytes == 0


def test_without_a_bag_the_plan_says_what_the_spec_knows() -> None:
    blind = compile_plan(spec(PREPROCESSED), None)
    assert [topic.count for topic in blind.dataset.topics] == [0, 0]
    assert blind.dataset.topics[1].bag_topic == "camera/info"
    assert next(topic.type for topic in blind.topics if topic.name == "/r2b/image") == IMAGE


def test_parameters_of_files_reach_nodes_merged_and_commands_as_files() -> None:
    sources = [{"file": "p.yaml"}, {"values": {"own": 1}}]
    own: dict[str, Any] = {"parameter_sources": sources, "parameters": {"own": 1}}
    nodes = {"a": {"python": "r2bspec.nodes.RelayNode", **own}, "c": {"command": ["x"], **own}}
    files = {"p.yaml": ParameterFile(nodes=(("/**", {"format": "sensor_msgs/msg/Imu"}),))}
    made = compile_plan(
        spec(STRAIGHT, graph={"nodes": nodes}),
        BAG,
        companion_files=CompanionFiles(parameter_files=files),
    )
    relay, command = (each for each in made.processes if each.name in nodes)
    assert relay.nodes[0].parameters == {"format": "sensor_msgs/msg/Imu", "own": 1}
    assert command.argv[-4:] == ("-p", "own:=1", "--params-file", "p.yaml")
    types = {topic.name: topic.type for topic in made.topics}
    assert types["/r2b/input"] == "sensor_msgs/msg/Imu", "parameters decide types"


def test_extra_arguments_of_a_component_change_the_graph() -> None:
    component = {"package": "image_proc", "plugin": "image_proc::RectifyNode"}
    extra = {"intra_process": True, "extra_arguments": {"forward_global_arguments": False}}
    plain, made = (plan(STRAIGHT, graph={"nodes": {"a": component | more}}) for more in ({}, extra))
    changed = [str(difference.path[-1]) for difference in graph_differences(plain, made)]
    assert sorted(changed) == ["extra_arguments", "intra_process"]


def test_several_recordings_each_name_what_they_hold() -> None:
    loader = {
        "bag": {"dataset": "a"},
        "bags": [{"dataset": "a"}, {"dataset": "b"}],
        "topics": {"/camera/image": "loaded/image", "/other": "loaded/other"},
    }
    made = compile_plan(spec(STRAIGHT, data_loader=loader), [BAG, None])
    assert [dataset.source for dataset in made.datasets] == ["a", "b"]
    assert [topic.bag_topic for topic in made.datasets[0].topics] == ["/camera/image"]
    assert made.dataset == made.datasets[0]
    assert compile_plan(spec(STRAIGHT), BAG).datasets == ()


# Which processes of the graph get player and monitors with ``harness: {placement: graph}``.


FIRST = {"python": "r2bspec.nodes.RelayNode", "remappings": {"input": "image", "output": "middle"}}
SECOND = {"python": "r2bspec.nodes.RelayNode", "remappings": {"input": "middle"}}
READER = {"python": "r2bspec.nodes.RelayNode", "remappings": {"input": "image"}}
SILENT = {"command": ["./detector"], "namespace": "left"}
EXTERNAL = {"external": True, "subscribes": {"image": IMAGE}, "publishes": {"output": IMAGE}}
PYTHON = {"container": "py"}


@pytest.mark.parametrize(
    ("nodes", "named", "player", "monitor"),
    [
        ({"a": FIRST | PYTHON, "b": SECOND | PYTHON}, {}, "py", "py"),
        ({"detector": SILENT}, {}, "detector", "detector"),
        ({"one": FIRST, "two": READER}, {}, ("one", "two"), "two"),
        ({"one": FIRST, "two": READER}, {"player": "one"}, "one", "two"),
        ({"one": FIRST, "two": READER}, {"player": "two"}, "two", "two"),
        ({"a": FIRST, "b": SECOND}, {}, "a", "b"),
        ({"a": FIRST, "b": SECOND}, {"monitor": "a"}, "a", "a"),
        ({"a": FIRST, "b": SECOND}, {"player": "c"}, ("a", "b"), "b"),
    ],
)
def test_each_part_runs_where_its_topics_are(
    nodes: dict[str, Any], named: dict[str, str], player: Any, monitor: Any
) -> None:
    """Where that is not decided, and the spec names none, the possible ones are known."""
    found = places(nodes, named)
    where = [place.process or place.choices for place in (found["player"], found["out"])]
    assert where == [player, monitor]
    assert found["player"].named == named.get("player", "")


def test_external_nodes_cannot_be_joined() -> None:
    found = places({"out": EXTERNAL, "other": {"command": ["true"]}}, {})
    assert [(each.process, each.external) for each in found.values()] == [("", True)] * 2


def places(nodes: dict[str, Any], named: dict[str, str]) -> dict[str, PartPlacement]:
    """The places of the parts in a graph of these nodes."""
    harness = {"placement": "graph", "in": named.get("player", "")}
    monitor = {"topic": "output", "format": IMAGE, "in": named.get("monitor", "")}
    made = spec(
        STRAIGHT,
        harness=harness,
        graph={"nodes": nodes},
        monitors={"out": monitor},
        containers={"py": {"executable": "python"}},
    )
    wiring = build_wiring(made)
    return {place.part: place for place in find_places(made, wiring, graph_processes(made, wiring))}


@pytest.mark.parametrize(
    ("document", "sections", "names"),
    [
        (PREPROCESSED, {}, ("player", "relay", "driver", "script", "monitor")),
        (STRAIGHT, {"harness": {"placement": "graph"}}, ("relay",)),
    ],
)
def test_metrics_can_ask_for_the_processes_that_run(
    document: dict[str, Any], sections: dict[str, Any], names: tuple[str, ...]
) -> None:
    made = spec(document, **sections)
    assert process_names(made, build_wiring(made)) == names


# How many starts a run has, and which iterations each of them plays.


def spec_with(**sections: str) -> Spec:
    loaded = load_spec(example(**sections), file="example.r2b.yaml")
    assert loaded.spec is not None, loaded.diagnostics
    return loaded.spec


@pytest.mark.parametrize("starts", [1, 3])
def test_external_nodes_have_one_start(starts: int) -> None:
    node = "external: true, publishes: {output: sensor_msgs/msg/Image}"
    text = example(
        graph=f"nodes: {{camera: {{{node}}}}}", benchmark=f"{{rates: [30 Hz], starts: {starts}}}"
    )
    loaded = load_spec(text, file="example.r2b.yaml")
    assert loaded.spec is not None
    assert compile_plan(loaded.spec, None).starts == 1


def lengths(groups: tuple[range, ...]) -> list[int]:
    return [len(group) for group in groups]


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


def test_the_input_with_the_fewest_messages_leads() -> None:
    camera, imu = [0, 33, 66], list(range(1, 70, 5))
    pairs = pair_nearest([camera, imu], [10, 10])
    assert [camera[one] for one, _ in pairs] == camera
    assert [imu[other] for _, other in pairs] == [1, 31, 66]


def test_messages_of_one_stamp_are_paired_in_the_order_of_recording() -> None:
    assert pair_nearest([[0, 0, 0], [0, 0, 0, 0]], [0, 0]) == ((0, 0), (1, 1), (2, 2))
    assert pair_nearest([[5, 5, 5]], [0]) == ((0,), (1,), (2,))
    assert pair_nearest([[5, 5, 9], [6, 6, 9]], [2, 2]) == ((0, 0), (1, 1), (2, 2))


@pytest.mark.parametrize("late_ms", [0, 7])
def test_a_clock_that_is_ahead_is_seen_by_the_times_of_recording(late_ms: int) -> None:
    scans = [100 * MS * number for number in range(20)]
    images = [scan + late_ms * MS for scan in scans]
    ahead = [stamp + 5_000 * MS for stamp in scans]
    assert clock_ahead([scans, images], [scans, ahead], 0) == (0, 5_000 * MS)
    assert clock_ahead([images, scans], [ahead, scans], 0) == (5_000 * MS, 0)
    assert clock_ahead([scans, images], [scans, scans], 0) == (0, 0)


@given(left=STAMPS, right=STAMPS, slop=st.just(0) | st.integers(0, 100))
def test_pairs_are_within_the_slop_ordered_and_disjoint(
    left: list[int], right: list[int], slop: int
) -> None:
    pairs = pair_nearest([left, right], [slop, slop])
    stamps = [(left[one], right[other]) for one, other in pairs]
    assert all(abs(one - other) <= slop for one, other in stamps)
    assert stamps == sorted(stamps)
    assert len({one for one, _ in pairs}) == len({other for _, other in pairs}) == len(pairs)
    if not slop:
        assert [one for one, _ in stamps] == sorted((Counter(left) & Counter(right)).elements())
    # Neither of a pair has a nearer partner.
    for one, other in stamps:
        assert min(abs(one - each) for each in right) == abs(one - other)
        assert min(abs(other - each) for each in left) == abs(one - other)
