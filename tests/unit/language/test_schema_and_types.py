"""The schema and the typed values describe the same language."""

from __future__ import annotations

import json
import re
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import jsonschema
import msgspec
import pytest

from r2bspec.diagnostics import Path as TreePath
from r2bspec.language.load_spec import load_spec
from r2bspec.language.located_tree import to_plain
from r2bspec.language.quantities import Quantity
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.language.schema.derive_strict import (
    published_schema,
    published_schema_text,
    strict_schema,
)
from r2bspec.language.schema.document_root import DOCUMENT
from r2bspec.language.schema.schema_builder import (
    ALLOWED_WORDS,
    KIND,
    LOADER_ONLY,
    QUANTITIES,
    TOPIC_KEYS,
    Schema,
)
from r2bspec.language.spec import DERIVED_FIELDS, BagSource, Harness, QoS, Spec
from r2bspec.language.value_codec import decode

ROOT = Path(__file__).parents[3]
GOLDEN = ROOT / "tests" / "golden" / "language"


def pairs(schema: Schema, kind: Any, path: TreePath = ()) -> Iterator[tuple[TreePath, Schema, Any]]:
    """Every part of the schema with the type that reads it."""
    kind = _without_none(kind)
    yield path, schema, kind
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        for field in written_fields(kind):
            inner = schema["properties"][field.encode_name]
            yield from pairs(inner, field.type, (*path, field.encode_name))
    elif get_origin(kind) is dict:
        yield from pairs(schema["additionalProperties"], get_args(kind)[1], (*path, "*"))
    elif get_origin(kind) is tuple:
        yield from pairs(schema["items"], get_args(kind)[0], (*path, 0))


def written_fields(kind: type[msgspec.Struct]) -> list[msgspec.structs.FieldInfo]:
    """The fields of a type that a document has."""
    made = DERIVED_FIELDS.get(kind.__name__, ())
    return [field for field in msgspec.structs.fields(kind) if field.name not in made]


def _without_none(kind: Any) -> Any:
    if get_origin(kind) in (typing.Union, types.UnionType):
        left = [each for each in get_args(kind) if each is not types.NoneType]
        return left[0] if len(left) == 1 else kind
    return kind


ALL = list(pairs(DOCUMENT, Spec))


def kind_of(field: msgspec.structs.FieldInfo) -> Any:
    """The type of a field, without the None that an optional one may be."""
    return _without_none(field.type)


RECORDS = [(p, s, k) for p, s, k in ALL if isinstance(k, type) and issubclass(k, msgspec.Struct)]


@pytest.mark.parametrize(("path", "schema", "kind"), RECORDS, ids=lambda value: str(value)[:40])
def test_maps_of_known_keys(path: TreePath, schema: Schema, kind: type[msgspec.Struct]) -> None:
    fields = written_fields(kind)
    kept = [key for key, each in schema["properties"].items() if LOADER_ONLY not in each]
    assert kept == [field.encode_name for field in fields], "same order, too"
    assert schema["additionalProperties"] is False
    required = {field.encode_name for field in fields if field.required}
    assert set(schema.get("required", ())) == required


def test_what_the_loader_makes_is_no_key_of_the_language() -> None:
    for path, schema, kind in RECORDS:
        for name in DERIVED_FIELDS.get(kind.__name__, ()):
            assert name in kind.__struct_fields__
            assert name not in schema["properties"], path


@pytest.mark.parametrize(("path", "schema", "kind"), RECORDS, ids=lambda value: str(value)[:40])
def test_defaults_are_those_of_the_types(
    path: TreePath, schema: Schema, kind: type[msgspec.Struct]
) -> None:
    for field in written_fields(kind):
        inner = schema["properties"][field.encode_name]
        if field.required:
            assert "default" not in inner, field.name
            continue
        default = field.default
        if default is msgspec.NODEFAULT and field.default_factory is not msgspec.NODEFAULT:
            default = field.default_factory()
        if "default" in inner:
            read = msgspec.convert(inner["default"], field.type, dec_hook=decode)
            assert read == default, field.name
        else:
            assert not default or default == kind_of(field)(), (
                f"{path}.{field.name} has a default that the schema hides"
            )


def test_kinds_of_values() -> None:
    words = {str: "string", int: "integer", bool: "boolean", dict: "object", tuple: "array"}
    for path, schema, kind in ALL:
        origin = get_origin(kind) or kind
        if origin is Literal:
            known = schema.get("enum") or schema.get(ALLOWED_WORDS) or [schema.get("const")]
            assert known == list(get_args(kind)), path
        elif schema.get("type") == ["string", "object"]:
            assert kind in (BagSource, QoS, Harness), path
        elif isinstance(kind, type) and issubclass(kind, Quantity):
            assert QUANTITIES[schema[KIND]] is kind, path
        elif kind is Requirement:
            assert schema[KIND] == "requirement", path
        elif kind is Any:
            assert "type" not in schema, path
        elif origin in words:
            assert words[origin] in schema["type"], path
        elif isinstance(kind, type):
            assert schema["type"] == "object", path
        else:
            assert set(schema["type"]) >= {"string", "number", "boolean"}, path


