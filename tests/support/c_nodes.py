"""The nodes of tests/ros/nodes_c, built for the ROS that is installed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[1] / "ros/nodes_c"
NAMES = ("relay", "crash", "late", "two_threads")
LIBRARIES = (
    *("rcl", "rcutils", "rcl_yaml_param_parser"),
    *("sensor_msgs__rosidl_typesupport_c", "sensor_msgs__rosidl_generator_c"),
)


def build_c_nodes(folder: Path) -> dict[str, Path]:
    """Compile all nodes into `folder`; skips the test where that is not possible.

    Returns:
        The programs by their names.
    """
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    folder.mkdir(parents=True, exist_ok=True)
    prefix = Path(sys.prefix)
    includes = [f"-isystem{each}" for each in sorted((prefix / "include").iterdir())]
    for name in NAMES:
        subprocess.run(
            [
                *(compiler, "-std=c11", "-D_POSIX_C_SOURCE=200809L", "-O2", "-g"),
                *("-Wall", "-Wextra", "-Werror", "-pthread", *includes),
                *(str(SOURCES / f"{each}.c") for each in (name, "image_node", "cpython_symbols")),
                *("-o", str(folder / name), f"-L{prefix / 'lib'}"),
                *(f"-l{each}" for each in LIBRARIES),
                *("-Wl,--unresolved-symbols=ignore-in-shared-libs", "-rdynamic"),
            ],
            check=True,
        )
    return {name: folder / name for name in NAMES}
