"""How each construct of the language becomes a part of a plan."""

from __future__ import annotations

from typing import Any

import pytest
from plan_specs import BAG, IMAGE, PREPROCESSED, STRAIGHT, plan, spec

from r2bspec.plan.command_lines import INCLUDED_LAUNCH
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.drawing import to_dot
from r2bspec.plan.plan import Plan, ProcessPlan, TapPlan
from r2bspec.wiring.companion_files import CompanionFiles
from r2bspec.wiring.parameter_files import ParameterFile

RECTIFY = {"package": "image_proc", "plugin": "image_proc::RectifyNode"}
RELAY = {"python": "r2bspec.nodes.RelayNode"}
LIVE: dict[str, Any] = {"playback": {"mode": "live"}, "data_loader": {}, "slos": {}}


def graph(placement: str = "separate", **nodes: Any) -> dict[str, Any]:
    return {"placement": placement, "nodes": nodes}


def process(of: Plan, name: str) -> ProcessPlan:
    return next(each for each in of.processes if each.name == name)


# Containers and placement


def test_nodes_of_a_container_are_loaded_in_order() -> None:
    made = plan(
        STRAIGHT,
        containers={
            "front": {
                "executable": "component_container_mt",
                "threads": 4,
                "env": {"A": "1"},
                "cpus": [0, 1],
                "nice": 5,
                "prefix": ["taskset", "1"],
                "memory_limit": "1 GiB",
            }
        },
        graph=graph(
            a={**RECTIFY, "container": "front", "env": {"B": "2"}},
            b={**RECTIFY, "container": "front", "namespace": "left", "parameters": {"x": 1}},
        ),
    )
    front = process(made, "front")
    assert front.role == "container"
    assert front.argv == (
        *("taskset", "1", "$(executable rclcpp_components component_container_mt)"),
        *("--ros-args", "-r", "__node:=front", "-r", "__ns:=/r2b", "-p", "thread_num:=4"),
    )
    assert [(each.name, each.package, each.plugin) for each in front.nodes] == [
        ("/r2b/a", "image_proc", "image_proc::RectifyNode"),
        ("/r2b/left/b", "image_proc", "image_proc::RectifyNode"),
    ]
    assert front.env == {"A": "1", "B": "2"}
    assert (front.cpus, front.nice, front.container) == ((0, 1), 5, "front")
    assert front.memory_limit_bytes == 2**30


def test_a_python_container_is_a_host_with_an_executor() -> None:
    made = plan(
        STRAIGHT,
        containers={"py": {"executable": "python", "executor": "multi_threaded", "threads": 3}},
        graph=graph(a={**RELAY, "container": "py"}),
    )
    host = process(made, "py")
    assert (host.role, host.executor, host.threads) == ("host", "multi_threaded", 3)


def test_a_component_alone_has_a_container_of_its_own() -> None:
    made = process(plan(STRAIGHT, graph=graph(a=RECTIFY)), "a")
    assert made.role == "container"
    assert "__node:=a_container" in made.argv


def test_placement_shared_gives_python_and_components_a_process_each() -> None:
    made = plan(STRAIGHT, graph=graph("shared", a=RECTIFY, b=RELAY, c={"command": ["x"]}))
    assert [(each.name, each.role) for each in made.processes] == [
        ("player", "player"),
        ("c", "command"),
        ("components", "container"),
        ("graph", "host"),
        ("monitor", "monitor"),
    ]


def test_placement_harness_puts_python_nodes_beside_player_and_monitor() -> None:
    made = plan(STRAIGHT, graph=graph("harness", a=RECTIFY, b=RELAY))
    assert [(each.name, each.role) for each in made.processes] == [
        ("harness", "harness"),
        ("a", "container"),
    ]
    assert [each.node for each in made.processes[0].nodes] == ["b"]


# Other kinds of nodes


def test_a_launch_file_is_included_with_namespace_and_remappings() -> None:
    node = {
        "launch": {"package": "cameras", "file": "c.launch.py", "arguments": {"fast": True}},
        "namespace": "left",
        "remappings": {"image": "left/image"},
    }
    assert process(plan(STRAIGHT, graph=graph(camera=node)), "camera").argv == (
        *("ros2", "launch", INCLUDED_LAUNCH, "package:=cameras", "file:=c.launch.py"),
        "namespace:=/r2b/left",
        'remappings:={"image": "left/image"}',
        'arguments:={"fast": "true"}',
    )


