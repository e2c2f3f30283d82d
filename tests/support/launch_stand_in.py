"""The classes of `launch` and `launch_ros` that launch files use, where these are not installed.

They take the arguments that the real ones take (ROS 2 Jazzy), and keep what they were given.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

_PROCESS = {"name", "prefix", "cwd", "env", "additional_env", "output", "condition", "on_exit"}
_NODE = {
    *("package", "executable", "name", "namespace", "exec_name", "parameters", "remappings"),
    *("arguments", "ros_arguments", "prefix", "cwd", "additional_env", "output"),
}
_COMPONENT = {
    *("package", "plugin", "name", "namespace", "parameters", "remappings", "extra_arguments"),
}
_CLASSES: dict[str, dict[str, tuple[int, set[str]]]] = {
    "launch": {"LaunchDescription": (1, set())},
    "launch.actions": {
        "ExecuteProcess": (0, {"cmd", *_PROCESS}),
        "GroupAction": (1, {"scoped", "forwarding"}),
        "IncludeLaunchDescription": (1, {"launch_arguments"}),
        "SetEnvironmentVariable": (2, set()),
    },
    "launch.launch_description_sources": {"AnyLaunchDescriptionSource": (1, set())},
    "launch.substitutions": {
        "EnvironmentVariable": (1, {"default_value"}),
        "PathJoinSubstitution": (1, set()),
    },
    "launch_ros.actions": {
        "ComposableNodeContainer": (0, {"composable_node_descriptions", *_NODE}),
        "Node": (0, _NODE),
        "PushRosNamespace": (1, set()),
        "SetRemap": (2, set()),
    },
    "launch_ros.descriptions": {"ComposableNode": (0, _COMPONENT)},
    "launch_ros.parameter_descriptions": {"ParameterValue": (1, {"value_type"})},
    "launch_ros.substitutions": {
        "ExecutableInPackage": (0, {"package", "executable"}),
        "FindPackageShare": (1, set()),
    },
}
"""By module and name: how many arguments have no name, and the names of the others."""


class Given:
    """What a class was called with."""

    def __init__(self, kind: str, words: tuple[Any, ...], named: dict[str, Any]) -> None:
        self.kind, self.words, self.named = kind, words, named

    def __getattr__(self, name: str) -> Any:
        return self.named[name]


def _class(name: str, unnamed: int, known: set[str]) -> Any:
    def make(*words: Any, **named: Any) -> Given:
        assert len(words) == unnamed, name
        assert named.keys() <= known, (name, named.keys() - known)
        return Given(name, words, named)

    return make


@contextmanager
def launch_modules() -> Iterator[None]:
    """Stand-ins for the packages, while the context lasts."""
    before = {name: sys.modules.get(name) for name in ("launch_ros", *_CLASSES)}
    sys.modules["launch_ros"] = ModuleType("launch_ros")
    for module_name, classes in _CLASSES.items():
        module = sys.modules[module_name] = ModuleType(module_name)
        for name, (unnamed, known) in classes.items():
            setattr(module, name, _class(name, unnamed, known))
    try:
        yield
    finally:
        for name, earlier in before.items():
            if earlier is None:
                del sys.modules[name]
            else:
                sys.modules[name] = earlier


def described(text: str) -> list[Given]:
    """The actions of a launch file in Python."""
    file = "deployment.launch.py"
    scope: dict[str, Any] = {"__file__": file, "__name__": "launch_file"}
    with launch_modules():
        exec(compile(text, file, "exec"), scope)  # noqa: S102 - what ros2 launch does
        description = scope["generate_launch_description"]()
    actions: list[Given] = description.words[0]
    return actions
