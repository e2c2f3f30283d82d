"""The command lines of a plan. None of them goes through a shell.

Harness processes and hosts of Python nodes all run ``$(python) -P -m r2bspec.harness.child`` (-P:
what lies in the spec's folder shadows no module); what they do is told to them over the control
channel. An executable is started as ``ros2 run`` would, with its node name, namespace, remappings
and parameters as ROS arguments. A `command` is started exactly as written, unless the spec gives it
a namespace, parameters, remappings, `publishes` or `subscribes`: then it is taken to be a ROS
process and gets ROS arguments, too, but no node name, because it may hold several nodes; its
parameter files are handed on as they are, because they may be meant for all of these.

A launch file is started by ``ros2 launch`` through a launch file of r2bspec's own, which takes the
namespace, the remappings and the arguments as launch arguments (`r2bspec.harness.included_launch`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping

from r2bspec.language.secret_variables import quoted_secret_references
from r2bspec.language.spec import Container, Launch, Node, ParameterValue
from r2bspec.wiring.wiring import NodeWiring

HARNESS_ARGV = ("$(python)", "-P", "-m", "r2bspec.harness.child")

INCLUDED_LAUNCH = "$(included_launch)"

CONTAINER_PACKAGE = "rclcpp_components"
"""The package of the component containers."""


def host_argv() -> tuple[str, ...]:
    """How a process of Python nodes is started."""
    return HARNESS_ARGV


def container_argv(name: str, container: Container, namespace: str) -> tuple[str, ...]:
    """How a component container is started.

    Only ``component_container_mt`` takes a number of threads; ``component_container_isolated``
    gives each component an executor of its own, of several threads if asked to.
    """
    words = [f"$(executable {CONTAINER_PACKAGE} {container.executable})"]
    isolated = container.executable == "component_container_isolated"
    if isolated and container.executor == "multi_threaded":
        words.append("--use_multi_threaded_executor")
    words += ["--ros-args", "-r", f"__node:={name}", "-r", f"__ns:={namespace}"]
    if container.threads and container.executable == "component_container_mt":
        words += ["-p", f"thread_num:={container.threads}"]
    return tuple(words)


def container_node_name(argv: Iterable[str]) -> str:
    """The full name of the node of a container that is started so."""
    rules = dict(word.split(":=", 1) for word in argv if word.startswith(("__node:=", "__ns:=")))
    return f"{rules['__ns'].rstrip('/')}/{rules['__node']}"


def node_argv(wired: NodeWiring) -> tuple[str, ...]:
    """How the process of a node that has one of its own is started."""
    node = wired.node
    if node.kind == "python":
        return HARNESS_ARGV
    if node.kind == "plugin":
        return container_argv(f"{wired.key}_container", Container(), wired.namespace)
    if node.kind == "launch" and node.launch is not None:
        return _launch_argv(node.launch, wired)
    if node.kind == "executable":
        called = (f"$(executable {node.package} {node.executable})", *node.arguments)
        return (*called, *_ros_arguments(wired, wired.parameters, f"__node:={wired.key}"))
    called = (*node.command, *node.arguments)
    if not wired.is_ros_process:
        return called
    files = tuple(word for file in node.parameter_files for word in ("--params-file", file))
    return (*called, *_ros_arguments(wired, node.parameters), *files)


def _launch_argv(launch: Launch, wired: NodeWiring) -> tuple[str, ...]:
    node: Node = wired.node
    place = (
        (f"package:={launch.package}", f"file:={launch.file}")
        if launch.package
        else (f"file:={launch.path}",)
    )
    arguments = {name: _argument(value) for name, value in launch.arguments.items()}
    return (
        *("ros2", "launch", INCLUDED_LAUNCH),
        *place,
        f"namespace:={wired.namespace}",
        f"remappings:={json.dumps(node.remappings, ensure_ascii=False)}",
        f"arguments:={quoted_secret_references(json.dumps(arguments, ensure_ascii=False))}",
    )


def _argument(value: object) -> str:
    """A launch argument is a text; truth values are written as launch files compare them."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _ros_arguments(
    wired: NodeWiring, parameters: Mapping[str, ParameterValue], *rules: str
) -> Iterator[str]:
    yield "--ros-args"
    remappings = (f"{left}:={right}" for left, right in wired.node.remappings.items())
    for rule in (*rules, f"__ns:={wired.namespace}", *remappings):
        yield from ("-r", rule)
    for name, value in parameters.items():
        yield from ("-p", f"{name}:={parameter_text(value)}")


def parameter_text(value: ParameterValue) -> str:
    """A parameter as rcl's command line reads it: YAML in flow style, with strings quoted.

    Quoting keeps ``"10"`` a string, which rcl would otherwise read as a number.
    """
    if isinstance(value, list):
        return f"[{', '.join(parameter_text(each) for each in value)}]"
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    return quoted_secret_references(json.dumps(value, ensure_ascii=False))
