"""What is known of a node's topics and parameters without starting it.

Best first: what the spec states under ``publishes:`` and ``subscribes:``, the node's file in the
folder `interfaces` beside the spec, the catalogue of well-known packages, the static table of the
reference nodes, and what a Python file beside the spec says literally. Nothing is guessed: a side
of which nobody says anything is None.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

import msgspec

from r2bspec.language import value_codec
from r2bspec.language.spec import Node, ParameterValue, QoS
from r2bspec.wiring.name_resolution import expand, remap

_TABLE = Path(__file__).parents[1] / "nodes" / "interfaces.yaml"
_DEEPEST = 100
_PARAMETER = re.compile(r"\$\(parameter ([^)]*)\)")
_BESIDE = re.compile(r"\$\(beside ([^)]*)\)")

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

InterfaceSource = Literal["spec", "file", "catalogue", "table", "source", ""]
"""Who says what a node's topics are; empty where nobody does."""


@dataclass(frozen=True, slots=True)
class ParameterInfo:
    """A declared parameter: its ROS type, empty if unknown, and its default if it has one."""

    type: ParameterType | Literal[""]
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
        parameters_from: who says so.
        type_parameters: which parameter decides the type of a topic, where one does.
        qos: what the node offers or asks for on its topics, where that is known.
        also_remapped: names that can be remapped although no topic is called so: services, and
            topics from which only the names of others are derived.
        made_for: what the source describes, such as ``image_proc of ROS 2 Jazzy``.
    """

    subscribes: Mapping[str, str] | None = None
    publishes: Mapping[str, str] | None = None
    parameters: Mapping[str, ParameterInfo] | None = None
    subscribes_from: InterfaceSource = ""
    publishes_from: InterfaceSource = ""
    parameters_from: InterfaceSource = ""
    type_parameters: Mapping[str, str] = field(default_factory=dict)
    qos: Mapping[str, QoS] = field(default_factory=dict)
    also_remapped: tuple[str, ...] = ()
    made_for: str = ""

    @property
    def topics(self) -> tuple[str, ...] | None:
        """Every topic of the node, or None if one side is unknown."""
        if self.subscribes is None or self.publishes is None:
            return None
        return (*self.subscribes, *(name for name in self.publishes if name not in self.subscribes))


@dataclass(frozen=True, slots=True)
class TableEntry:
    """What a source says of a kind of node; a side that it does not know is None.

    Types and names may hold ``$(parameter x)``, the value of a parameter, and names may be
    ``$(beside TOPIC)``, the topic `camera_info` in the folder of what TOPIC is remapped to.
    """

    subscribes: Mapping[str, str] | None = field(default_factory=dict)
    publishes: Mapping[str, str] | None = field(default_factory=dict)
    parameters: Mapping[str, ParameterInfo] | None = field(default_factory=dict)
    services: Mapping[str, str] = field(default_factory=dict)
    qos: Mapping[str, QoS] = field(default_factory=dict)
    executable: str = ""
    origin: InterfaceSource = "table"
    made_for: str = ""


Table = Mapping[str, TableEntry]


@dataclass(frozen=True, slots=True)
class Named:
    """A node as names are resolved for it: its name, absolute namespace, rules and parameters."""

    name: str = ""
    namespace: str = "/"
    remappings: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)


@cache
def reference_table() -> Table:
    """The table of the reference nodes, by Python path, read as data."""
    return read_table(_TABLE)


def read_table(file: Path, *, origin: InterfaceSource = "table", made_for: str = "") -> Table:
    """Read a file of interfaces that goes with r2bspec, and is therefore right."""
    rows: dict[str, Any] = read_yaml(file.read_text(encoding="utf-8"))
    return {name: table_entry(row, origin, made_for) for name, row in rows.items()}


def read_yaml(text: str) -> Any:
    """The values of a YAML document, read as plain data.

    Raises:
        yaml.YAMLError: it is none, or is nested deeper than anybody writes by hand.
    """
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    depth = 0
    # Loading recurses, in C, once for every level.
    for event in yaml.parse(text, Loader=loader):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise yaml.YAMLError(f"it is nested more than {_DEEPEST} deep")
    return yaml.load(text, Loader=loader)  # noqa: S506 -- both are safe


class _Row(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A node in an interface file."""

    subscribes: dict[str, str] | None = None
    publishes: dict[str, str] | None = None
    parameters: dict[str, _Parameter] | None = None
    services: dict[str, str] | None = None
    qos: dict[str, QoS] | None = None
    executable: str = ""


