"""Which processes of the graph get player and monitors with ``harness: {placement: graph}``."""

from __future__ import annotations

from typing import Any

import pytest
from plan_specs import IMAGE, STRAIGHT, plan, spec

from r2bspec.plan.plan import JoinPlan, Plan
from r2bspec.plan.process_plans import PartPlacement, find_places, graph_processes, process_names
from r2bspec.plan.wiring.build_wiring import build_wiring

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
