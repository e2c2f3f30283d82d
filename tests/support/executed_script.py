"""Executes a script of ros2_benchmark, and prints the nodes that it makes as JSON.

Python itself executes the script, with packages that only record what is called. It is how an
import, which executes nothing, is compared with what the script does. Only for scripts of this
repository: `python executed_script.py SCRIPT`.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import json
import runpy
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

RECORDED = ("launch", "ros2_benchmark", "isaac_ros_", "cell_", "std_srvs")


class Call:
    """A call of something in a recorded package."""

    def __init__(self, name: str, arguments: tuple[Any, ...], keywords: dict[str, Any]) -> None:
        self.name, self.arguments, self.keywords = name, arguments, keywords

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments, **keywords: Call(name, arguments, keywords)


class Test:
    """The base class of the tool, as far as a launch description needs it."""

    @classmethod
    def generate_namespace(cls, *names: str, absolute: bool = True) -> str:
        namespace = getattr(cls, "config", None)
        first = namespace.keywords.get("benchmark_namespace", "r2b") if namespace else "r2b"
        return ("/" if absolute else "") + "/".join([first, *filter(None, names)])

    @classmethod
    def get_assets_root_path(cls) -> str:
        return "./assets"

    @classmethod
    def generate_test_description_with_nsys(cls, launch_setup: Any) -> Any:
        return launch_setup("", "5")

    @classmethod
    def generate_test_description(cls, actions: Any) -> Any:
        return actions


class Size:
    """A resolution."""

    def __init__(self, width: int, height: int, name: str = "") -> None:
        self.values = {"width": width, "height": height, "name": name}

    def __getitem__(self, key: str) -> Any:
        return self.values[key]


class Resolutions:
    HD = Size(1280, 720)
    FULL_HD = Size(1920, 1080)
    QUARTER_HD = Size(960, 540)
    VGA = Size(640, 480)


class Recorder(ModuleType):
    """A module that has every name."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        known = {"ROS2BenchmarkTest": Test, "ImageResolution": Resolutions, "Resolution": Size}
        if name in known:
            return known[name]
        if name == "BenchmarkMode":
            return Recorder(name)

        def record(*arguments: Any, **keywords: Any) -> Call:
            return Call(name, arguments, keywords)

        return record


class Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds the packages that are recorded."""

    def find_spec(self, name: str, path: object, target: object = None) -> Any:
        del path, target
        if name.startswith(RECORDED):
            return importlib.machinery.ModuleSpec(name, self, is_package=True)
        return None

    def create_module(self, spec: Any) -> ModuleType:
        return Recorder(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """It has nothing to execute."""


def nodes(actions: Any, container: str = "") -> Iterator[dict[str, Any]]:
    """The nodes among launch actions, with the container that they are in."""
    for action in actions if isinstance(actions, list | tuple) else [actions]:
        if not isinstance(action, Call):
            continue
        given = action.keywords
        inner = given.get("composable_node_descriptions", [])
        if action.name in {"ComposableNodeContainer", "LoadComposableNodes"}:
            yield from nodes(inner, str(given.get("name") or given.get("target_container")))
        elif action.name == "ExecuteProcess":
            yield {"kind": "", "command": [str(each) for each in given["cmd"]]}
        elif action.name in {"ComposableNode", "Node"}:
            yield {
                "name": f"{given.get('namespace', '').rstrip('/')}/{given['name']}",
                "package": given["package"],
                "kind": given.get("plugin") or given.get("executable"),
                "container": container,
                "parameters": merged(given.get("parameters", [])),
                "remappings": dict(given.get("remappings", [])),
            }


def merged(parts: list[Any]) -> dict[str, Any]:
    """The parameters by name; those of a file are left out."""
    found: dict[str, Any] = {}
    for part in parts:
        found |= flat(part, "") if isinstance(part, dict) else {}
    return found


def flat(values: dict[str, Any], before: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in values.items():
        found |= (
            flat(value, f"{before}{key}.") if isinstance(value, dict) else {before + key: value}
        )
    return found


if __name__ == "__main__":
    sys.meta_path.insert(0, Finder())
    names = runpy.run_path(sys.argv[1])
    json.dump(list(nodes(names["generate_test_description"]())), sys.stdout)
