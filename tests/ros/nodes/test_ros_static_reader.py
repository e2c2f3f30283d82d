"""What is read from the source of a node is what the node has when it runs.

Nodes are generated from the ways in which people write them, plain ones and roundabout ones. Each
is really made, and read. What the reader is sure of must be true; it may be sure of nothing.
"""

from __future__ import annotations

import importlib.util
import itertools
import os
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nightly import size

pytest.importorskip("rclpy")

from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from r2bspec.plan.wiring.ast_reader import read_node_class
from r2bspec.plan.wiring.name_resolution import expand
from r2bspec.plan.wiring.node_interface import InterfaceEntry
from r2bspec.plan.wiring.python_files import read_python_file

_WAYS = yaml.safe_load(
    Path(__file__).with_name("ways_to_write_nodes.yaml").read_text(encoding="utf-8")
)
HEAD, METHODS = _WAYS["head"], _WAYS["methods"]
TOPICS, PARAMETERS = _WAYS["topics"], _WAYS["parameters"]
BASE_CALLS, CLASSES, TAILS = _WAYS["base_calls"], _WAYS["classes"], _WAYS["tails"]


@dataclass(frozen=True)
class Source:
    """A file with a class N."""

    text: str

    def __repr__(self) -> str:
        return self.text


@st.composite
def sources(draw: st.DrawFn) -> Source:
    # Plain parts are frequent, so that the reader is often sure of something.
    plain = st.sampled_from(TOPICS[:5]) | st.sampled_from(PARAMETERS[:2])
    roundabout = st.sampled_from(TOPICS) | st.sampled_from(PARAMETERS)
    lines = draw(st.lists(plain, max_size=3)) + draw(st.lists(roundabout, max_size=2))
    lines = draw(st.permutations(lines))
    types = st.sampled_from(["Bool", "Text", "Number"])
    body = [
        each.replace("NAME", f"t{index}").replace("TYPE", draw(types))
        for index, each in enumerate(lines)
    ]
    constructor = [draw(st.just(BASE_CALLS[0]) | st.sampled_from(BASE_CALLS)), *body]
    head = draw(st.just(CLASSES[0]) | st.sampled_from(CLASSES))
    self_name = draw(st.sampled_from(["self"] * 9 + ["this"]))
    init = [f"    def __init__({self_name}, **kwargs):"]
    init += [f"        {each}".replace("self", self_name) for each in constructor]
    methods = METHODS
    if draw(st.integers(0, 4)) > 0:  # without these, more is certain
        methods = METHODS.split("\n    def build")[0] + "\n"
        used = "\n".join(body)
        for name in ("build", "configure", "never"):
            if f"self.{name}" in used:
                methods = METHODS
    tail = draw(st.just("") | st.sampled_from(TAILS))
    return Source("\n".join([HEAD, "", head, *init, methods, "", tail, ""]))


@pytest.fixture(scope="module")
def context() -> Iterator[Context]:
    with mock.patch.dict(os.environ, ROS_AUTOMATIC_DISCOVERY_RANGE="OFF"):
        made = Context()
        made.init()
        yield made
        made.try_shutdown()


COMMON_PARAMETERS = {"use_sim_time", "start_type_description_service"}


def make(file: Path, context: Context) -> Node:
    """The node of a file, as the node host makes it."""
    description = importlib.util.spec_from_file_location(file.stem, file)
    assert description is not None
    assert description.loader is not None
    module = importlib.util.module_from_spec(description)
    sys.modules[file.stem] = module
    try:
        description.loader.exec_module(module)
        found = module.N(
            context=context,
            namespace="/r2b",
            cli_args=["--ros-args", "-r", "__node:=n"],
            use_global_arguments=False,
            parameter_overrides=[Parameter("given", value=3)],  # type: ignore[no-untyped-call]
        )
    finally:
        del sys.modules[file.stem]
    assert isinstance(found, Node)
    return found


def topics(endpoints: Any) -> set[tuple[str, str]]:
    """The topics and types of endpoints of a node, without those of every node."""
    return {
        (endpoint.topic_name, f"std_msgs/msg/{endpoint.msg_type.__name__}")
        for endpoint in endpoints
        if endpoint.topic_name not in {"/rosout", "/parameter_events"}
    }


def agree(read: Any, found: set[tuple[str, str]]) -> bool:
    """Whether these are the topics of a node, with its types where they are known."""
    known = {expand(name, "n", "/r2b"): kind for name, kind in read.items()}
    return {name: kind if known.get(name) else "" for name, kind in found} == known


def test_what_is_read_is_what_runs(context: Context, tmp_path: Path) -> None:
    known: Counter[str] = Counter()
    numbers = itertools.count(1)

    @settings(
        max_examples=size(60, 300),
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(source=sources())
    def compare(source: Source) -> None:
        file = tmp_path / f"generated_{next(numbers)}.py"
        file.write_text(source.text, encoding="utf-8")
        compile(source.text, file.name, "exec")
        try:
            node = make(file, context)
        except Exception:
            known["does not run"] += 1
            return
        known["runs"] += 1
        try:
            known.update(compared(read_node_source(file, "N"), node))
        finally:
            node.destroy_node()  # type: ignore[no-untyped-call]

    compare()
    # Nodes are made, and the reader is sure of many.
    assert known["runs"] > 5 * known["does not run"], known
    for part in ("publishes", "subscribes", "parameters"):
        assert known[part] > known["runs"] / size(20, 5), known


def read_node_source(file: Path, name: str) -> InterfaceEntry | None:
    """The interface of the class of a file."""
    tree = read_python_file(file)
    return None if tree is None else read_node_class(tree, name)


def compared(read: InterfaceEntry | None, node: Node) -> list[str]:
    """The parts of an interface that are known, all of which are those of the node."""
    known = []
    if read is not None and read.publishes is not None and not read.may_publish_more:
        known.append("publishes")
        assert agree(read.publishes, topics(node.publishers))
    if read is not None and read.subscribes is not None and not read.may_subscribe_more:
        known.append("subscribes")
        assert agree(read.subscribes, topics(node.subscriptions))
    if read is not None and read.parameters is not None:
        known.append("parameters")
        names = set(node.list_parameters([], 0).names)
        assert set(read.parameters) == names - COMMON_PARAMETERS
    return known


@pytest.mark.parametrize("line", [*TOPICS[:7], *PARAMETERS[:3]])
def test_plain_ways_are_understood(line: str, tmp_path: Path) -> None:
    text = line.replace("NAME", "t").replace("TYPE", "Bool")
    methods = METHODS.split("\n    def build")[0]
    code = [HEAD, "", CLASSES[0], "    def __init__(self, **kwargs):", f"        {BASE_CALLS[0]}"]
    file = tmp_path / "nodes.py"
    file.write_text("\n".join([*code, f"        {text}", methods]), encoding="utf-8")
    read = read_node_source(file, "N")
    assert read is not None
    assert not read.may_publish_more
    assert not read.may_subscribe_more
    assert read.publishes is not None
    assert read.subscribes is not None
    assert read.parameters is not None
    assert len(read.publishes) + len(read.subscribes) + len(read.parameters) == 1
