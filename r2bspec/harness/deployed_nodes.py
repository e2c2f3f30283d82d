"""Runs Python nodes in one process, or brings lifecycle nodes up; imports nothing of r2bspec.

A launch file that r2bspec writes starts a copy of this file, with what to run as JSON:

    python3 deployment_nodes.py '{"executor": "multi_threaded", "threads": 4, "nodes": [
        {"target": "my_package.nodes.Camera", "name": "left", "namespace": "/", "remappings": {},
         "parameters": {}}]}'
    python3 deployment_nodes.py '{"states": {"/left": "active"}}'

A target is ``module.Class`` or ``./file.py:Class``, relative to the working directory; also a
function that returns a node, or that is a program.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import (
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    SingleThreadedExecutor,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.utilities import try_shutdown

_KEYWORDS = ("namespace", "cli_args", "use_global_arguments", "parameter_overrides")
_TRANSITIONS = {"inactive": ("configure",), "active": ("configure", "activate")}
_TRANSITION_IDS = {"configure": 1, "activate": 3}  # of lifecycle_msgs/msg/Transition


def main() -> int:
    """Run the nodes that the argument names, until the process is told to end."""
    wanted = json.loads(sys.argv[1])
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        if "states" in wanted:
            _bring_up(wanted["states"])
        else:
            _run(wanted)
    try_shutdown()
    return 0


def _run(process: dict[str, Any]) -> None:
    made = [(node, _find(node["target"])) for node in process["nodes"]]
    if len(made) == 1 and not _takes_keywords(made[0][1]):
        nodes = _make_alone(*made[0])
    else:
        rclpy.init(args=sys.argv[:1])
        nodes = [_make(node, factory) for node, factory in made]
    executor: Executor = (
        MultiThreadedExecutor(num_threads=process["threads"] or None)
        if process["executor"] == "multi_threaded"
        else SingleThreadedExecutor()
    )
    for node in nodes:
        executor.add_node(node)
    if nodes:
        executor.spin()


def _find(target: str) -> Any:
    path, colon, name = target.rpartition(":")
    if not colon:
        module, _, name = target.rpartition(".")
        return getattr(importlib.import_module(module), name)
    file = Path(path).resolve()
    folder, parts = file.parent, [file.stem]
    while (folder / "__init__.py").is_file():  # a module of its package
        parts.insert(0, folder.name)
        folder = folder.parent
    sys.path[:0] = dict.fromkeys((str(folder), str(file.parent)))
    return getattr(importlib.import_module(".".join(parts)), name)


def _takes_keywords(factory: Any) -> bool:
    try:
        inspect.signature(factory).bind_partial(**dict.fromkeys(_KEYWORDS))
    except TypeError:
        return False
    except ValueError:
        return True
    return True


def _make(node: dict[str, Any], factory: Any) -> Any:
    rules = [f"__node:={node['name']}", *_remappings(node)]
    return factory(
        namespace=node["namespace"],
        cli_args=["--ros-args", *(word for rule in rules for word in ("-r", rule))],
        use_global_arguments=False,
        parameter_overrides=[
            Parameter(name, value=value) for name, value in _parameters(node).items()
        ],
    )


def _make_alone(node: dict[str, Any], factory: Any) -> list[Node]:
    """Call what takes no keyword arguments as ``ros2 run`` does: they are on the command line."""
    words = []
    for rule in (f"__node:={node['name']}", f"__ns:={node['namespace']}", *_remappings(node)):
        words += ["-r", rule]
    for name, value in _parameters(node).items():
        words += ["-p", f"{name}:={json.dumps(value)}"]
    sys.argv[:] = [node["target"], "--ros-args", *words]
    rclpy.init(args=sys.argv)
    initialise = Context.init

    def init_once(context: Context, *arguments: Any, **options: Any) -> None:
        if not context.ok():
            initialise(context, *arguments, **options)

    Context.init = init_once  # type: ignore[assignment,method-assign]
    made = factory()
    return [made] if isinstance(made, Node) else []


def _remappings(node: dict[str, Any]) -> Iterator[str]:
    return (f"{before}:={after}" for before, after in node["remappings"].items())


def _parameters(node: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters, with the values of environment variables that they refer to."""

    def value_of(value: Any) -> Any:
        if isinstance(value, list):
            return [value_of(item) for item in value]
        if not isinstance(value, str):
            return value
        return re.sub(r"\$\(env (\w+)\)", lambda found: os.environ.get(found[1], found[0]), value)

    return {name: value_of(value) for name, value in node["parameters"].items()}


def _bring_up(states: dict[str, str]) -> None:
    """Configure all nodes in their order, then activate those that are to be active."""
    rclpy.init(args=sys.argv[:1])
    change_state = importlib.import_module("lifecycle_msgs.srv").ChangeState
    node = Node("bring_up")
    for transition, number in _TRANSITION_IDS.items():
        for name, state in states.items():
            if transition not in _TRANSITIONS.get(state, ()):
                continue
            client = node.create_client(change_state, f"{name}/change_state")
            client.wait_for_service()
            request = change_state.Request()
            request.transition.id = number
            future = client.call_async(request)
            rclpy.spin_until_future_complete(node, future)
            answer = future.result()
            if answer is None or not answer.success:
                raise SystemExit(f"{name}: {transition} has failed")


if __name__ == "__main__":
    sys.exit(main())
