"""The topics and parameters of a node, as far as they are known without starting it.

The sources, in order of precedence: ``publishes:`` and ``subscribes:`` in the spec, the node's file
in the folder `interfaces` next to the spec if it was recorded from this node, the catalogue of
known packages, the table of the reference nodes, and the source of a Python node next to the spec.
Nothing is guessed: what no source describes is None. A recorded interface is used only for the node
that it was recorded from: a node of another spec may have the same key, and a node may change after
it was recorded.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal

import msgspec

from r2bspec.language.declaration import decode_text
from r2bspec.language.spec import Node, ParameterValue, QoS
from r2bspec.plan.wiring.name_resolution import Remapper
from r2bspec.safe_io import safe_file
from r2bspec.safe_io.limits import MAX_KNOWN_INTERFACES_BYTES
from r2bspec.safe_io.safe_yaml import load_values


class RecordOrigin(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What an interface was recorded from.

    Attributes:
        target: the node as the spec names it: its class, its package and plugin, or its command.
        sha256: of its files in the folder of the spec; empty if there are none.
        version: the version of its ROS package; empty if unknown.
    """

    target: str = ""
    sha256: str = ""
    version: str = ""


def node_target(node: Node) -> str:
    """Return a node as the spec names it."""
    if node.package:
        return f"{node.package} {node.plugin or node.executable}"
    import shlex

    return node.python or shlex.join(node.command)


def files_digest(node: Node, base_dir: Path) -> str:
    """Return the SHA-256 of the files of a node in the folder of its spec; empty without files."""
    import hashlib

    digests = []
    for name in _files(node):
        try:
            data = safe_file.read_bytes(
                base_dir / name, max_bytes=MAX_KNOWN_INTERFACES_BYTES, folders=(base_dir,)
            )
        except (OSError, ValueError):
            continue
        digests.append(hashlib.sha256(data).digest())
    return hashlib.sha256(b"".join(digests)).hexdigest() if digests else ""


def _files(node: Node) -> Iterator[str]:
    place, colon, _ = node.python.rpartition(":")
    if colon:
        yield place
    yield from (word for word in node.command if "/" in word or word.endswith(".py"))


def origin_difference(origin: RecordOrigin, node: Node, base_dir: Path) -> str:
    """Return why a recorded interface is not that of a node; empty if it may be.

    The version of a package is not compared here: it differs between machines.
    """
    target = node_target(node)
    if origin.target != target:
        return f"it was recorded from {origin.target!r}, and the node is {target!r}"
    if origin.sha256 and origin.sha256 != files_digest(node, base_dir):
        return f"{target!r} has changed since it was recorded"
    return ""


_TABLE = Path(__file__).parents[2] / "nodes" / "interfaces.yaml"
_PARAMETER = re.compile(r"\$\(parameter ([^)]*)\)")
_DERIVED_TOPIC = re.compile(r"\$\(camera_info of ([^)]*)\)")

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
"""The source of a part of an interface; empty if it is unknown."""


