"""How the constructs of the language become parts of a plan that no other plan has.

Those that every plan can have are in tests/golden/plan.
"""

from __future__ import annotations

from typing import Any

from plan_specs import BAG, IMAGE, STRAIGHT, plan, spec

from r2bspec.plan.comparability import graph_differences
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.drawing import to_dot
from r2bspec.plan.plan import Plan, ProcessPlan
from r2bspec.plan.wiring.companion_files import CompanionFiles
from r2bspec.plan.wiring.parameter_files import ParameterFile

RECTIFY = {"package": "image_proc", "plugin": "image_proc::RectifyNode"}
RELAY = {"python": "r2bspec.nodes.RelayNode"}
LIVE: dict[str, Any] = {"playback": {"mode": "live"}, "data_loader": {}, "slos": {}}


def graph(placement: str = "separate", **nodes: Any) -> dict[str, Any]:
    return {"placement": placement, "nodes": nodes}


def process(of: Plan, name: str) -> ProcessPlan:
    return next(listed for listed in of.processes if listed.name == name)


# Containers and placement


def test_a_component_alone_has_a_container_of_its_own() -> None:
    made = process(plan(STRAIGHT, graph=graph(a=RECTIFY)), "a")
    assert made.role == "container"
    assert "__node:=a_container" in made.argv


def test_extra_arguments_of_a_component_are_in_the_plan_and_change_the_graph() -> None:
    plain = plan(STRAIGHT, graph=graph(a=RECTIFY))
    extra = {"intra_process": True, "extra_arguments": {"forward_global_arguments": False}}
    made = plan(STRAIGHT, graph=graph(a={**RECTIFY, **extra}))
    (loaded,) = process(made, "a").nodes
    assert loaded.intra_process is True
    assert loaded.extra_arguments == {"forward_global_arguments": False}
    changed = [difference.path[-1] for difference in graph_differences(plain, made)]
    assert sorted(map(str, changed)) == ["extra_arguments", "intra_process"]


def test_arguments_of_a_container_come_before_its_name() -> None:
    quiet = ["--ros-args", "--log-level", "warn"]
    containers = {"c": {"executable": "component_container_mt", "arguments": quiet}}
    made = plan(STRAIGHT, graph=graph(a={**RECTIFY, "container": "c"}), containers=containers)
    words = ["$(executable rclcpp_components component_container_mt)", *quiet, "--ros-args"]
    assert list(process(made, "c").argv[:5]) == words


def test_placement_harness_puts_python_nodes_beside_player_and_monitor() -> None:
    made = plan(STRAIGHT, graph=graph("harness", a=RECTIFY, b=RELAY))
    assert [(listed.name, listed.role) for listed in made.processes] == [
        ("harness", "harness"),
        ("a", "container"),
    ]
    assert [node.node for node in made.processes[0].nodes] == ["b"]


# Other kinds of nodes


def test_parameters_of_files_reach_nodes_merged_and_commands_as_files() -> None:
    sources = [{"file": "p.yaml"}, {"values": {"own": 1}}]
    document = spec(
        STRAIGHT,
        graph=graph(
            a={**RELAY, "parameter_sources": sources, "parameters": {"own": 1}},
            c={"command": ["x"], "parameter_sources": sources, "parameters": {"own": 1}},
        ),
    )
    file = ParameterFile(nodes=(("/**", {"format": "sensor_msgs/msg/Imu"}),))
    made = compile_plan(
        document, BAG, companion_files=CompanionFiles(parameter_files={"p.yaml": file})
    )
    parameters = {"format": "sensor_msgs/msg/Imu", "own": 1}
    assert process(made, "a").nodes[0].parameters == parameters
    assert process(made, "c").argv[-4:] == ("-p", "own:=1", "--params-file", "p.yaml")
    topic = next(
        planned_topic for planned_topic in made.topics if planned_topic.name == "/r2b/input"
    )
    assert topic.type == "sensor_msgs/msg/Imu", "parameters decide types"


# Data and playback


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


def test_a_timeline_has_no_rate() -> None:
    playback = {
        "mode": "timeline",
        "inputs": {"image": {"from": "loaded/image", "format": IMAGE, "timestamp": "none"}},
        "timeline": {"speed": "50 %", "translations": {"image": "20 ms"}},
        "record_timeline": True,
    }
    made = plan(STRAIGHT, playback=playback, benchmark={"duration": "4 s"})
    assert [each.rate_hz for each in made.play] == [0.0]
    assert made.timeline is not None
    assert (made.timeline.speed, made.timeline.recorded) == (0.5, True)
    assert (made.inputs[0].timestamp, made.inputs[0].later_ns) == ("none", 20_000_000)


def test_a_live_benchmark_loads_and_plays_nothing() -> None:
    made = plan(STRAIGHT, **LIVE)
    assert [listed.name for listed in made.processes] == ["relay", "monitor"]
    assert "load" not in made.phases
    assert made.inputs == ()
    assert "cylinder" not in to_dot(made)


def test_transforms_are_written_by_the_harness() -> None:
    loader = {**STRAIGHT["data_loader"], "publish_tf": True, "publish_tf_static": True}
    made = plan(STRAIGHT, data_loader=loader)
    writers = {topic.name: topic.writers for topic in made.topics}
    assert writers["/tf"] == writers["/tf_static"] == ("player",)
    assert made.dataset.publish_tf


# Monitors, steps, objectives


def test_objectives_that_do_not_count_are_left_out() -> None:
    require = ["latency.p50 < 1 s"]
    made = plan(
        STRAIGHT,
        variables={"threads": 2},
        slos={
            "on": {"at": "30 Hz", "require": require},
            "off": {"at": "30 Hz", "level": "off", "require": require},
            "two": {"at": "30 Hz", "when": {"threads": 2}, "require": require},
            "four": {"at": "30 Hz", "when": {"threads": 4}, "require": ["sustained"]},
        },
    )
    assert list(made.objectives) == ["on", "two"]
    assert made.sustained_hz == ()


# What does not change