def test_everything_is_described_with_an_example_that_holds() -> None:
    for path, schema, _ in pairs(published_schema(), Spec):
        assert len(schema["description"]) > 10, path
        assert schema["examples"] or not path, path
        for example in schema["examples"]:
            assert not list(jsonschema.Draft7Validator(schema).iter_errors(example)), path


def test_substitution_in_keys_is_for_topics() -> None:
    maps = {path[-1] for path, schema, _ in ALL if TOPIC_KEYS in schema}
    assert maps == {
        *("topics", "inputs", "translations"),
        *("remappings", "publishes", "subscribes", "qos"),
    }


# ---- the schemas that are made of it ---------------------------------------------------------


def test_both_are_draft_07() -> None:
    jsonschema.Draft7Validator.check_schema(published_schema())
    jsonschema.Draft7Validator.check_schema(strict_schema())


def test_nothing_private_is_published() -> None:
    text = published_schema_text()
    assert "r2b-" not in re.sub(r"r2b-(?=v1)", "", text)
    assert "oneOf" not in text


@pytest.mark.parametrize("name", ["ok_minimal", "ok_full"])
def test_editors_accept_what_the_loader_accepts(name: str) -> None:
    import yaml

    document = yaml.safe_load((GOLDEN / f"{name}.yaml").read_text())
    # PyYAML reads YAML 1.1: `on` as a key. Editors do not.
    document = json.loads(json.dumps(document).replace('"true": true', '"on": true'))
    assert not list(jsonschema.Draft7Validator(published_schema()).iter_errors(document))


def test_references_are_accepted_wherever_a_scalar_stands() -> None:
    loaded = load_spec(GOLDEN / "ok_full.yaml", environ={})
    assert loaded.tree is not None
    validator = jsonschema.Draft7Validator(published_schema())
    document = to_plain(loaded.tree)
    for path in _scalars(document):
        if path == ("r2bspec",):
            continue
        for reference in ("$(var x)", "$(env X)"):
            changed = json.loads(json.dumps(document))
            place = changed
            for part in path[:-1]:
                place = place[part]
            place[path[-1]] = reference
            assert not list(validator.iter_errors(changed)), path


def _scalars(value: Any, path: TreePath = ()) -> Iterator[TreePath]:
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in items:
        if isinstance(inner, dict | list):
            yield from _scalars(inner, (*path, key))
        else:
            yield (*path, key)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("benchmark", "duration"), 10),
        (("benchmark", "duration"), "10"),
        (("benchmark", "rates", 0), "10 s"),
        (("benchmark", "iterations"), "3"),
        (("benchmark", "iterations"), 0),
        (("benchmark", "typo"), 1),
        (("playback", "mode"), "loop"),
        (("monitors", "my-monitor"), {"topic": "a", "format": "a/msg/B"}),
        (("slos", "peak", "require", 0), "latency below 5 ms"),
        (("graph", "nodes", "detector", "remappings"), {"a b": "c"}),
    ],
)
def test_editors_see_what_the_loader_refuses(path: TreePath, value: object) -> None:
    document = to_plain(load_spec(GOLDEN / "ok_full.yaml", environ={}).tree)  # type: ignore[arg-type]
    place = document
    for part in path[:-1]:
        place = place[part]
    place[path[-1]] = value
    assert list(jsonschema.Draft7Validator(published_schema()).iter_errors(document))


BASE = ("extends",)
NODE = ("graph", "nodes", "detector")


@pytest.mark.parametrize(
    ("extending", "path", "accepted"),
    [
        (BASE, ("title",), True),
        (BASE, ("playback",), True),
        (BASE, ("playback", "mode"), True),
        (BASE, ("slos", "peak"), True),
        (BASE, (*NODE, "remappings"), True),
        (BASE, (*NODE, "remappings", "image"), True),
        (BASE, ("benchmark", "rates", 0), False),
        (BASE, ("r2bspec",), False),
        ((*NODE, "extends"), (*NODE, "remappings", "image"), True),
        ((*NODE, "extends"), (*NODE, "parameters"), True),
        ((*NODE, "extends"), ("title",), False),
        ((*NODE, "extends"), ("graph", "nodes", "other"), False),
        (None, ("title",), False),
        (None, ("playback", "mode"), False),
        (None, (*NODE, "remappings", "image"), False),
    ],
)
def test_editors_accept_null_where_it_removes_something(
    extending: TreePath | None, path: TreePath, accepted: bool
) -> None:
    document = to_plain(load_spec(GOLDEN / "ok_full.yaml", environ={}).tree)  # type: ignore[arg-type]
    if extending is not None:
        _put(document, extending, "base")
    validator = jsonschema.Draft7Validator(published_schema())
    assert not list(validator.iter_errors(document))
    _put(document, path, None)
    assert (not list(validator.iter_errors(document))) is accepted


def _put(document: Any, path: TreePath, value: object) -> None:
    place = document
    for part in path[:-1]:
        place = place.setdefault(part, {}) if isinstance(place, dict) else place[part]
    place[path[-1]] = value


def test_the_kind_that_is_meant_stands_before_null() -> None:
    """Editors insert by the first one."""
    for _, schema, _ in pairs(published_schema(), Spec):
        kinds = schema.get("type")
        if isinstance(kinds, list):
            assert kinds[0] != "null"
            assert kinds.count("null") <= 1
