"""Keys that are unknown, missing, misnamed, or stand where a name should."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from typing import Any

from r2bspec.diagnostics import Diagnostic, Edit, Path, did_you_mean, format_path
from r2bspec.diagnostics.quote import quote
from r2bspec.spec.tree import MapNode, span_at
from r2bspec.spec.validator import schema as strict
from r2bspec.spec.violations.model import Violation
from r2bspec.spec.violations.repairs import repaired_name
from r2bspec.spec.violations.wording import either, example, example_line, listed

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
    "remap": "remappings",
    "requirements": "require",
    "requires": "require",
    "rosbag": "bag",
    "runs": "iterations",
    "source": "from",
    "timeout": "start_timeout",
    "type": "format",
    "vars": "variables",
    "warmup": "warm_up",
}
"""What people write who know ROS launch files or other tools; only where the target is known."""


def unknown_keys(violation: Violation) -> Iterator[tuple[Diagnostic, tuple[str, ...]]]:
    """A diagnostic for each unknown key, and the keys of the same map that may be meant by it."""
    properties: dict[str, Any] = violation.schema["properties"]
    owner = violation.node
    if not isinstance(owner, MapNode):
        return
    absent = [key for key in properties if key not in owner.entries]
    for key in owner.entries:
        if key not in properties:
            yield _unknown_key(violation, owner, key, absent)


def _unknown_key(
    violation: Violation, owner: MapNode, key: str, absent: Sequence[str]
) -> tuple[Diagnostic, tuple[str, ...]]:
    properties: dict[str, Any] = violation.schema["properties"]
    span = owner.entries[key].key_span
    meant = _meant(key, absent)
    known = f"known are {listed(properties)}"
    place = f"in {violation.name}" if violation.path else "at the top of the document"
    edit = None
    if meant:
        help_text = f"did you mean '{meant}'? {known}"
        if _spelling(key) == _spelling(meant):
            edit = Edit(span, meant)
    else:
        meant = _forgotten_level(violation, owner, key)
        help_text = (
            f"put it under '{format_path((*violation.path, meant))}'"
            if meant
            else _elsewhere(violation, key) or known
        )
    message = f"the key {quote(key)} is not known {place}"
    found = violation.error("R2B101", message, help_text, span=span, path=(*violation.path, key))
    if edit is not None:
        found = Diagnostic(
            found.code, found.severity, message, span, found.path, help_text, edit=edit
        )
    return found, ((meant,) if meant else ())


def _meant(key: str, absent: Sequence[str]) -> str:
    same = [name for name in absent if _spelling(name) == _spelling(key)]
    if same:
        return same[0]
    synonym = _SYNONYMS.get(key.casefold().replace("-", "_"), "")
    return synonym if synonym in absent else did_you_mean(key, absent)


def _spelling(key: str) -> str:
    """What is left when case and the kind of separator do not count."""
    return key.casefold().replace("-", "").replace("_", "").replace(" ", "")


def _forgotten_level(violation: Violation, owner: MapNode, key: str) -> str:
    """The key under which something of this shape should stand, such as 'nodes' for a node."""
    inside = owner.entries[key].value
    if isinstance(inside, MapNode) and inside.entries:
        for name, below in violation.schema["properties"].items():
            values = below.get("additionalProperties")
            known = values.get("properties", {}) if isinstance(values, dict) else {}
            if inside.entries.keys() <= known.keys():
                return str(name)
    return ""


def _elsewhere(violation: Violation, key: str) -> str:
    """Help for a key that is right, but not here."""
    homes = [home for home in _homes().get(key, ()) if home != format_path(violation.path)]
    if not homes:
        return ""
    known = listed(violation.schema["properties"])
    return f"it belongs under {either([repr(home) for home in homes[:3]])}; known here are {known}"


@cache
def _homes() -> dict[str, tuple[str, ...]]:
    """Where each key of the language belongs, as people write it: ``monitors.<name>``."""
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


def missing_keys(violations: Iterable[Violation], renamed: set[Path]) -> Iterator[Diagnostic]:
    """One diagnostic for each map that lacks keys, whatever their number."""
    seen: set[Path] = set()
    for violation in violations:
        if violation.path in seen:
            continue
        seen.add(violation.path)
        missing = [
            key
            for key in violation.limit
            if key not in violation.value and (*violation.path, key) not in renamed
        ]
        if not missing:
            continue
        properties = violation.schema["properties"]
        lines = [example_line(key, properties[key]) for key in missing]
        names = either([f"'{key}'" for key in missing], "and")
        yield violation.error(
            "R2B102",
            f"{violation.name} lacks {names}",
            f"add {either(lines, 'and')}",
            span=span_at(violation.root, violation.path, key=True),
        )


def misnamed(violation: Violation) -> Diagnostic:
    """A key whose form is not that of the names or topics that belong there."""
    path = (*violation.path, violation.value)
    span = span_at(violation.root, path, key=True)
    better = repaired_name(violation.value, violation.schema)
    message = violation.schema["patternErrorMessage"]
    return violation.error(
        "R2B106",
        f"{quote(violation.value)} is not {violation.schema['r2b-noun']}",
        f"write {better}; {message}" if better else message,
        span=span,
        path=path,
    )


def name_forgotten(violations: Sequence[Violation]) -> Iterator[tuple[Path, Diagnostic]]:
    """Maps whose values should each stand under a name, written without the name.

    ``monitors: {topic: a, format: b}`` violates the schema twice; the mistake is one.
    """
    owners: dict[Path, list[Violation]] = {}
    for violation in violations:
        if violation.keyword == "type" and violation.path and violation.limit == "object":
            owners.setdefault(violation.path[:-1], []).append(violation)
    for path, inside in owners.items():
        keys = [str(one.path[-1]) for one in inside]
        properties = inside[0].schema.get("properties", {})
        if not properties or not any(key in properties for key in keys):
            continue
        owner = _owner(path)
        if owner is None:
            continue
        yield (
            path,
            inside[0].error(
                "R2B117",
                f"'{format_path(path)}' needs a name above {listed(keys)}",
                f"for example: '{format_path(path)}: {example(owner)}'",
                span=span_at(inside[0].root, path, key=True),
                path=path,
            ),
        )


def _owner(path: Path) -> dict[str, Any] | None:
    """The schema of the map of names at a path, or None."""
    schema: Any = strict()
    for part in path:
        known = schema.get("properties", {})
        schema = known.get(part, schema.get("additionalProperties"))
        if not isinstance(schema, dict):
            return None
    return schema if "propertyNames" in schema else None
