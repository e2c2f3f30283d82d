"""Who writes and who reads which topic, in both phases."""

from __future__ import annotations

from typing import Any

import pytest
from wiring_specs import IMAGE, INFO, spec

from r2bspec.plan.wiring.build_wiring import build_wiring
from r2bspec.plan.wiring.companion_files import CompanionFiles
from r2bspec.plan.wiring.node_interface import (
    Interface,
    InterfaceEntry,
    ParameterInfo,
    reference_node_interfaces,
)
from r2bspec.plan.wiring.wiring import PhaseWiring, WiredEndpoint

POSES = "geometry_msgs/msg/PoseArray"

TABLE = {
    "nodes.Filter": InterfaceEntry(subscribes={"in": IMAGE}, publishes={"out": IMAGE}),
    "nodes.Any": InterfaceEntry(
        subscribes={"in": "$(parameter format)"},
        publishes={"$(parameter prefix)/out": "$(parameter format)"},
        parameters={
            "format": ParameterInfo("string", IMAGE),
            "prefix": ParameterInfo("string", "any"),
            "unset": ParameterInfo("string"),
        },
    ),
}
FILES = CompanionFiles(sources=TABLE)
FILTER = {"filter": {"python": "nodes.Filter", "remappings": {"in": "image"}}}


def wired(nodes: dict[str, Any]) -> PhaseWiring:
    return build_wiring(spec(nodes), companion_files=FILES).measure


def interface(node: dict[str, Any]) -> Interface:
    return wired({"n": node}).nodes[0].interface


def owners(endpoints: tuple[WiredEndpoint, ...]) -> list[str]:
    return [endpoint.owner for endpoint in endpoints]


def test_the_harness_meets_the_nodes_on_topics() -> None:
    wiring = build_wiring(spec(FILTER), bag_types={"/camera": INFO}, companion_files=FILES)
    before, measure = wiring.phases
    assert before.publishers("/r2b/raw")[0].type == INFO
    assert owners(before.publishers("/r2b/raw")) == ["loader"]
    assert owners(before.subscriptions("/r2b/raw")) == ["recorder"]
    assert owners(measure.publishers("/r2b/image")) == ["player"]
    assert owners(measure.subscriptions("/r2b/image")) == ["/r2b/filter"]
    assert owners(measure.publishers("/r2b/out")) == ["/r2b/filter"]
    assert [each.monitor for each in measure.subscriptions("/r2b/out")] == ["result"]
    assert measure.topics == ("/r2b/image", "/r2b/out")


def test_an_endpoint_points_at_what_decides_its_topic() -> None:
    nodes = {
        "remapped": {"python": "nodes.Filter", "remappings": {"in": "image"}},
        "stated": {"command": ["x"], "publishes": {"other": IMAGE}},
        "plain": {"python": "nodes.Filter"},
    }
    measure = wired(nodes)
    place = ("graph", "nodes")
    paths = {
        (endpoint.owner, endpoint.own_name): (endpoint.path, endpoint.topic_is_key)
        for endpoint in measure.endpoints
    }
    assert paths["/r2b/remapped", "in"] == ((*place, "remapped", "remappings", "in"), False)
    assert paths["/r2b/stated", "other"] == ((*place, "stated", "publishes", "other"), True)
    assert paths["/r2b/plain", "in"] == ((*place, "plain"), True)


def test_a_node_in_a_namespace_resolves_its_names_there() -> None:
    nodes = {
        "filter": {
            "python": "nodes.Filter",
            "namespace": "left",
            "remappings": {"in": "/r2b/image", "out": "~/out"},
        }
    }
    measure = wired(nodes)
    assert measure.nodes[0].name == "/r2b/left/filter"
    assert owners(measure.subscriptions("/r2b/image")) == ["/r2b/left/filter"]
    assert owners(measure.publishers("/r2b/left/filter/out")) == ["/r2b/left/filter"]


def test_of_an_unknown_node_nothing_is_guessed() -> None:
    nodes = {
        "unknown": {"package": "p", "executable": "e"},
        "half": {"command": ["x"], "publishes": {"out": IMAGE}},
    }
    measure = wired(nodes)
    assert [node.key for node in measure.possible_publishers] == ["unknown"]
    assert [node.key for node in measure.possible_subscribers] == ["unknown", "half"]
    assert measure.endpoints_of("/r2b/unknown") == ()


def test_what_is_reached_follows_nodes_and_ends_in_circles() -> None:
    nodes = {
        "first": {"python": "nodes.Filter", "remappings": {"in": "image", "out": "a"}},
        "second": {"python": "nodes.Filter", "remappings": {"in": "a", "out": "b"}},
        "back": {"python": "nodes.Filter", "remappings": {"in": "b", "out": "a"}},
        "aside": {"python": "nodes.Filter", "remappings": {"in": "c", "out": "d"}},
    }
    measure = wired(nodes)
    assert measure.downstream_of(["/r2b/image"]) == {"/r2b/image", "/r2b/a", "/r2b/b"}
    assert measure.downstream_of([]) == frozenset()
    assert measure.upstream_of("/r2b/b") == {"/r2b/image", "/r2b/a", "/r2b/b"}
    assert measure.upstream_of("/r2b/nowhere") == {"/r2b/nowhere"}
    in_cycle = [end.own_name for end in measure.endpoints if measure.is_in_cycle(end)]
    assert in_cycle == ["in", "out", "in", "out"]


@pytest.mark.parametrize(
    ("node", "ros"),
    [
        ({"python": "nodes.Filter"}, True),
        ({"package": "p", "executable": "e"}, True),
        ({"command": ["x"]}, False),
        ({"command": ["x"], "env": {"A": "1"}}, False),
        ({"command": ["x"], "remappings": {"a": "b"}}, True),
        ({"command": ["x"], "parameters": {"a": 1}}, True),
        ({"command": ["x"], "namespace": "left"}, True),
        ({"command": ["x"], "publishes": {"a": IMAGE}}, True),
    ],
)
def test_a_command_of_which_nothing_ros_is_said_may_be_anything(
    node: dict[str, Any], ros: bool
) -> None:
    assert wired({"n": node}).nodes[0].is_ros_process is ros


def test_parameters_decide_types_and_names() -> None:
    measure = wired({"any": {"python": "nodes.Any", "parameters": {"format": POSES}}})
    endpoint = measure.endpoints_of("/r2b/any")[0]
    assert endpoint.type_path == ("graph", "nodes", "any", "parameters", "format")
    assert endpoint.type_parameter == "format"
    known = measure.nodes[0].interface
    assert known.subscribes == {"in": POSES}
    assert known.publishes == {"any/out": POSES}
    assert known.type_parameters == {"in": "format", "any/out": "format"}
    assert interface({"python": "nodes.Any"}).subscribes == {"in": IMAGE}


def test_the_table_of_the_reference_nodes_is_well_formed() -> None:
    table = reference_node_interfaces()
    assert "r2bspec.nodes.RelayNode" in table
    for name, entry in table.items():
        for kind in {**(entry.subscribes or {}), **(entry.publishes or {})}.values():
            assert "/msg/" in kind or kind.startswith("$(parameter "), name
        nodes = build_wiring(spec({"n": {"python": name}})).measure.nodes
        assert "$(" not in str(nodes[0].interface.subscribes)
