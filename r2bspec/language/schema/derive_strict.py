"""The strict and the published schema, both derived from `document_root.DOCUMENT`.

- The strict one validates a document after substitution and without ``x-`` keys. Quantities and
  requirements are validated by the classes that parse them.
- The published one is for editors. It is plain draft-07, accepts ``$(var x)`` and ``$(env X)`` for
  every scalar, ignores ``x-`` keys, and accepts null in maps with 'extends'.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from r2bspec.language.schema.document_root import DOCUMENT
from r2bspec.language.schema.schema_builder import (
    ALLOWED_WORDS,
    DEFERRABLE,
    KIND,
    LOADER_ONLY,
    NOUN,
    PATH,
    POSITIVE,
    QUANTITIES,
    SINGLE_ITEM,
    TOPIC_KEYS,
    UNLESS_LIVE,
    Schema,
)

TITLE = "r2bspec, version 1"
FILE_NAME = "r2bspec-v1.schema.json"

_NULL_RULE = "nothing_is_removed"
_PRIVATE_KEYWORDS = (
    SINGLE_ITEM,
    KIND,
    LOADER_ONLY,
    NOUN,
    PATH,
    POSITIVE,
    DEFERRABLE,
    TOPIC_KEYS,
    UNLESS_LIVE,
    ALLOWED_WORDS,
)
_REFERENCE = r"\$\((?:var|env) +[A-Za-z_][A-Za-z0-9_]* *\)"
_WHOLE_REFERENCE = f"^{_REFERENCE}$"
_NUMBER = r"\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
_SCALAR_NAMES = {"integer": "an integer", "boolean": "true or false"}
_METRIC = r"[A-Za-z][A-Za-z0-9_]*(?:\.[A-Za-z][A-Za-z0-9_]*)*"
_REQUIREMENT = rf"^\s*(?:sustained|{_METRIC}\s*(?:[<>]=?|[=!]=)\s*\d.*?)\s*$"


def strict_schema(*, live: bool = False) -> Schema:
    """The schema that the loader applies; `live` is that of live benchmarks."""

    def stricter(schema: Schema) -> Schema:
        strict = dict(schema)
        if UNLESS_LIVE in strict and not live:
            needed = {*strict.get("required", ()), *strict[UNLESS_LIVE]}
            strict["required"] = [key for key in strict["properties"] if key in needed]
        # The class has better messages than 'type'; see `r2bspec.language.schema_validator`.
        if KIND in strict:
            del strict["type"]
        for pattern in (strict, strict.get("propertyNames", {})):
            # In Python, '$' also matches before a line break at the end.
            if pattern.get("pattern", "").endswith("$"):
                pattern["pattern"] = pattern["pattern"][:-1] + r"\Z"
        return strict

    return _rewrite(DOCUMENT, stricter)


def published_schema() -> Schema:
    """The schema for editors, as `r2bspec schema spec` prints it."""
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "$id": FILE_NAME,
        "title": TITLE,
        **_with_removable_keys(_rewrite(DOCUMENT, _publish)),
        "definitions": {_NULL_RULE: _null_rule()},
    }


def published_schema_text() -> str:
    """The published schema as a file, with a newline at its end."""
    import json

    return json.dumps(published_schema(), indent=2, ensure_ascii=False) + "\n"


def _with_removable_keys(schema: Schema) -> Schema:
    """The schema with null allowed for every key, and refused outside of maps with `extends`.

    Null removes a key that `extends` brings. The refusal is a small schema of its own, so that the
    schema for editors is not duplicated.
    """
    allowed = _rewrite(schema, _with_null)
    # The document itself and its version cannot be removed.
    allowed["type"] = schema["type"]
    allowed["properties"]["r2bspec"] = schema["properties"]["r2bspec"]
    return allowed | {"allOf": [{"$ref": f"#/definitions/{_NULL_RULE}"}]}


def _with_null(schema: Schema) -> Schema:
    """Each value of a map may be null. Descriptions and completions are unchanged."""
    changed = dict(schema)
    if "properties" in changed:
        changed["properties"] = {key: _or_null(each) for key, each in changed["properties"].items()}
    if isinstance(changed.get("additionalProperties"), dict):
        changed["additionalProperties"] = _or_null(changed["additionalProperties"])
    return changed


def _or_null(schema: Schema) -> Schema:
    kinds = schema.get("type")
    if kinds is None:
        return schema
    # Null comes last: editors insert a value of the first type.
    changed = schema | {"type": [*([kinds] if isinstance(kinds, str) else kinds), "null"]}
    if "enum" in changed:
        changed["enum"] = [*changed["enum"], None]
    return changed


def _null_rule() -> Schema:
    """No value is null, except below a map that extends another.

    Written with 'not' instead of 'type', so that editors do not propose values because of it.
    """
    itself = {"$ref": f"#/definitions/{_NULL_RULE}"}
    return {
        "if": {"type": "object", "required": ["extends"]},
        "else": {
            "not": {"type": "null"},
            "errorMessage": "missing value; null removes a key of an extended map",
            "additionalProperties": itself,
            "items": itself,
        },
    }


def _publish(schema: Schema) -> Schema:
    public = {key: value for key, value in schema.items() if key not in _PRIVATE_KEYWORDS}
    if "extends" in schema.get("properties", {}) and "required" in public:
        # Required keys may come from the extended entry.
        public["if"] = {"not": {"required": ["extends"]}}
        public["then"] = {"required": public.pop("required")}
    kind = schema.get(KIND)
    if kind is not None:
        public |= _quantity_pattern(kind)
    if SINGLE_ITEM in schema:
        alone = ("pattern", "patternErrorMessage")
        public |= {key: public["items"][key] for key in alone}
    if ALLOWED_WORDS in schema:
        public |= _or_words(schema[ALLOWED_WORDS], public.get("pattern"))
    if schema.get("additionalProperties") is False:
        public["patternProperties"] = {"^x-": {"description": "Ignored."}}
    if "propertyNames" in public:
        keys = {
            key: value
            for key, value in public["propertyNames"].items()
            if key not in _PRIVATE_KEYWORDS
        }
        if TOPIC_KEYS in schema:
            keys["pattern"] = _or_reference(keys["pattern"])
        public["propertyNames"] = keys
    if "enum" in public:
        values = public.pop("enum")
        return public | {"anyOf": [{"enum": values}, {"pattern": _WHOLE_REFERENCE}]}
    if "pattern" in public and "type" in public:
        public["pattern"] = _or_reference(public["pattern"])
    for kind, meant in _SCALAR_NAMES.items():
        if public.get("type") == kind and "const" not in public:
            public |= {
                "type": [kind, "string"],
                "pattern": _WHOLE_REFERENCE,
                "patternErrorMessage": f"{meant}, or $(var name)",
            }
    return public


def _or_words(words: list[str], pattern: str | None) -> Schema:
    """Words that are allowed instead of a map, or besides a pattern."""
    only = f"^(?:{'|'.join(words)})$"
    if pattern is not None:
        return {"pattern": f"(?:{pattern})|{only}"}
    return {"pattern": only, "patternErrorMessage": f"one of {', '.join(words)}, or a map"}


def _quantity_pattern(kind: str) -> Schema:
    if kind == "requirement":
        return {
            "pattern": _REQUIREMENT,
            "patternErrorMessage": "a requirement is 'metric op bound', such as latency.p99 < 50 "
            "ms, or sustained",
        }
    units = "|".join(QUANTITIES[kind].units)
    return {
        "pattern": rf"^\s*{_NUMBER}\s*(?:{units})\s*$",
        "patternErrorMessage": f"a {kind} is a number with a unit, such as "
        f"{QUANTITIES[kind].example}",
    }


def _or_reference(pattern: str) -> str:
    return f"(?:{pattern})|{_REFERENCE}"


def _rewrite(schema: Schema, change: Callable[[Schema], Schema]) -> Schema:
    """Apply `change` to a schema and to all schemas in it, innermost first."""
    inner: dict[str, Any] = dict(schema)
    if "propertyNames" in inner:
        inner["propertyNames"] = dict(inner["propertyNames"])
    if "properties" in inner:
        inner["properties"] = {k: _rewrite(v, change) for k, v in inner["properties"].items()}
    for key in ("items", "additionalProperties"):
        if isinstance(inner.get(key), dict):
            inner[key] = _rewrite(inner[key], change)
    return change(inner)
