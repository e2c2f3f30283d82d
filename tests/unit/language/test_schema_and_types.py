"""What follows from the declarations: rules, defaults, the schema for editors, and new keys."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pytest

from r2bspec.diagnostics import Path as TreePath
from r2bspec.language.declaration import Record, ValueRule, language, rule_at
from r2bspec.language.document import Source
from r2bspec.language.json_schema import published_schema
from r2bspec.language.load_spec import load_spec
from r2bspec.language.located_tree import TreeNode, to_plain
from r2bspec.language.quantities import Duration
from r2bspec.language.structure import INVALID, read_value
from r2bspec.language.yaml_document import compose

# What follows from the declarations: rules, defaults, and the schema for editors.


ROOT = Path(__file__).parents[3]
GOLDEN = ROOT / "tests" / "golden" / "language"


def rules(rule: ValueRule, path: TreePath = ()) -> Iterator[tuple[TreePath, ValueRule]]:
    """Every rule of the language."""
    yield path, rule
    for key, below in (rule.keys or {}).items():
        yield from rules(below, (*path, key))
    for step, inner in (("*", rule.values), (0, rule.items)):
        if inner is not None:
            yield from rules(inner, (*path, step))


ALL = list(rules(language()))
RECORDS = [(path, rule) for path, rule in ALL if rule.record is not None]


def located(value: object) -> TreeNode:
    """A plain value as a tree."""
    tree = compose(Source("example", json.dumps(value))).tree
    assert tree is not None
    return tree


def test_every_field_is_a_key_or_made_of_keys() -> None:
    for path, rule in RECORDS:
        assert rule.keys is not None
        assert rule.record is not None
        written = {key.field for key in rule.keys.values() if not key.loader}
        assert written <= set(rule.record.__struct_fields__), path
        made = set(rule.record.__struct_fields__) - written
        assert made <= {"parameter_sources", "at_peak"}, path


def test_an_example_of_every_value_is_read() -> None:
    for path, rule in ALL:
        assert rule.about.examples or not path or path[-1] == "type", path
        for example in rule.about.examples:
            value, violations = read_value(located(example), rule)
            assert not violations, (path, example)
            assert value is not INVALID


def test_shown_defaults_are_those_of_the_fields() -> None:
    for path, rule in ALL:
        if rule.owner is None or rule.is_required or rule.loader:
            continue
        if rule.shown_default is None:
            assert not rule.default or rule.about.hidden_default or rule.about.unless_live, path
        else:
            value, _ = read_value(located(rule.shown_default), rule)
            made = rule.owner.from_keys({**_required(rule.owner), rule.field: value})
            assert getattr(made, rule.field, value) == rule.default, path


def _required(record: type[Record]) -> dict[str, Any]:
    fields = msgspec.structs.fields(record)
    return {field.name: None for field in fields if field.required}


def test_everything_is_described() -> None:
    for path, rule in ALL:
        assert len(rule.description) > 5, path
    for path, rule in _with_paths(published_schema()):
        for example in rule["examples"]:
            assert not list(jsonschema.Draft7Validator(rule).iter_errors(example)), path


def _with_paths(schema: Any, path: TreePath = ()) -> Iterator[tuple[TreePath, Any]]:
    yield path, schema
    for key, below in schema.get("properties", {}).items():
        yield from _with_paths(below, (*path, key))
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            yield from _with_paths(schema[key], (*path, key))


def test_substitution_in_keys_is_for_topics() -> None:
    maps = {path[-1] for path, rule in ALL if rule.about.topics}
    assert maps == {
        *("topics", "inputs", "translations"),
        *("remappings", "publishes", "subscribes", "qos"),
    }


def test_what_a_key_changes_is_said_for_every_section() -> None:
    assert {key for key, rule in (language().keys or {}).items() if not rule.about.changes} == set()


def test_a_section_says_it_for_its_keys() -> None:
    assert rule_at(("benchmark", "duration")) is not None
    with_examples = rule_at(("setup", "model", "timeout"))
    assert with_examples is not None
    assert with_examples.default == Duration(600 * 10**9)
    assert with_examples.shown_default == "10 min"


# ---- the schema for editors ------------------------------------------------------------------


def test_references_are_accepted_wherever_a_scalar_stands() -> None:
    loaded = load_spec(GOLDEN / "ok_full.yaml", environ={})
    assert loaded.tree is not None
    validator = jsonschema.Draft7Validator(published_schema())
    document = to_plain(loaded.tree)
    for reference in ("$(var x)", "$(env X)"):
        changed = _with_scalars(document, reference) | {"r2bspec": 1}
        assert [error.path for error in validator.iter_errors(changed)] == []


def _with_scalars(value: Any, text: str) -> Any:
    """The value with a text in place of every scalar."""
    if isinstance(value, dict):
        return {key: _with_scalars(inner, text) for key, inner in value.items()}
    return [_with_scalars(inner, text) for inner in value] if isinstance(value, list) else text


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
    for _, schema in _with_paths(published_schema()):
        kinds = schema.get("type")
        if isinstance(kinds, list):
            assert kinds[0] != "null"
            assert kinds.count("null") <= 1


# The kinds of node are listed once.
