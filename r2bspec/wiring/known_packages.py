"""The catalogue of known packages: topics and parameters of their nodes, as data."""

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
    """The packages in the catalogue."""
    return frozenset(file.stem for file in _FOLDER.glob("*.yaml"))


@cache
def catalogue_nodes(package: str) -> InterfaceTable:
    """The nodes of a package by plugin; empty if the catalogue does not have the package."""
    if package not in catalogue_packages():
        return {}
    described_package = f"{package} of {ROS_DISTRIBUTION}"
    return read_interface_table(
        _FOLDER / f"{package}.yaml", origin="catalogue", described_package=described_package
    )


def catalogue_entry(node: Node) -> InterfaceEntry | None:
    """The catalogue entry of a node, if there is one."""
    if not node.package:
        return None
    known = catalogue_nodes(node.package)
    if node.plugin:
        return known.get(node.plugin)
    return next((each for each in known.values() if each.executable == node.executable), None)
