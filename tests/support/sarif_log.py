"""What r2bspec writes of SARIF 2.1.0, as types: each is the object of that name in the standard.

https://docs.oasis-open.org/sarif/sarif/v2.1.0/sarif-v2.1.0.html says what each may contain. A key
that is not here is an error even if the standard knows it: add it here, as the standard has it.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, UnsetType

Count = Annotated[int, msgspec.Meta(ge=1)]
Index = Annotated[int, msgspec.Meta(ge=0)]
Level = Literal["none", "note", "warning", "error"]
# RFC 3986: what is not of these characters is percent-encoded.
UriReference = Annotated[
    str, msgspec.Meta(pattern=r"^(?:[A-Za-z0-9._~:/?#@!$&'()*+,;=\[\]-]|%[0-9A-Fa-f]{2})+$")
]


_UNIQUE = {"relatedLocations", "rules"}


class _Object(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    pass


class Message(_Object, frozen=True):
    text: str


class ArtifactLocation(_Object, frozen=True):
    uri: UriReference


class Region(_Object, frozen=True):
    start_line: Count
    start_column: Count
    end_line: Count
    end_column: Count


class PhysicalLocation(_Object, frozen=True):
    artifact_location: ArtifactLocation
    region: Region


class Location(_Object, frozen=True):
    physical_location: PhysicalLocation
    id: Index | UnsetType = UNSET
    message: Message | UnsetType = UNSET


class Result(_Object, frozen=True):
    rule_id: str
    rule_index: Index
    level: Level
    message: Message
    locations: tuple[Location, ...]
    partial_fingerprints: dict[str, str]
    properties: dict[str, Any]
    related_locations: tuple[Location, ...] = ()


class Configuration(_Object, frozen=True):
    level: Level


class Rule(_Object, frozen=True):
    id: str
    name: str | UnsetType = UNSET
    short_description: Message | UnsetType = UNSET
    full_description: Message | UnsetType = UNSET
    help: Message | UnsetType = UNSET
    default_configuration: Configuration | UnsetType = UNSET


class Driver(_Object, frozen=True):
    name: str
    semantic_version: str
    rules: tuple[Rule, ...]


class Tool(_Object, frozen=True):
    driver: Driver


class Run(_Object, frozen=True):
    tool: Tool
    column_kind: Literal["utf16CodeUnits", "unicodeCodePoints"]
    results: tuple[Result, ...]


class Log(_Object, frozen=True):
    schema: UriReference = msgspec.field(name="$schema")
    version: Literal["2.1.0"]
    runs: tuple[Run, ...]


def decode(text: str) -> Log:
    """Read a log.

    Raises:
        msgspec.ValidationError: it is not as the standard demands.
    """
    _check_unique(msgspec.json.decode(text))
    log = msgspec.json.decode(text, type=Log)
    for run in log.runs:
        rules = [rule.id for rule in run.tool.driver.rules]
        if any(
            rules[result.rule_index : result.rule_index + 1] != [result.rule_id]
            for result in run.results
        ):
            raise msgspec.ValidationError("a ruleIndex that is not that of the ruleId")
    return log


def _check_unique(value: Any, key: str = "") -> None:
    if isinstance(value, dict):
        for name, inner in value.items():
            _check_unique(inner, name)
    elif isinstance(value, list):
        if key in _UNIQUE and any(one in value[:place] for place, one in enumerate(value)):
            raise msgspec.ValidationError(f"{key} has equal items")
        for inner in value:
            _check_unique(inner)
