"""`repeat`: named instances of one entry, each with its own variables."""

from __future__ import annotations

import msgspec

from r2bspec.diagnostics import Span
from r2bspec.language.located_tree import Entry, MapNode, ScalarNode, child, without
from r2bspec.language.names import INSTANCE, VARIABLE

KEY = "repeat"


class RepeatedEntry(msgspec.Struct, frozen=True):
    """An entry without its `repeat`, and its instances."""

    entry: MapNode
    instances: dict[str, Instance]


class Instance(msgspec.Struct, frozen=True):
    """The place of an instance, and its variables."""

    span: Span
    variables: dict[str, ScalarNode]


def parse_repeat(node: MapNode) -> RepeatedEntry | None:
    """The instances of an entry; None without `repeat`, or if the schema refuses it."""
    named = child(node, KEY)
    if not isinstance(named, MapNode) or not named.entries:
        return None
    found = {name: _instance(name, entry) for name, entry in named.entries.items()}
    instances = {name: each for name, each in found.items() if each is not None}
    return RepeatedEntry(without(node, KEY), instances) if len(instances) == len(found) else None


def _instance(name: str, entry: Entry) -> Instance | None:
    if not INSTANCE.matches(name) or not entry.key_resolved or not isinstance(entry.value, MapNode):
        return None
    values: dict[str, ScalarNode] = {}
    for variable, inner in entry.value.entries.items():
        value = inner.value
        if not VARIABLE.matches(variable) or not isinstance(value, ScalarNode):
            return None
        if value.value is None:
            return None
        values[variable] = value
    return Instance(entry.key_span, values)
