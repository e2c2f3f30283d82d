"""The ROS packages that are installed, as the index of ament has them: nothing is imported."""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path

from r2bspec.safe_io.looked_up_files import shared_lookup
from r2bspec.safe_io.safe_file import is_there, names_in, read_bytes

AMENT_INDEX = "share/ament_index/resource_index"
PACKAGE_INDEX = f"{AMENT_INDEX}/packages"
_MAX_FILE_BYTES = 1_000_000
_VERSION = re.compile(r"<version[^>]*>([^<]{1,100})</version>")


def ament_prefixes() -> list[Path]:
    """The folders in which ROS packages are installed."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH") or ""
    return [Path(prefix) for prefix in prefixes.split(":") if prefix]


@shared_lookup
def ament_packages() -> frozenset[str]:
    """The names of all installed ROS packages."""
    packages: set[str] = set()
    for prefix in ament_prefixes():
        with contextlib.suppress(OSError):
            packages.update(names_in(prefix / PACKAGE_INDEX))
    return frozenset(packages)


@shared_lookup
def package_executables(package: str) -> frozenset[str]:
    """The names of the executables of a ROS package."""
    executables: set[str] = set()
    for prefix in ament_prefixes():
        folder = prefix / "lib" / package
        with contextlib.suppress(OSError):
            executables.update(
                name for name in names_in(folder) if os.access(folder / name, os.X_OK)
            )
    return frozenset(executables)


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
    for prefix in ament_prefixes():
        try:
            packages = list((prefix / AMENT_INDEX / "rosidl_interfaces").iterdir())
        except OSError:
            continue
        for package in packages:
            entries = _text(package).splitlines()
            names = (entry.removesuffix(".msg") for entry in entries if entry.endswith(".msg"))
            types.update(f"{package.name}/{entry}" for entry in names if entry.startswith("msg/"))
    return types


def _text(file: Path) -> str:
    """The text of a file; empty without one."""
    try:
        return read_bytes(file, max_bytes=_MAX_FILE_BYTES).decode("utf-8")
    except (OSError, ValueError):
        return ""


@shared_lookup
def package_share(package: str) -> Path | None:
    """The share folder of a ROS package, or None if it is not installed."""
    for prefix in ament_prefixes():
        if is_there(prefix / PACKAGE_INDEX / package):
            return prefix / "share" / package
    return None


@shared_lookup
def package_version(package: str) -> str:
    """The version of an installed ROS package, from its package.xml; empty if unknown."""
    share = package_share(package) if package else None
    version = _VERSION.search(_text(share / "package.xml")) if share is not None else None
    return version[1].strip() if version is not None else ""
