"""Whether a document obeys the strict schema, decided quickly.

jsonschema explains every violation, takes its time for it, and costs most of the start of the
program. Most documents have no violation, so each schema is turned into a nest of functions here,
once, that answer yes or no. They know the keywords that the builders of
`r2bspec.language.schema.schema_builder` write, and refuse to be made from any other; a property
test holds both answers equal.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from r2bspec.language.schema.schema_builder import (
    ALONE,
    KIND,
    LOADER,
    NOUN,
    PATH,
    POSITIVE,
    TOPIC_KEYS,
    UNLESS_LIVE,
    WORDS,
)
from r2bspec.language.value_kinds import judge

Judge = Callable[[Any], bool]

_TYPES: dict[str, tuple[type, ...]] = {
    "string": (str,),
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "array": (list,),
    "object": (dict,),
}
_SAY_NOTHING = frozenset(
    {
        "additionalProperties",
        ALONE,
        "default",
        "defaultSnippets",
        "description",
        "examples",
        "patternErrorMessage",
        LOADER,
        NOUN,
        PATH,
        POSITIVE,
        TOPIC_KEYS,
        UNLESS_LIVE,
    }
)


def judge_of(schema: dict[str, Any]) -> Judge:
    """A function that tells whether a value obeys the schema."""
    made: dict[int, Judge] = {}

    def build(part: dict[str, Any]) -> Judge:
        if id(part) not in made:
            made[id(part)] = _build(part, build)
        return made[id(part)]

    return build(schema)


def _build(schema: dict[str, Any], build: Callable[[dict[str, Any]], Judge]) -> Judge:
    strings = build(schema["items"]) if ALONE in schema else _strings(schema)
    arrays, objects = _arrays(schema, build), _objects(schema, build)
    by_type: dict[type, Judge] = {
        str: strings,
        list: arrays,
        dict: objects,
        int: _numbers(schema),
        float: _numbers(schema),
        bool: _always,
        type(None): _always,
    }
    if "const" in schema:
        return lambda value: type(value) is int and value == schema["const"]
    if KIND in schema:
        return lambda value: judge(value, schema) is None
    unknown = schema.keys() - _SAY_NOTHING - _KNOWN
    if unknown:
        raise AssertionError(f"no function for the keywords {sorted(unknown)}")
    types = schema.get("type")
    if types is not None:
        names = [types] if isinstance(types, str) else types
        allowed = {each for name in names for each in _TYPES[name]}
        by_type = {kind: check for kind, check in by_type.items() if kind in allowed}
    if by_type == {str: strings}:
        return lambda value: type(value) is str and strings(value)

    def judged(value: Any) -> bool:
        check = by_type.get(type(value))
        return check is not None and check(value)

    return judged


_KNOWN = frozenset(
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
        WORDS,
    }
)


def _always(_: Any) -> bool:
    return True


def _strings(schema: dict[str, Any]) -> Judge:
    words = schema.get("enum", schema.get(WORDS))
    if words is not None:
        return frozenset(words).__contains__
    if "pattern" in schema:
        search = re.compile(schema["pattern"]).search
        return lambda value: search(value) is not None
    least = schema.get("minLength", 0)
    return (lambda value: len(value) >= least) if least else _always


def _numbers(schema: dict[str, Any]) -> Judge:
    least, most = schema.get("minimum"), schema.get("maximum")
    if least is None and most is None:
        return _always
    return lambda value: (least is None or value >= least) and (most is None or value <= most)


def _arrays(schema: dict[str, Any], build: Callable[[dict[str, Any]], Judge]) -> Judge:
    least = schema.get("minItems", 0)
    item = build(schema["items"]) if "items" in schema else _always
    return lambda value: len(value) >= least and all(map(item, value))


def _objects(schema: dict[str, Any], build: Callable[[dict[str, Any]], Judge]) -> Judge:
    known = {key: build(part) for key, part in schema.get("properties", {}).items()}
    others = schema.get("additionalProperties", True)
    other = build(others) if isinstance(others, dict) else None
    names = build(schema["propertyNames"]) if "propertyNames" in schema else None
    required = tuple(schema.get("required", ()))
    least = schema.get("minProperties", 0)

    def judged(value: Any) -> bool:
        if len(value) < least or any(key not in value for key in required):
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

    return judged
