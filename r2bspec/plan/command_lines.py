"""The command lines of a plan, which do not use a shell.

Player and monitor run ``$(harness)``, the program that is built from `r2bspec.native`; other
harness processes and hosts of Python nodes run ``$(python) -P -m r2bspec.harness.child`` (with -P,
files in the folder of the spec cannot shadow modules). They receive their role over the control
channel. An executable is started as by ``ros2 run``, with its node name, namespace, remappings and
parameters as ROS arguments. A `command` is started exactly as written, unless the spec gives it a
namespace, parameters, remappings, `publishes` or `subscribes`: it is then a ROS process and also
receives ROS arguments, but no node name, because it may have several nodes. Its parameter files
are passed unchanged, because they may be for all of its nodes.

A launch file is started by ``ros2 launch`` through a launch file of r2bspec, which has launch
arguments for the namespace, the remappings and the arguments (`r2bspec.harness.included_launch`).
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping

from r2bspec.language.node_kinds import NodeKindName
from r2bspec.language.spec import Container, Launch, ParameterValue
from r2bspec.plan.plan import NodePlan, ProcessPlan
from r2bspec.plan.wiring.wiring import NodeWiring

HARNESS_ARGV = ("$(python)", "-P", "-m", "r2bspec.harness.child")
"""The command line of the loader, and of a host of Python nodes."""

NATIVE_ARGV = ("$(harness)",)

INCLUDED_LAUNCH = "$(included_launch)"

EXECUTABLE = re.compile(r"\$\(executable (?P<package>\S+) (?P<name>\S+)\)")
"""The word in a plan for an executable of a ROS package, by what this machine has installed."""

CONTAINER_PACKAGE = "rclcpp_components"
"""The package of the component containers."""

THREADED_CONTAINER = "--use_multi_threaded_executor"


def container_argv(name: str, container: Container, namespace: str) -> tuple[str, ...]:
    """Return the command line of a component container.

    Only ``component_container_mt`` accepts a number of threads; ``component_container_isolated``
    gives each component its own executor, optionally with several threads.
    """
    words = [f"$(executable {CONTAINER_PACKAGE} {container.executable})"]
    isolated = container.executable == "component_container_isolated"
    if isolated and container.executor == "multi_threaded":
        words.append(THREADED_CONTAINER)
    words += container.arguments
    words += ["--ros-args", "-r", f"__node:={name}", "-r", f"__ns:={namespace}"]
    if container.threads and container.executable == "component_container_mt":
        words += ["-p", f"thread_num:={container.threads}"]
    return tuple(words)


def container_node_name(argv: Iterable[str]) -> str:
    """Return the full name of the node of a container with this command line."""
    rules = dict(word.split(":=", 1) for word in argv if word.startswith(("__node:=", "__ns:=")))
    return f"{rules['__ns'].rstrip('/')}/{rules['__node']}"


def has_planned_name(process: ProcessPlan, node: NodePlan) -> bool:
    """Return True if a running node has the name of the plan.

    A program may have nodes of any name.
    """
    return process.role != "command" or f"__node:={node.node}" in process.argv


def node_argv(wired: NodeWiring) -> tuple[str, ...]:
    """Return the command line of a node with its own process."""
    return _ARGV[wired.node.kind.name](wired)


def _python(_wired: NodeWiring) -> tuple[str, ...]:
    return HARNESS_ARGV


def _component(wired: NodeWiring) -> tuple[str, ...]:
    return container_argv(f"{wired.key}_container", Container(), wired.namespace)


def _executable(wired: NodeWiring) -> tuple[str, ...]:
    node = wired.node
    called = (f"$(executable {node.package} {node.executable})", *node.arguments)
    return (*called, *_ros_arguments(wired, wired.parameters, f"__node:={wired.key}"))


def _command(wired: NodeWiring) -> tuple[str, ...]:
    node = wired.node
    called = (*node.command, *node.arguments)
    if not wired.is_ros_process:
        return called
    files = tuple(word for file in node.parameter_files for word in ("--params-file", file))
    return (*called, *_ros_arguments(wired, node.parameters), *files)


def _launch_argv(wired: NodeWiring) -> tuple[str, ...]:
    node = wired.node
    launch = node.launch or Launch()
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
        f"arguments:={json.dumps(arguments, ensure_ascii=False)}",
    )


_ARGV: Mapping[NodeKindName, Callable[[NodeWiring], tuple[str, ...]]] = {
    "python": _python,
    "plugin": _component,
    "executable": _executable,
    "command": _command,
    "launch": _launch_argv,
}
"""How the process of each kind of node is started; what runs already has none."""


def _argument(value: object) -> str:
    """Return the text of a launch argument; booleans are in lower case, as launch files expect."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _ros_arguments(
    wired: NodeWiring, parameters: Mapping[str, ParameterValue], *rules: str
) -> Iterator[str]:
    yield "--ros-args"
    remappings = (f"{left}:={right}" for left, right in wired.node.remappings.items())
    for rule in (*rules, f"__ns:={wired.namespace}", *remappings):
        yield from ("-r", rule)
    for name, value in parameters.items():
        yield from ("-p", f"{name}:={flow_yaml(value)}")


def flow_yaml(value: ParameterValue) -> str:
    """Return a value as rcl reads it: YAML in flow style, with quoted strings.

    Without quotes, rcl would read ``"10"`` as a number.
    """
    if isinstance(value, list):
        return f"[{', '.join(flow_yaml(item) for item in value)}]"
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    return json.dumps(value, ensure_ascii=False)
