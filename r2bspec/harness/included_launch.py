"""A launch file that includes another launch file in a namespace and with remappings.

``ros2 launch`` has no options for these; this file has launch arguments for them:

    file        path of the launch file, or its name where `package` is given
    package     the package in whose share folder the file lies
    namespace   namespace of all nodes that it starts
    remappings  remapping rules for all of them, as a JSON object
    arguments   launch arguments for the file, as a JSON object
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from typing import Any


def generate_launch_description() -> Any:
    """Return the launch description; ``ros2 launch`` calls this function."""
    # The launch packages are part of a full ROS installation, but not of its wheels.
    launch = importlib.import_module("launch")
    actions = importlib.import_module("launch.actions")
    sources = importlib.import_module("launch.launch_description_sources")
    ros = importlib.import_module("launch_ros.actions")
    launch_arguments_given = _launch_arguments(sys.argv)
    rules = json.loads(launch_arguments_given.get("remappings", "{}"))
    included = actions.IncludeLaunchDescription(
        sources.AnyLaunchDescriptionSource(_path(launch_arguments_given)),
        launch_arguments=json.loads(launch_arguments_given.get("arguments", "{}")).items(),
    )
    group = [ros.PushRosNamespace(launch_arguments_given.get("namespace", "/"))]
    group += [ros.SetRemap(before, after) for before, after in rules.items()]
    return launch.LaunchDescription([actions.GroupAction([*group, included])])


def _launch_arguments(argv: list[str]) -> dict[str, str]:
    """Return the launch arguments on the command line, ``name:=value`` each."""
    pairs = (word.partition(":=") for word in argv if ":=" in word)
    return {name: value for name, _, value in pairs}


def _path(launch_arguments_given: dict[str, str]) -> str:
    file = launch_arguments_given["file"]
    if not launch_arguments_given.get("package"):
        return file
    index = importlib.import_module("ament_index_python.packages")
    share = Path(index.get_package_share_directory(launch_arguments_given["package"]))
    direct = [share / file, share / "launch" / file]
    candidates = [path for path in direct if path.is_file()] or sorted(share.rglob(file))
    return str(candidates[0]) if candidates else str(direct[0])