def test_an_external_node_has_no_process() -> None:
    made = plan(STRAIGHT, graph=graph(a=RELAY, b={"external": True, "publishes": {"x": IMAGE}}))
    assert "b" not in [each.name for each in made.processes]
    assert [(each.name, each.phase) for each in made.external] == [("/r2b/b", "measure")]


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
    topic = next(each for each in made.topics if each.name == "/r2b/input")
    assert topic.type == "sensor_msgs/msg/Imu", "parameters decide types"


# Data and playback


def test_several_recordings_each_name_what_they_hold() -> None:
    loader = {
        "bag": {"dataset": "a"},
        "bags": [{"dataset": "a"}, {"dataset": "b"}],
        "topics": {"/camera/image": "loaded/image", "/other": "loaded/other"},
    }
    made = compile_plan(spec(STRAIGHT, data_loader=loader), [BAG, None])
    assert [each.source for each in made.datasets] == ["a", "b"]
    assert [each.bag_topic for each in made.datasets[0].topics] == ["/camera/image"]
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
    assert [each.name for each in made.processes] == ["relay", "monitor"]
    assert "load" not in made.phases
    assert made.inputs == ()
    assert "cylinder" not in to_dot(made)


def test_transforms_are_written_by_the_harness() -> None:
    loader = {**STRAIGHT["data_loader"], "publish_tf": True, "publish_tf_static": True}
    made = plan(STRAIGHT, data_loader=loader)
    writers = {each.name: each.writers for each in made.topics}
    assert writers["/tf"] == writers["/tf_static"] == ("player",)
    assert made.dataset.publish_tf


# Monitors, steps, objectives


def test_taps_are_the_topics_on_the_way() -> None:
    nodes: dict[str, Any] = {
        "a": {**RELAY, "remappings": {"input": "image", "output": "b"}},
        "c": {**RELAY, "remappings": {"input": "b"}},
        "d": {**RELAY, "remappings": {"input": "b", "output": "aside"}},
    }
    monitor = {"topic": "output", "format": IMAGE, "taps": True, "label": "Out"}
    made = plan(STRAIGHT, graph=graph(**nodes), monitors={"output": monitor})
    assert made.monitors[0].taps == (TapPlan(topic="/r2b/b", type=IMAGE),)
    assert made.monitors[0].label == "Out"


def test_steps_stand_in_the_phases_in_which_they_happen() -> None:
    made = plan(
        STRAIGHT,
        setup={"model": {"command": ["make"], "creates": "m.plan", "directory": "models"}},
        ready={
            "up": {"log": {"process": "relay", "pattern": "ready"}},
            "map": {"topic": "map"},
            "srv": {"service": "relay/reset"},
            "file": {"file": "m.plan"},
        },
        after_ready={
            "reset": {"service": {"name": "relay/reset", "type": "std_srvs/srv/Empty"}},
            "say": {"command": ["echo", "go"]},
        },
    )
    assert made.phases[:4] == ("setup", "load", "start", "harness_overhead")
    assert made.phases[4:7] == ("graph", "ready", "after_ready")
    assert [(each.kind, each.target) for each in made.ready] == [
        ("log", "relay"),
        ("topic", "/r2b/map"),
        ("service", "/r2b/relay/reset"),
        ("file", "m.plan"),
    ]
    assert made.after_ready[0].service == "/r2b/relay/reset"
    assert made.after_ready[1].argv == ("echo", "go")
    assert made.setup[0].directory == "models"


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


@pytest.mark.parametrize("document", [PREPROCESSED, STRAIGHT], ids=["preprocessed", "straight"])
def test_new_parts_do_not_change_what_a_simple_plan_starts(document: dict[str, Any]) -> None:
    for each in plan(document).processes:
        assert (each.nice, each.cpus, each.threads, each.memory_limit_bytes) == (0, (), 0, 0)
