"""Where the headers and libraries of the ROS in use are, for programs in C.

A ROS installation that is sourced has them in its prefixes (``AMENT_PREFIX_PATH``); the wheels have
them in the environment of the interpreter. Both have one folder for each package below ``include``.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from r2bspec.native.errors import BuildError

RCL_PACKAGES = (
    *("rcl", "rmw", "rcutils", "rosidl_runtime_c", "rosidl_typesupport_interface"),
    *("rosidl_dynamic_typesupport", "rcl_yaml_param_parser", "type_description_interfaces"),
    *("service_msgs", "builtin_interfaces", "rcl_interfaces", "rosidl_typesupport_c"),
)
"""The packages whose headers rcl's own include."""

_MARKER = Path("rcl/rcl/rcl.h")


@dataclass(frozen=True)
class RosFiles:
    """What a C program needs of a ROS.

    Attributes:
        prefixes: in the order of their precedence.
        wheels: whether they are the wheels of this interpreter, whose libraries have unresolved
            symbols of CPython.
    """

    prefixes: tuple[Path, ...]
    wheels: bool

    def include_folders(self, packages: Sequence[str] = RCL_PACKAGES) -> list[Path]:
        """The folders of headers of some packages, as far as they are installed."""
        return [
            folder
            for prefix in self.prefixes
            for package in packages
            if (folder := prefix / "include" / package).is_dir()
        ]

    def library_folders(self) -> list[Path]:
        """Where the linker finds the libraries."""
        return [folder for prefix in self.prefixes if (folder := prefix / "lib").is_dir()]


def find_ros(environ: Mapping[str, str] = os.environ) -> RosFiles:
    """Find the ROS that processes with this environment use; a sourced one precedes the wheels.

    Raises:
        BuildError: there are no headers of rcl (R2B668).
    """
    sourced = tuple(Path(each) for each in environ.get("AMENT_PREFIX_PATH", "").split(":") if each)
    if any((prefix / "include" / _MARKER).is_file() for prefix in sourced):
        return RosFiles(prefixes=sourced, wheels=False)
    if (Path(sys.prefix) / "include" / _MARKER).is_file():
        return RosFiles(prefixes=(*sourced, Path(sys.prefix)), wheels=True)
    where = ", ".join(str(each) for each in (*sourced, Path(sys.prefix)))
    raise BuildError(
        f"the C headers of ROS 2 are not installed: no include/{_MARKER} in {where}",
        hint="Source a ROS 2 installation with ros-<distro>-rcl, or pip install 'r2bspec[ros]'.",
    )
