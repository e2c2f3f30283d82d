"""Unknown keys: the key that was probably intended, or where it belongs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from typing import Any

from msgspec.structs import replace

from r2bspec.diagnostics import Diagnostic, Edit, did_you_mean, format_path
from r2bspec.diagnostics.quote import quote
from r2bspec.language.diagnostic_collector import MAX_PROBLEMS
from r2bspec.language.located_tree import MapNode
from r2bspec.language.schema_validator import schema as strict
from r2bspec.language.violations.retired_keys import retired_key_help
from r2bspec.language.violations.schema_words import comma_separated, join_words
from r2bspec.language.violations.violation import Violation

_SYNONYMS = {
    "args": "arguments",
    "bags": "bag",
    "cmd": "command",
    "config": "parameters",
    "environment": "env",
    "exec": "executable",
    "message_type": "format",
    "msg_type": "format",
    "ns": "namespace",
    "params": "parameters",
    "pkg": "package",
    "rate": "at",
    "remap": "remappings",
    "requirements": "require",
    "requires": "require",
    "rosbag": "bag",
    "runs": "iterations",
    "source": "from",
    "timeout": "start_timeout",
    "type": "format",
    "vars": "variables",
}
"""Words of ROS launch files and other tools; used only where the map has the target key."""


def unknown_keys(violation: Violation) -> Iterator[tuple[Diagnostic, str]]:
    """A diagnostic for each unknown key, and the key of the same map that was intended."""
    owner = violation.node
    if not isinstance(owner, MapNode):
        return
    properties: dict[str, Any] = violation.schema["properties"]
    unknown = [key for key in owner.entries if key not in properties][: MAX_PROBLEMS + 1]
    for key in tuple(unknown):
        if gone := retired_key_help(violation.path, key):
            yield _diagnostic(violation, owner, key, gone), ""
            unknown.remove(key)
    absent = [key for key in properties if key not in owner.entries]
    meant = _intended_keys(unknown, absent)
    for key in unknown:
        if key in meant:
            yield _misspelled_key(violation, owner, key, meant[key]), meant[key]
            continue
        above = _missing_level(violation, owner, key)
        if above:
            help_text = f"put it under '{format_path((*violation.path, above))}'"
        else:
            help_text = _location_help(violation, key) or _present_key_help(owner, key, properties)
        yield _diagnostic(violation, owner, key, help_text), above


def _diagnostic(violation: Violation, owner: MapNode, key: str, help_text: str) -> Diagnostic:
    place = f"in {violation.name}" if violation.path else "at the top of the document"
    return violation.error(
        "R2B101",
        f"unknown key {quote(key)} {place}",
        help_text,
        span=owner.entries[key].key_span,
        path=(*violation.path, key),
    )


def _misspelled_key(violation: Violation, owner: MapNode, key: str, meant: str) -> Diagnostic:
    known = f"known keys: {comma_separated(violation.schema['properties'])}"
    found = _diagnostic(violation, owner, key, f"did you mean '{meant}'? {known}")
    if _spelling(key) == _spelling(meant):
        return replace(found, edit=Edit(found.span, meant))
    return found


def _intended_keys(unknown: Sequence[str], absent: Iterable[str]) -> dict[str, str]:
    """The absent key that each unknown key probably means; each is used once.

    The most certain matches come first: another spelling of the same, then a synonym, then a key
    that is valid elsewhere (no match here), then a similar name.
    """
    free = list(absent)
    found: dict[str, str] = {}
    for key in unknown:
        other_word = _SYNONYMS.get(key.casefold().replace("-", "_"), "")
        for name in free:
            if _spelling(name) == _spelling(key) or name == other_word:
                found[key] = name
                free.remove(name)
                break
    for key in unknown:
        if key not in found and key not in _key_locations():
            close = did_you_mean(key, free)
            if close:
                found[key] = close
                free.remove(close)
    return found


def _spelling(key: str) -> str:
    """The key without case and separators."""
    return key.casefold().replace("-", "").replace("_", "").replace(" ", "")


def _missing_level(violation: Violation, owner: MapNode, key: str) -> str:
    """The key below which a value of this shape belongs, such as 'nodes' for a node."""
    inside = owner.entries[key].value
    if isinstance(inside, MapNode) and inside.entries:
        for name, below in violation.schema["properties"].items():
            values = below.get("additionalProperties")
            known = values.get("properties", {}) if isinstance(values, dict) else {}
            if inside.entries.keys() <= known.keys():
                return str(name)
    return ""


def _location_help(violation: Violation, key: str) -> str:
    """Help for a key that is valid elsewhere."""
    homes = [home for home in _key_locations().get(key, ()) if home != format_path(violation.path)]
    if not homes:
        return ""
    known = comma_separated(violation.schema["properties"])
    places = join_words([f"'{home}'" for home in homes[:3]])
    return f"it belongs under {places}; known keys here: {known}"


def _present_key_help(owner: MapNode, key: str, properties: Iterable[str]) -> str:
    """Help for a key similar to one that the map already has."""
    close = did_you_mean(key, [name for name in properties if name in owner.entries])
    known = f"known keys: {comma_separated(properties)}"
    return f"did you mean '{close}', which is already set? {known}" if close else known


@cache
def _key_locations() -> dict[str, tuple[str, ...]]:
    """The paths where each key of the language is valid, such as ``monitors.<name>``."""
    homes: dict[str, list[str]] = {}

    def walk(schema: dict[str, Any], path: str) -> None:
        for key, below in schema.get("properties", {}).items():
            if path:
                homes.setdefault(key, []).append(path)
            walk(below, f"{path}.{key}" if path else key)
        values = schema.get("additionalProperties")
        if isinstance(values, dict):
            walk(values, f"{path}.<name>")

    walk(strict(), "")
    return {key: tuple(paths) for key, paths in homes.items()}
