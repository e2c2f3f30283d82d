"""A fast check whether a document is valid by the strict schema.

jsonschema explains every violation, but it is slow, and importing it takes most of the start-up
time. Most documents are valid, so the schema is compiled once into nested functions that return
true or false. They support the keywords that `r2bspec.language.schema.schema_builder` writes; any
other keyword is an error. A property test compares their results with those of jsonschema.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from r2bspec.language.schema.schema_builder import (
    ALLOWED_WORDS,
    DEFERRABLE,
    KIND,
    LOADER_ONLY,
    NOUN,
    PATH,
    POSITIVE,
    SINGLE_ITEM,
    TOPIC_KEYS,
    UNLESS_LIVE,
)
from r2bspec.language.value_kinds import check_value

Predicate = Callable[[Any], bool]

_TYPES: dict[str, tuple[type, ...]] = {
    "string": (str,),
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "array": (list,),
    "object": (dict,),
}
_IGNORED_KEYWORDS = frozenset(
    {
        "additionalProperties",
        SINGLE_ITEM,
        "default",
        "defaultSnippets",
        "description",
        "examples",
        "patternErrorMessage",
        LOADER_ONLY,
        NOUN,
        PATH,
        POSITIVE,
        DEFERRABLE,
        TOPIC_KEYS,
        UNLESS_LIVE,
    }
)


def compile_predicate(schema: dict[str, Any]) -> Predicate:
    """A function that returns whether a value is valid by the schema."""
    made: dict[int, Predicate] = {}

    def build(part: dict[str, Any]) -> Predicate:
        if id(part) not in made:
            made[id(part)] = _build(part, build)
        return made[id(part)]

    return build(schema)


def _build(schema: dict[str, Any], build: Callable[[dict[str, Any]], Predicate]) -> Predicate:
    strings = build(schema["items"]) if SINGLE_ITEM in schema else _strings(schema)
    arrays, objects = _arrays(schema, build), _objects(schema, build)
    by_type: dict[type, Predicate] = {
        str: strings,
        list: arrays,
        dict: objects,
        int: _numbers(schema),
        float: _numbers(schema),
        bool: _always_true,
        type(None): _always_true,
    }
    if "const" in schema:
        return lambda value: type(value) is int and value == schema["const"]
    if KIND in schema:
        return lambda value: check_value(value, schema) is None
    unknown = schema.keys() - _IGNORED_KEYWORDS - _SUPPORTED_KEYWORDS
    if unknown:
        raise AssertionError(f"unsupported keywords {sorted(unknown)}")
    types = schema.get("type")
    if types is not None:
        names = [types] if isinstance(types, str) else types
        allowed = {each for name in names for each in _TYPES[name]}
        by_type = {kind: check for kind, check in by_type.items() if kind in allowed}
    if by_type == {str: strings}:
        return lambda value: type(value) is str and strings(value)

    def predicate(value: Any) -> bool:
        check = by_type.get(type(value))
        return check is not None and check(value)

    return predicate


_SUPPORTED_KEYWORDS = frozenset(
    {
        "type",
        "enum",
        "pattern",
        "minLength",
        "minimum",
        "maximum",
        "items",
        "minItems",
        "properties",
        "propertyNames",
        "required",
        "minProperties",
        ALLOWED_WORDS,
    }
)


def _always_true(_: Any) -> bool:
    return True


def _strings(schema: dict[str, Any]) -> Predicate:
    words = schema.get("enum", schema.get(ALLOWED_WORDS))
    if words is not None:
        return frozenset(words).__contains__
    if "pattern" in schema:
        search = re.compile(schema["pattern"]).search
        return lambda value: search(value) is not None
    lower = schema.get("minLength", 0)
    return (lambda value: len(value) >= lower) if lower else _always_true


def _numbers(schema: dict[str, Any]) -> Predicate:
    lower, upper = schema.get("minimum"), schema.get("maximum")
    if lower is None and upper is None:
        return _always_true
    return lambda value: (lower is None or value >= lower) and (upper is None or value <= upper)


def _arrays(schema: dict[str, Any], build: Callable[[dict[str, Any]], Predicate]) -> Predicate:
    lower = schema.get("minItems", 0)
    item = build(schema["items"]) if "items" in schema else _always_true
    return lambda value: len(value) >= lower and all(map(item, value))


def _objects(schema: dict[str, Any], build: Callable[[dict[str, Any]], Predicate]) -> Predicate:
    known = {key: build(part) for key, part in schema.get("properties", {}).items()}
    others = schema.get("additionalProperties", True)
    other = build(others) if isinstance(others, dict) else None
    names = build(schema["propertyNames"]) if "propertyNames" in schema else None
    required = tuple(schema.get("required", ()))
    lower = schema.get("minProperties", 0)

    def predicate(value: Any) -> bool:
        if len(value) < lower or any(key not in value for key in required):
            return False
        for key, inner in value.items():
            if names is not None and not names(key):
                return False
            check = known.get(key, other)
            if check is None:
                if others is False:
                    return False
            elif not check(inner):
                return False
        return True

    return predicate