class ParameterInfo(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A declared parameter: its ROS type, empty if unknown, and its default, if any."""

    type: ParameterType | Literal[""]
    default: ParameterValue | None = None


class Interface(msgspec.Struct, frozen=True):
    """The topics of a node, by their names before remapping, with their types.

    Attributes:
        subscribes: the types of subscribed topics; None if the topics are unknown. A type is empty
            if only the type is unknown.
        publishes: the types of published topics, likewise.
        parameters: by name; None if unknown.
        subscribes_from: the source of `subscribes`.
        publishes_from: the source of `publishes`.
        parameters_from: the source of `parameters`.
        type_parameters: the parameter that decides the type of a topic, if there is one.
        qos: the known QoS profiles of topics.
        services: the types of its services and actions, by their names before remapping; empty if
            the type is unknown, or the node only calls it.
        other_remappable_names: names that can be remapped although they are not topics: services,
            and names from which the names of topics are derived.
        described_package: what the source describes, such as ``image_proc of ROS 2 Jazzy``.
        may_publish_more: why it may publish other topics, too; empty if nothing says so.
        may_subscribe_more: likewise.
        is_lifecycle: whether it is known to be a lifecycle node.
        publishing: the subscribed topics whose callbacks are known to publish.
        unread_qos: the lines that give subscribed topics a profile of which the text says nothing.
    """

    subscribes: Mapping[str, str] | None = None
    publishes: Mapping[str, str] | None = None
    parameters: Mapping[str, ParameterInfo] | None = None
    subscribes_from: InterfaceSource = ""
    publishes_from: InterfaceSource = ""
    parameters_from: InterfaceSource = ""
    type_parameters: Mapping[str, str] = msgspec.field(default_factory=dict)
    qos: Mapping[str, QoS] = msgspec.field(default_factory=dict)
    services: Mapping[str, str] = msgspec.field(default_factory=dict)
    other_remappable_names: tuple[str, ...] = ()
    described_package: str = ""
    may_publish_more: str = ""
    may_subscribe_more: str = ""
    is_lifecycle: bool = False
    publishing: tuple[str, ...] = ()
    unread_qos: Mapping[str, int] = msgspec.field(default_factory=dict)

    @property
    def publishes_all(self) -> bool:
        """Whether all topics that it publishes are known."""
        return self.publishes is not None and not self.may_publish_more

    @property
    def subscribes_all(self) -> bool:
        """Whether all topics to which it subscribes are known."""
        return self.subscribes is not None and not self.may_subscribe_more

    @property
    def topics(self) -> tuple[str, ...] | None:
        """Every topic of the node, or None if its publishers or subscriptions are not all known."""
        if self.subscribes is None or self.publishes is None:
            return None
        if not (self.publishes_all and self.subscribes_all):
            return None
        return (*self.subscribes, *(name for name in self.publishes if name not in self.subscribes))


class _InterfaceRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A node in an interface file."""

    subscribes: Mapping[str, str] | None = msgspec.field(default_factory=dict)
    publishes: Mapping[str, str] | None = msgspec.field(default_factory=dict)
    parameters: Mapping[str, ParameterInfo] | None = msgspec.field(default_factory=dict)
    services: Mapping[str, str] = msgspec.field(default_factory=dict)
    qos: Mapping[str, QoS] = msgspec.field(default_factory=dict)
    executable: str = ""
    recorded_from: RecordOrigin | None = None


class InterfaceEntry(_InterfaceRow, frozen=True, kw_only=True):
    """The interface of a kind of node in one source; unknown parts are None.

    Types and names may contain ``$(parameter x)``, the value of a parameter. A name may be
    ``$(camera_info of TOPIC)``: the topic `camera_info` in the namespace to which TOPIC is
    remapped.
    """

    origin: InterfaceSource = "table"
    described_package: str = ""
    name: str = ""
    may_publish_more: str = ""
    may_subscribe_more: str = ""
    is_lifecycle: bool = False
    publishing: tuple[str, ...] = ()
    unread_qos: Mapping[str, int] = msgspec.field(default_factory=dict)


InterfaceTable = Mapping[str, InterfaceEntry]


@cache
def reference_node_interfaces() -> InterfaceTable:
    """Return the table of the reference nodes, by their Python paths."""
    return read_interface_table(_TABLE)


def read_interface_table(
    file: Path, *, origin: InterfaceSource = "table", described_package: str = ""
) -> InterfaceTable:
    """Read an interface table that is part of r2bspec, and therefore valid."""
    rows: dict[str, Any] = load_values(file.read_text(encoding="utf-8"))
    return {
        name: parse_interface_entry(row, origin, described_package) for name, row in rows.items()
    }


def parse_interface_entry(
    row: Any, origin: InterfaceSource = "table", described_package: str = ""
) -> InterfaceEntry:
    """Return a row of an interface file.

    Raises:
        msgspec.ValidationError: the row is invalid.
    """
    if isinstance(row, dict):
        row = {key: value for key, value in row.items() if value is not None}
    read = msgspec.convert(row, _InterfaceRow, dec_hook=decode_text)
    return InterfaceEntry(
        **msgspec.structs.asdict(read), origin=origin, described_package=described_package
    )


def interface_of(
    node: Node,
    entries: Sequence[InterfaceEntry],
    names: Remapper,
    parameters: Mapping[str, ParameterValue],
) -> Interface:
    """Return the interface of a node, each part from the first source that describes it.

    Args:
        node: the node as the spec has it.
        entries: what sources say of this node, best first.
        names: how its names are resolved.
        parameters: its parameters.
    """
    doubts = next((row for row in entries if row.may_publish_more), InterfaceEntry())
    unknown = msgspec.structs.replace(
        doubts, subscribes=None, publishes=None, parameters=None, origin=""
    )
    subscribes_entry = next((row for row in entries if row.subscribes is not None), unknown)
    publishes_entry = next((row for row in entries if row.publishes is not None), unknown)
    parameters_entry = next((row for row in entries if row.parameters is not None), unknown)
    return Interface(
        subscribes=node.subscribes
        or _topics(subscribes_entry, subscribes_entry.subscribes, names, parameters),
        publishes=node.publishes
        or _topics(publishes_entry, publishes_entry.publishes, names, parameters),
        parameters=parameters_entry.parameters,
        subscribes_from="spec" if node.subscribes else subscribes_entry.origin,
        publishes_from="spec" if node.publishes else publishes_entry.origin,
        parameters_from=parameters_entry.origin,
        type_parameters=_type_parameters(entries, parameters),
        qos={name: qos for entry in reversed(entries) for name, qos in entry.qos.items()},
        services={name: kind for row in entries for name, kind in row.services.items()},
        other_remappable_names=tuple(
            name for entry in entries for name in _other_remappable_names(entry)
        ),
        described_package=next(
            (entry.described_package for entry in entries if entry.described_package), ""
        ),
        may_publish_more="" if node.publishes else publishes_entry.may_publish_more,
        may_subscribe_more="" if node.subscribes else subscribes_entry.may_subscribe_more,
        is_lifecycle=any(entry.is_lifecycle for entry in entries),
        publishing=subscribes_entry.publishing,
        unread_qos=subscribes_entry.unread_qos,
    )


def _topics(
    entry: InterfaceEntry,
    topics: Mapping[str, str] | None,
    names: Remapper,
    parameters: Mapping[str, ParameterValue],
) -> dict[str, str] | None:
    if topics is None:
        return None
    return {
        _substitute(_derived_topic(name, names), parameters, entry): _substitute(
            kind, parameters, entry
        )
        for name, kind in topics.items()
    }


def _derived_topic(name: str, names: Remapper) -> str:
    """Return the name of a derived topic: in the namespace to which its base is remapped."""
    derived = _DERIVED_TOPIC.fullmatch(name)
    if derived is None:
        return name
    topic = names.resolve(derived[1]).name
    base = derived[1] if topic == names.full(derived[1]) else topic
    folder, slash, _ = base.rpartition("/")
    return f"{folder}{slash}camera_info"


def _other_remappable_names(entry: InterfaceEntry) -> tuple[str, ...]:
    topics = (*(entry.subscribes or ()), *(entry.publishes or ()))
    bases = (derived[1] for topic in topics if (derived := _DERIVED_TOPIC.fullmatch(topic)))
    return (*entry.services, *bases)


def _type_parameters(
    entries: Sequence[InterfaceEntry], parameters: Mapping[str, ParameterValue]
) -> dict[str, str]:
    return {
        _substitute(name, parameters, entry): decides[1]
        for entry in entries
        for topics in (entry.subscribes or {}, entry.publishes or {})
        for name, kind in topics.items()
        if (decides := _PARAMETER.fullmatch(kind)) is not None
    }


def _substitute(text: str, parameters: Mapping[str, ParameterValue], entry: InterfaceEntry) -> str:
    """Insert the values of the node's parameters; an unset one is replaced by nothing."""

    def value(reference: re.Match[str]) -> str:
        name = reference[1]
        if name in parameters:
            return str(parameters[name])
        declared = (entry.parameters or {}).get(name)
        return "" if declared is None or declared.default is None else str(declared.default)

    return _PARAMETER.sub(value, text)


_FOLDER = Path(__file__).parent / "catalogue"
ROS_DISTRIBUTION = "ROS 2 Jazzy"
"""The distribution whose packages the catalogue describes."""


@cache
def catalogue_packages() -> frozenset[str]:
    """Return the packages in the catalogue."""
    return frozenset(file.stem for file in _FOLDER.glob("*.yaml"))


@cache
def catalogue_nodes(package: str) -> InterfaceTable:
    """Return the nodes of a package by plugin; empty if the catalogue does not have the package."""
    if package not in catalogue_packages():
        return {}
    described_package = f"{package} of {ROS_DISTRIBUTION}"
    return read_interface_table(
        _FOLDER / f"{package}.yaml", origin="catalogue", described_package=described_package
    )


def catalogue_entry(node: Node) -> InterfaceEntry | None:
    """Return the catalogue entry of a node, if there is one."""
    if not node.package:
        return None
    entries = catalogue_nodes(node.package)
    if node.plugin:
        return entries.get(node.plugin)
    return next((entry for entry in entries.values() if entry.executable == node.executable), None)
