"""Nodes of the running ROS graph as external nodes of a spec."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from r2bspec.authoring.draft_nodes import DraftNodes
from r2bspec.errors import R2bspecError, UsageError
from r2bspec.interop.script_import.spec_values import identifier, unique_name
from r2bspec.interop.script_import.yaml_writer import Block, flow

_SLACK_S = 60.0
_MAX_SHOWN = 20
"""Parameters of a node that its comment shows."""

_COMMON_TOPICS = frozenset({"/tf", "/tf_static", "/clock"})


class NoGraphError(R2bspecError):
    """The running graph cannot be inspected, or has no nodes."""

    code = "R2B601"


def inspect_graph(timeout_s: float) -> list[dict[str, Any]]:
    """The nodes of the graph in the ROS domain of this environment.

    Args:
        timeout_s: how long to wait for the first node.

    Raises:
        UsageError: ROS 2 is not installed, or there are no nodes.
        NoGraphError: the inspection failed.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise UsageError("ROS 2 is not installed, so there is no graph to read", code="R2B620")
    with tempfile.TemporaryDirectory() as scratch:
        target = Path(scratch, "graph.json")
        words = [sys.executable, "-P", "-m", "r2bspec.harness.inspect_nodes"]
        try:
            done = subprocess.run(
                [*words, str(timeout_s), str(target)],
                capture_output=True,
                text=True,
                timeout=timeout_s + _SLACK_S,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise NoGraphError("the inspection of the graph does not end") from error
        if done.returncode or not target.is_file():
            last = (done.stderr.strip().splitlines() or ["it ended without a result"])[-1]
            raise NoGraphError(f"the graph cannot be inspected: {last}")
        found: list[dict[str, Any]] = json.loads(target.read_text(encoding="utf-8"))
    if not found:
        raise UsageError(
            "there are no nodes in the ROS graph of this environment",
            hint="Start the system first; ROS_DOMAIN_ID and RMW_IMPLEMENTATION must be its own.",
        )
    return found


def add_graph_nodes(draft: DraftNodes, nodes: list[dict[str, Any]]) -> None:
    """Add running nodes as external ones, with their topics, types and QoS profiles."""
    keys = draft.keys
    for each in nodes:
        key = unique_name(identifier(each["name"]), keys)
        if key != each["name"]:
            draft.unknown.append(
                f"{each['namespace'].rstrip('/')}/{each['name']} shares its name with another "
                f"node, which a spec cannot say: here it is {key}, and a run will not find it"
            )
        draft.nodes.add(key, _entry(each), _comments(each))
    draft.is_absolute = True
    started = (
        "how the nodes are started: they are external here, so they must run before a benchmark; "
        "replace 'external' by their package, plugin, executable or launch file"
    )
    names = "their remappings: ROS shows the names of topics after remapping only"
    draft.unknown += [started, names]


def _entry(node: dict[str, Any]) -> Block:
    block = Block()
    block.add("external", True)
    if node["namespace"] != "/":
        block.add("namespace", node["namespace"])
    for side in ("subscribes", "publishes"):
        topics = Block()
        for topic, kind in sorted(node[side].items()):
            if topic not in _COMMON_TOPICS:
                topics.add(topic, kind)
        block.add(side, topics)
    profiles = Block()
    for topic, profile in sorted(node["qos"].items()):
        different = {
            key: value
            for key, value in profile.items()
            if (key, value) not in {("reliability", "reliable"), ("durability", "volatile")}
        }
        if topic not in _COMMON_TOPICS:
            profiles.add(topic, different)
    block.add("qos", profiles)
    return block


def _comments(node: dict[str, Any]) -> list[str]:
    shown = {
        name: each["default"] for name, each in node["parameters"].items() if "default" in each
    }
    if not shown:
        return []
    lines = [f"  {name}: {flow(value)}" for name, value in list(shown.items())[:_MAX_SHOWN]]
    more = len(shown) - len(lines)
    return ["Its parameters:", *lines, *([f"  and {more} more"] if more > 0 else [])]
