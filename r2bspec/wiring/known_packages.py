"""The catalogue of well-known packages: what their nodes read, write and take, as data."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from r2bspec.language.spec import Node
from r2bspec.wiring.node_interface import Table, TableEntry, read_table

_FOLDER = Path(__file__).parent / "catalogue"
DISTRIBUTION = "ROS 2 Jazzy"
"""The distribution whose packages the catalogue describes."""


@cache
def packages() -> frozenset[str]:
    """The packages of which the catalogue knows nodes."""
    return frozenset(file.stem for file in _FOLDER.glob("*.yaml"))


@cache
def nodes_of(package: str) -> Table:
    """The nodes of a package by plugin; empty for one that the catalogue does not have."""
    if package not in packages():
        return {}
    made_for = f"{package} of {DISTRIBUTION}"
    return read_table(_FOLDER / f"{package}.yaml", origin="catalogue", made_for=made_for)


def well_known(node: Node) -> TableEntry | None:
    """What the catalogue says of a node, if it has it."""
    if not node.package:
        return None
    known = nodes_of(node.package)
    if node.plugin:
        return known.get(node.plugin)
    return next((each for each in known.values() if each.executable == node.executable), None)
