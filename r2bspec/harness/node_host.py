"""The node host: creates the Python nodes of one process and spins them.

A node is any rclpy `Node` class whose constructor takes keyword arguments for `Node`, or a
function that returns one. It receives its namespace, name, remappings and parameter overrides as
from a launch file, and does not depend on r2bspec.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rclpy.executors import (
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    SingleThreadedExecutor,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from r2bspec.harness import rclpy_tools
from r2bspec.harness.control_channel import Channel, ChannelClosedError
from r2bspec.ipc import protocol
from r2bspec.plan.plan import NodePlan
from r2bspec.wiring.name_resolution import expand


class NodeError(Exception):
    """A node cannot be created; the message is for the user, the cause has the details."""

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.code = code
        self.hint = hint


def find_factory(target: str, base_dir: Path) -> Any:
    """The class or function that ``module.Class`` or ``./file.py:Class`` names.

    Raises:
        NodeError: the module or file cannot be imported, or has no such name.
    """
    path, colon, name = target.rpartition(":")
    if colon:
        module = _import_file((base_dir / path).resolve())
    else:
        module_name, _, name = target.rpartition(".")
        try:
            module = importlib.import_module(module_name)
        except ImportError as error:
            raise NodeError("R2B624", f"cannot import {module_name!r}: {error}") from error
    try:
        return getattr(module, name)
    except AttributeError as error:
        raise NodeError("R2B625", f"{path or module.__name__} has no {name!r}") from error
    except ImportError as error:
        raise NodeError("R2B624", f"cannot import {target!r}: {error}") from error


def _import_file(file: Path) -> Any:
    description = importlib.util.spec_from_file_location(file.stem, file)
    if description is None or description.loader is None or not file.is_file():
        raise NodeError("R2B624", f"{file} is not a Python file")
    module = importlib.util.module_from_spec(description)
    # Other files of its folder can be imported, as if it were run as a script.
    sys.path.insert(0, str(file.parent))
    sys.modules[file.stem] = module
    try:
        description.loader.exec_module(module)
    except Exception as error:
        raise NodeError("R2B624", f"cannot import {file.name}: {error}") from error
    return module


def make_node(plan: NodePlan, base_dir: Path) -> Node:
    """Create one node of a plan.

    Raises:
        NodeError: it cannot be imported or its constructor fails.
    """
    factory = find_factory(plan.target, base_dir)
    arguments = ["--ros-args", "-r", f"__node:={plan.node}"]
    for before, after in plan.remappings.items():
        arguments += ["-r", f"{before}:={after}"]
    try:
        node = factory(
            namespace=plan.namespace,
            cli_args=arguments,
            use_global_arguments=False,
            parameter_overrides=[
                Parameter(name, value=value) for name, value in plan.parameters.items()
            ],
        )
    except Exception as error:
        raise NodeError(
            "R2B633", f"node {plan.name} cannot be created: {type(error).__name__}: {error}"
        ) from error
    if not isinstance(node, Node):
        raise NodeError(
            "R2B625", f"{plan.target} returned {type(node).__name__}, not an rclpy node"
        )
    return node


def describe_node(plan: NodePlan, node: Node) -> protocol.Ready:
    """The endpoints and parameters of a node, and its differences from the plan."""
    endpoints = [
        (plan.name, each.topic_name, _type_name(each.msg_type), direction)
        for direction, group in (("publishes", node.publishers), ("subscribes", node.subscriptions))
        for each in group
        if each.topic_name not in {"/rosout", "/parameter_events"}
    ]
    declared = set(node.list_parameters([], 0).names)
    undeclared = [(plan.name, name) for name in plan.parameters if name not in declared]
    return protocol.Ready(
        endpoints=tuple(endpoints),
        undeclared=tuple(undeclared),
        parameters={plan.name: tuple(sorted(declared))},
        unmatched=tuple(_unmatched(plan, node)),
    )


def _unmatched(plan: NodePlan, node: Node) -> Iterator[tuple[str, str, str]]:
    """The remappings whose target is not the name of any topic or service of the node.

    The names of an action or an image transport begin with the target.
    """
    name, namespace = node.get_name(), node.get_namespace()
    found = [
        each
        for ask in (
            node.get_publisher_names_and_types_by_node,
            node.get_subscriber_names_and_types_by_node,
            node.get_service_names_and_types_by_node,
            node.get_client_names_and_types_by_node,
        )
        for each, _ in ask(name, namespace)
    ]
    found += [each.topic_name for each in node.publishers]
    found += [each.topic_name for each in node.subscriptions]
    for before, after in plan.remappings.items():
        full = expand(after, name, namespace)
        if not any(each == full or each.startswith(f"{full}/") for each in found):
            yield plan.name, before, full


def _type_name(message_class: Any) -> str:
    package = message_class.__module__.partition(".")[0]
    return f"{package}/msg/{message_class.__name__}"


def _executor(settings: protocol.ConfigureHost) -> Executor:
    """The executor of the plan; 0 threads mean one per core."""
    if settings.executor == "multi_threaded":
        return MultiThreadedExecutor(num_threads=settings.threads or None)
    return SingleThreadedExecutor()


class NodeHost:
    """Creates the nodes and spins them until told to shut down."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureHost) -> None:
        self._channel = channel
        rclpy_tools.init()
        self._executor = _executor(settings)
        base_dir = Path(settings.base_dir)
        self._reports: list[protocol.Ready] = []
        self._nodes: list[Node] = []
        for plan in settings.nodes:
            node = make_node(plan, base_dir)
            rclpy_tools.destroy_on_shutdown(node)
            self._executor.add_node(node)
            self._nodes.append(node)
            self._reports.append(describe_node(plan, node))

    def serve(self) -> None:
        """Spin.

        Raises:
            NodeError: a callback raised an exception, which makes the measurements meaningless.
        """
        self._channel.send(
            protocol.Ready(
                endpoints=tuple(each for found in self._reports for each in found.endpoints),
                undeclared=tuple(each for found in self._reports for each in found.undeclared),
                unmatched=tuple(each for found in self._reports for each in found.unmatched),
                parameters={
                    name: names
                    for found in self._reports
                    for name, names in found.parameters.items()
                },
            )
        )
        threading.Thread(target=self._listen, daemon=True).start()
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return
        except Exception as error:
            names = ", ".join(node.get_fully_qualified_name() for node in self._nodes)
            raise NodeError(
                "R2B634", f"a callback of {names} raised {type(error).__name__}: {error}"
            ) from error

    def _listen(self) -> None:
        with contextlib.suppress(ChannelClosedError):
            while not isinstance(command := self._channel.receive(), protocol.Shutdown):
                if isinstance(command, protocol.CountMatches):
                    self._channel.send(
                        protocol.Matched(
                            counts=self._subscription_counts(),
                            publisher_counts=self._publisher_counts(),
                        )
                    )
        # Not the context: a running callback may still publish.
        self._executor.shutdown()

    def _subscription_counts(self) -> dict[str, int]:
        """The number of matched subscriptions of each topic: the minimum over its publishers."""
        counts: dict[str, int] = {}
        for node in self._nodes:
            for publisher in list(node.publishers):
                count = publisher.get_subscription_count()
                counts[publisher.topic_name] = min(counts.get(publisher.topic_name, count), count)
        return counts

    def _publisher_counts(self) -> dict[str, int]:
        """The number of matched publishers of each topic: the minimum over its subscriptions."""
        counts: dict[str, int] = {}
        for node in self._nodes:
            for subscription in list(node.subscriptions):
                with subscription.handle:
                    count = subscription.handle.get_publisher_count()
                topic = subscription.topic_name
                counts[topic] = min(counts.get(topic, count), count)
        return counts
