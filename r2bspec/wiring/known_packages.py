"""The catalogue of well-known packages: what their nodes read, write and take, as data."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from r2bspec.language.spec import Node
from r2bspec.wiring.node_interface import InterfaceEntry, InterfaceTable, read_interface_table

_FOLDER = Path(__file__).parent / "catalogue"
ROS_DISTRIBUTION = "ROS 2 Jazzy"
"""The distribution whose packages the catalogue describes."""


@cache
def catalogue_packages() -> frozenset[str]:
    """The packages of which the catalogue knows nodes."""
    return frozenset(file.stem for file in _FOLDER.glob("*.yaml"))


@cache
def catalogue_nodes(package: str) -> InterfaceTable:
    """The nodes of a package by plugin; empty for one that the catalogue does not have."""
    if package not in catalogue_packages():
        return {}
    described_package = f"{package} of {ROS_DISTRIBUTION}"
    return read_interface_table(
        _FOLDER / f"{package}.yaml", origin="catalogue", described_package=described_package
    )


def catalogue_entry(node: Node) -> InterfaceEntry | None:
    """What the catalogue says of a node, if it has it."""
    if not node.package:
        return None
    known = catalogue_nodes(node.package)
    if node.plugin:
        return known.get(node.plugin)
    return next((each for each in known.values() if each.executable == node.executable), None)