class _Parameter(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A declared parameter in an interface file."""

    type: ParameterType | Literal[""]
    default: ParameterValue | None = None


def table_entry(row: Any, origin: InterfaceSource = "table", made_for: str = "") -> TableEntry:
    """A row of an interface file.

    Raises:
        msgspec.ValidationError: it has another form.
    """
    read = msgspec.convert(row, _Row, dec_hook=value_codec.decode)
    parameters = (read.parameters or {}).items()
    return TableEntry(
        subscribes=read.subscribes or {},
        publishes=read.publishes or {},
        parameters={name: ParameterInfo(each.type, each.default) for name, each in parameters},
        services=read.services or {},
        qos=read.qos or {},
        executable=read.executable,
        origin=origin,
        made_for=made_for,
    )


def interface_of(
    node: Node, table: Table, *, named: Named | None = None, sources: tuple[TableEntry, ...] = ()
) -> Interface:
    """What is known of a node; each side comes from the best source that speaks of it.

    Args:
        node: the node as the spec has it.
        table: interfaces of Python nodes, by target.
        named: how its names are resolved; by default as in a namespace of its own.
        sources: what else is known of this node, best first, all of it better than the table.
    """
    if named is None:
        named = Named(remappings=node.remappings, parameters=node.parameters)
    entry = table.get(node.python) if node.python else None
    entries = (*sources, *((entry,) if entry is not None else ()))
    reads = next((each for each in entries if each.subscribes is not None), None)
    writes = next((each for each in entries if each.publishes is not None), None)
    takes = next((each for each in entries if each.parameters is not None), None)
    return Interface(
        subscribes=node.subscribes or _topics(reads, reads and reads.subscribes, named),
        publishes=node.publishes or _topics(writes, writes and writes.publishes, named),
        parameters=None if takes is None else takes.parameters,
        subscribes_from="spec" if node.subscribes else reads.origin if reads else "",
        publishes_from="spec" if node.publishes else writes.origin if writes else "",
        parameters_from=takes.origin if takes else "",
        type_parameters=_type_parameters(entries, named),
        qos={name: qos for each in reversed(entries) for name, qos in each.qos.items()},
        also_remapped=tuple(name for each in entries for name in _also_remapped(each)),
        made_for=next((each.made_for for each in entries if each.made_for), ""),
    )


def _topics(
    entry: TableEntry | None, topics: Mapping[str, str] | None, named: Named
) -> dict[str, str] | None:
    if entry is None or topics is None:
        return None
    return {
        _with_parameters(_beside(name, named), named, entry): _with_parameters(kind, named, entry)
        for name, kind in topics.items()
    }


def _beside(name: str, named: Named) -> str:
    """The name of a derived topic: beside what its base is remapped to."""
    derived = _BESIDE.fullmatch(name)
    if derived is None:
        return name
    base = expand(derived[1], named.name, named.namespace)
    full = remap(derived[1], named.remappings, named.name, named.namespace).name
    if full != base:
        return f"{full.rpartition('/')[0]}/camera_info"
    folder, slash, _ = derived[1].rpartition("/")
    return f"{folder}{slash}camera_info"


def _also_remapped(entry: TableEntry) -> tuple[str, ...]:
    topics = (*(entry.subscribes or ()), *(entry.publishes or ()))
    bases = (found[1] for each in topics if (found := _BESIDE.fullmatch(each)))
    return (*entry.services, *bases)


def _type_parameters(entries: tuple[TableEntry, ...], named: Named) -> dict[str, str]:
    found = {}
    for entry in entries:
        for topics in (entry.subscribes or {}, entry.publishes or {}):
            for name, kind in topics.items():
                decides = _PARAMETER.fullmatch(kind)
                if decides is not None:
                    found[_with_parameters(name, named, entry)] = decides[1]
    return found


def _with_parameters(text: str, named: Named, entry: TableEntry) -> str:
    """Put in the values that the node's parameters have; an unset one leaves nothing."""

    def value(found: re.Match[str]) -> str:
        name = found[1]
        if name in named.parameters:
            return str(named.parameters[name])
        declared = (entry.parameters or {}).get(name)
        return "" if declared is None or declared.default is None else str(declared.default)

    return _PARAMETER.sub(value, text)
