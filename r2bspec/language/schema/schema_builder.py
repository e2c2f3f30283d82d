"""Builders for the sections of the schema.

They write JSON Schema, draft-07, with annotations that `r2bspec.language.schema.derive_strict`
removes from the published schema:

- ``r2b-kind``: the string is a quantity (``duration``, ``rate``, ``size``, ``share``) or a
  ``requirement``, and is validated by the class that parses it,
- ``r2b-positive``: the quantity must be more than zero,
- ``r2b-keys``: the keys of the map are topics, in which references are supported,
- ``r2b-noun``: the name of a text of the pattern in messages,
- ``r2b-words``: the allowed words of a string that may also be a map or a quantity,
- ``r2b-path``: the string is a path, relative to the file in which it is written,
- ``r2b-loader``: the loader evaluates the key; the typed `Spec` does not have it,
- ``r2b-unless-live``: keys that are required unless the benchmark is live,
- ``r2b-alone``: a string instead of the list is its only item,
- ``r2b-deferrable``: the value is only shown, or given to a process, so that it may refer to a
  secret.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from r2bspec.language.quantities import Duration, Quantity, Rate, Share, Size
from r2bspec.language.schema.name_patterns import NamePattern

Schema = dict[str, Any]

KIND = "r2b-kind"
POSITIVE = "r2b-positive"
TOPIC_KEYS = "r2b-keys"
NOUN = "r2b-noun"
ALLOWED_WORDS = "r2b-words"
PATH = "r2b-path"
LOADER_ONLY = "r2b-loader"
UNLESS_LIVE = "r2b-unless-live"
SINGLE_ITEM = "r2b-alone"
DEFERRABLE = "r2b-deferrable"
SCALAR_TYPES = ["string", "number", "boolean"]

QUANTITIES: dict[str, type[Quantity]] = {kind.kind: kind for kind in (Duration, Rate, Size, Share)}


def text(
    description: str,
    *,
    examples: Sequence[str],
    form: NamePattern | None = None,
    default: str = "",
    path: bool = False,
) -> Schema:
    """A string, of a pattern if one is given; `path` marks the path of a file or a folder."""
    schema: Schema = {"type": "string", "description": description, "examples": list(examples)}
    if form is not None:
        schema |= _pattern(form)
    if path:
        schema[PATH] = True
    # Editors would insert an empty default as a value.
    return schema | {"default": default} if default else schema


def integer(
    description: str,
    *,
    minimum: int,
    examples: Sequence[int],
    default: int | None = None,
    maximum: int | None = None,
) -> Schema:
    """An integer."""
    schema: Schema = {"type": "integer", "description": description, "minimum": minimum}
    if maximum is not None:
        schema["maximum"] = maximum
    if default is not None:
        schema["default"] = default
    return schema | {"examples": list(examples)}


def boolean(description: str, *, default: bool) -> Schema:
    """A boolean."""
    return {
        "type": "boolean",
        "description": description,
        "default": default,
        "examples": [not default],
    }


def choice(description: str, values: Sequence[str], default: str | None = None) -> Schema:
    """One of a few words."""
    return {
        "type": "string",
        "description": description,
        "enum": list(values),
        **({} if default is None else {"default": default}),
        "examples": list(values[:1]),
    }


def scalar(description: str, *, examples: Sequence[object]) -> Schema:
    """A string, a number or a boolean."""
    return {"type": list(SCALAR_TYPES), "description": description, "examples": list(examples)}


def quantity(
    kind: type[Quantity],
    description: str,
    *,
    default: str | None = None,
    examples: Sequence[str] = (),
    positive: bool = False,
    words: Sequence[str] = (),
) -> Schema:
    """A number with a unit, written as a string; or one of `words`."""
    schema: Schema = {
        "type": "string",
        "description": description,
        KIND: kind.kind,
        "examples": list(examples) or [kind.example],
    }
    if positive:
        schema[POSITIVE] = True
    if words:
        schema[ALLOWED_WORDS] = list(words)
    return schema if default is None else schema | {"default": default}


def requirement(description: str, *, examples: Sequence[str]) -> Schema:
    """A requirement (`r2bspec.language.requirement_grammar`)."""
    return {
        "type": "string",
        "description": description,
        KIND: "requirement",
        "examples": list(examples),
    }


def array(
    description: str,
    items: Schema,
    *,
    examples: Sequence[object],
    at_least: int = 0,
) -> Schema:
    """A list."""
    schema: Schema = {"type": "array", "description": description, "items": items}
    if at_least:
        schema["minItems"] = at_least
    else:
        schema["default"] = []
    return schema | {"examples": list(examples)}


def record(
    description: str,
    properties: Mapping[str, Schema],
    *,
    examples: Sequence[object],
    required: Sequence[str] = (),
    snippets: Sequence[Schema] = (),
    default: object = None,
    unless_live: Sequence[str] = (),
) -> Schema:
    """A map with known keys; those in `unless_live` are required unless the benchmark is live."""
    schema: Schema = {
        "type": "object",
        "description": description,
        "properties": {
            name: {k: v for k, v in prop.items() if not (name in required and k == "default")}
            for name, prop in properties.items()
        },
        "additionalProperties": False,
        "examples": list(examples),
    }
    if required:
        schema["required"] = list(required)
    if unless_live:
        schema[UNLESS_LIVE] = list(unless_live)
    if default is not None:
        schema["default"] = default
    if snippets:
        schema["defaultSnippets"] = list(snippets)
    return schema


def name_map(
    description: str,
    keys: NamePattern,
    values: Schema,
    *,
    examples: Sequence[object],
    topics: bool = False,
    at_least: int = 0,
    snippets: Sequence[Schema] = (),
) -> Schema:
    """A map whose keys are names given by the user; `topics` means that they are topics."""
    schema: Schema = {
        "type": "object",
        "description": description,
        "propertyNames": _pattern(keys),
        "additionalProperties": values,
        "examples": list(examples),
    }
    if topics:
        schema[TOPIC_KEYS] = "topics"
    if at_least:
        schema["minProperties"] = at_least
    else:
        schema["default"] = {}
    if snippets:
        schema["defaultSnippets"] = list(snippets)
    return schema


def or_words(schema: Schema, words: Sequence[str], examples: Sequence[object]) -> Schema:
    """A map, or one of a few words as a shorthand for a map."""
    return {
        **schema,
        "type": ["string", "object"],
        ALLOWED_WORDS: list(words),
        "examples": [*examples, *schema["examples"]],
    }


def loader_key(schema: Schema) -> Schema:
    """The same, for a key that the loader evaluates."""
    return schema | {LOADER_ONLY: True}


def deferrable(schema: Schema) -> Schema:
    """The same, as a value that may refer to a secret."""
    return schema | {DEFERRABLE: True}


def _pattern(form: NamePattern) -> Schema:
    return {"pattern": form.pattern, "patternErrorMessage": form.message, NOUN: form.noun}
