"""What is known of a node's topics and parameters without starting it.

Best first: what the spec states under ``publishes:`` and ``subscribes:``, then the static table of
the reference nodes. Nothing is guessed: a side of which nobody says anything is None.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

from r2bspec.spec.model import Node, ParameterValue

_TABLE = Path(__file__).parents[1] / "nodes" / "interfaces.yaml"
_PARAMETER = re.compile(r"\$\(parameter ([^)]*)\)")

ParameterType = Literal[
    "bool",
    "integer",
    "double",
    "string",
    "byte_array",
    "bool_array",
    "integer_array",
    "double_array",
    "string_array",
]


@dataclass(frozen=True, slots=True)
class ParameterInfo:
    """A declared parameter: its ROS type, and its default if it has one."""

    type: ParameterType
    default: ParameterValue | None = None


@dataclass(frozen=True, slots=True)
class Interface:
    """A node's own topics, by the names that it uses before remapping, with their types.

    Attributes:
        subscribes: topic to type; None if unknown. A type is empty where only that is unknown.
        publishes: likewise.
        parameters: by name; None if unknown.
        subscribes_from: who says so.
        publishes_from: who says so.
        type_parameters: which parameter decides the type of a topic, where one does.
    """

    subscribes: Mapping[str, str] | None = None
    publishes: Mapping[str, str] | None = None
    parameters: Mapping[str, ParameterInfo] | None = None
    subscribes_from: Literal["spec", "table", ""] = ""
    publishes_from: Literal["spec", "table", ""] = ""
    type_parameters: Mapping[str, str] = field(default_factory=dict)

    @property
    def topics(self) -> tuple[str, ...] | None:
        """Every topic of the node, or None if one side is unknown."""
        if self.subscribes is None or self.publishes is None:
            return None
        return (*self.subscribes, *(name for name in self.publishes if name not in self.subscribes))


@dataclass(frozen=True, slots=True)
class TableEntry:
    """A row of the static table; types and names may hold ``$(parameter x)``."""

    subscribes: Mapping[str, str] = field(default_factory=dict)
    publishes: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, ParameterInfo] = field(default_factory=dict)


Table = Mapping[str, TableEntry]


@cache
def reference_table() -> Table:
    """The table of the reference nodes, by Python path, read as data."""
    import yaml

    rows: dict[str, dict[str, Any]] = yaml.load(
        _TABLE.read_text(encoding="utf-8"),
        Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader),  # noqa: S506 -- both are safe
    )
    return {name: _entry(row) for name, row in rows.items()}


def _entry(row: Mapping[str, Any]) -> TableEntry:
    return TableEntry(
        subscribes=row.get("subscribes") or {},
        publishes=row.get("publishes") or {},
        parameters={
            name: ParameterInfo(each["type"], each.get("default"))
            for name, each in (row.get("parameters") or {}).items()
        },
    )


def interface_of(node: Node, table: Table) -> Interface:
    """What is known of a node; each side comes from the best source that speaks of it."""
    entry = table.get(node.python) if node.python else None
    subscribes = publishes = None
    if entry is not None:
        subscribes = _substituted(entry.subscribes, node, entry)
        publishes = _substituted(entry.publishes, node, entry)
    return Interface(
        subscribes=node.subscribes or subscribes,
        publishes=node.publishes or publishes,
        parameters=None if entry is None else entry.parameters,
        subscribes_from="spec" if node.subscribes else "table" if entry else "",
        publishes_from="spec" if node.publishes else "table" if entry else "",
        type_parameters={} if entry is None else _type_parameters(node, entry),
    )


def _substituted(topics: Mapping[str, str], node: Node, entry: TableEntry) -> dict[str, str]:
    return {
        _with_parameters(name, node, entry): _with_parameters(kind, node, entry)
        for name, kind in topics.items()
    }


def _type_parameters(node: Node, entry: TableEntry) -> dict[str, str]:
    found = {}
    for name, kind in (*entry.subscribes.items(), *entry.publishes.items()):
        decides = _PARAMETER.fullmatch(kind)
        if decides is not None:
            found[_with_parameters(name, node, entry)] = decides[1]
    return found


def _with_parameters(text: str, node: Node, entry: TableEntry) -> str:
    """Put in the values that the node's parameters have; an unset one leaves nothing."""

    def value(found: re.Match[str]) -> str:
        name = found[1]
        if name in node.parameters:
            return str(node.parameters[name])
        declared = entry.parameters.get(name)
        return "" if declared is None or declared.default is None else str(declared.default)

    return _PARAMETER.sub(value, text)
