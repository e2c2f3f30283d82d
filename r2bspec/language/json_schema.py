"""The published JSON Schema, made of the rules of the language.

The schema is for editors and other tools. It is plain draft-07, accepts ``$(var x)`` and
``$(env X)`` for every scalar, ignores ``x-`` keys, and accepts null in maps with 'extends'. What
`validate` finds in addition is in `r2bspec.language.read_spec` and
`r2bspec.language.key_constraints`.
"""

from __future__ import annotations

import json
from typing import Any

from r2bspec.language.declaration import NamePattern, ValueRule, language
from r2bspec.language.quantities import Quantity

Schema = dict[str, Any]

TITLE = "r2bspec, version 1"
FILE_NAME = "r2bspec-v1.schema.json"

_NULL_RULE = "nothing_is_removed"
_REFERENCE = r"\$\((?:var|env) +[A-Za-z_][A-Za-z0-9_]* *\)"
_WHOLE_REFERENCE = f"^{_REFERENCE}$"
_NUMBER = r"\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
_SCALAR_NAMES = {"integer": "an integer", "boolean": "true or false"}
_WORD = "[A-Za-z][A-Za-z0-9_]*"
_METRIC = rf"{_WORD}(?:/{_WORD})*(?:\.{_WORD})*"
_REQUIREMENT = rf"^\s*(?:sustained|{_METRIC}\s*(?:[<>]=?|[=!]=)\s*\d.*?)\s*$"
_NULL_MESSAGE = "missing value; null removes a key of an extended map"


def published_schema() -> Schema:
    """The schema for editors, as `r2bspec schema spec` prints it.

    Null is allowed for every key, because it removes a key that `extends` brings, and refused
    outside of maps with `extends` by a small schema of its own.
    """
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "$id": FILE_NAME,
        "title": TITLE,
        **_schema(language()),
        "definitions": {_NULL_RULE: _null_rule()},
        "allOf": [{"$ref": f"#/definitions/{_NULL_RULE}"}],
    }


def published_schema_text() -> str:
    """The published schema as a file, with a newline at its end."""
    return json.dumps(published_schema(), indent=2, ensure_ascii=False) + "\n"


def _null_rule() -> Schema:
    """No value is null, except below a map that extends another.

    Written with 'not' instead of 'type', so that editors do not propose values because of it.
    """
    itself = {"$ref": f"#/definitions/{_NULL_RULE}"}
    return {
        "if": {"type": "object", "required": ["extends"]},
        "else": {
            "not": {"type": "null"},
            "errorMessage": _NULL_MESSAGE,
            "additionalProperties": itself,
            "items": itself,
        },
    }


def _schema(rule: ValueRule, *, removable: bool = False) -> Schema:
    """The schema of a rule; a removable value may be null."""
    about = rule.about
    schema: Schema = {"description": rule.description}
    kinds = _types(rule)
    if kinds:
        # Null comes last: editors insert a value of the first type.
        kinds = (*kinds, "null") if removable else kinds
        schema["type"] = list(kinds) if len(kinds) > 1 else kinds[0]
    schema |= _texts(rule)
    limits = {"minimum": about.minimum, "maximum": about.maximum, "const": rule.const}
    schema |= {name: limit for name, limit in limits.items() if limit is not None}
    if rule.items is not None:
        schema["items"] = _schema(rule.items)
        if about.at_least:
            schema["minItems"] = about.at_least
    if about.not_empty:
        schema["minLength"] = 1
    if rule.keys is not None:
        schema |= _known_keys(rule)
    elif rule.values is not None and rule.names is not None:
        schema["propertyNames"] = _pattern(rule.names, or_reference=about.topics)
        schema["additionalProperties"] = _schema(rule.values, removable=True)
        if about.at_least:
            schema["minProperties"] = about.at_least
    if rule.shown_default is not None:
        schema["default"] = rule.shown_default
    schema["examples"] = list(about.examples)
    if rule.snippets:
        schema["defaultSnippets"] = list(rule.snippets)
    return schema


def _types(rule: ValueRule) -> tuple[str, ...]:
    """The types of JSON; a reference in place of a number or a truth value is a string."""
    alone = len(rule.kinds) == 1 and rule.kinds[0] in _SCALAR_NAMES and rule.const is None
    return (*rule.kinds, "string") if alone else rule.kinds


def _known_keys(rule: ValueRule) -> Schema:
    keys = rule.keys or {}
    version = ("r2bspec",)
    schema: Schema = {
        "properties": {
            name: _schema(below, removable=name not in version) for name, below in keys.items()
        },
        "additionalProperties": False,
        "patternProperties": {"^x-": {"description": "Ignored."}},
    }
    required = list(rule.required_unless(live=True, calls=True))
    if required and "extends" in keys:
        # Required keys may come from the extended entry.
        return schema | {"if": {"not": {"required": ["extends"]}}, "then": {"required": required}}
    return schema | ({"required": required} if required else {})


def _texts(rule: ValueRule) -> Schema:
    """What a text must be like; a reference is accepted in place of it."""
    if rule.is_choice:
        return {"anyOf": [{"enum": list(rule.words)}, {"pattern": _WHOLE_REFERENCE}]}
    if _types(rule) != rule.kinds:
        return {
            "pattern": _WHOLE_REFERENCE,
            "patternErrorMessage": f"{_SCALAR_NAMES[rule.kinds[0]]}, or $(var name)",
        }
    if rule.quantity is not None:
        schema = _quantity(rule)
    elif rule.pattern is not None:
        schema = _pattern(rule.pattern)
    else:
        schema = {}
    if rule.words:
        only = f"^(?:{'|'.join(rule.words)})$"
        schema = (
            {**schema, "pattern": f"(?:{schema['pattern']})|{only}"}
            if schema
            else {
                "pattern": only,
                "patternErrorMessage": f"one of {', '.join(rule.words)}, or a map",
            }
        )
    return {**schema, "pattern": _or_reference(schema["pattern"])} if schema else {}


def _pattern(form: NamePattern, *, or_reference: bool = False) -> Schema:
    pattern = _or_reference(form.pattern) if or_reference else form.pattern
    return {"pattern": pattern, "patternErrorMessage": form.message}


def _quantity(rule: ValueRule) -> Schema:
    kind = rule.quantity
    if kind is None or not issubclass(kind, Quantity):
        return {
            "pattern": _REQUIREMENT,
            "patternErrorMessage": "a requirement is 'metric op bound', such as latency.p99 < 50 "
            "ms, or sustained",
        }
    return {
        "pattern": rf"^\s*{_NUMBER}\s*(?:{'|'.join(kind.units)})\s*$",
        "patternErrorMessage": f"a {kind.kind} is a number with a unit, such as {kind.example}",
    }


def _or_reference(pattern: str) -> str:
    return f"(?:{pattern})|{_REFERENCE}"
