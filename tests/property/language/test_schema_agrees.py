"""What `validate` accepts, the published schema accepts; what the text alone shows, it refuses."""

from __future__ import annotations

import copy
import json
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nightly import size
from r2bspec.language.document import Source
from r2bspec.language.json_schema import published_schema
from r2bspec.language.load_spec import load_spec
from r2bspec.language.located_tree import to_plain
from r2bspec.language.structure import INVALID, Violation, read_value
from r2bspec.language.yaml_document import compose

GOLDEN = Path(__file__).parents[2] / "golden" / "language"
ENVIRON = {"R2B_TEST_DATA": "/data", "R2B_TEST_COUNT": "7"}


def plain(name: str) -> Any:
    tree = load_spec(GOLDEN / name, environ=ENVIRON).tree
    assert tree is not None
    return to_plain(tree)


SOUND = [plain(f"ok_{name}.yaml") for name in ("minimal", "full", "everything", "live")]
ODD: st.SearchStrategy[Any] = st.sampled_from(
    [
        *(None, True, 0, -1, 3, 0.5, 1e9, [], {}, [[]], {"a": 1}, ["x"], {"x": {}}),
        *("", "x", "/a/b", "a b", "30 Hz", "0 Hz", "10 s", "-1 s", "peak", "default", "live"),
        *("sensor_data", "inherit", "sustained", "x < 1 s", {"profile": "default"}),
    ]
)


@cache
def validator() -> Any:
    return jsonschema.Draft7Validator(published_schema())


def violations(document: Any) -> list[Violation] | None:
    """What a document violates; None where it is read."""
    tree = compose(Source("document", json.dumps(document))).tree
    assert tree is not None
    spec, found = read_value(tree)
    assert (spec is INVALID) == bool(found)
    return list(found) or None


def is_for_schemas(violation: Violation) -> bool:
    """Return True if the published schema can find the violation.

    Which quantities are out of range, and what a requirement means, is said by the classes that
    parse them. In JSON, 1.0 is an integer. What is required unless the benchmark is live is not
    required by the published schema.
    """
    if violation.keyword in ("format", "anyOf"):
        return False
    if violation.keyword == "required":
        always = violation.rule.required_unless(live=True, calls=True)
        missing = set(always) - set(violation.value)
        return bool(missing) and "extends" not in violation.value
    return not isinstance(violation.value, float)


def agree(document: Any) -> None:
    found = violations(document)
    if found is None:
        assert validator().is_valid(document)
    elif any(is_for_schemas(violation) for violation in found):
        assert not validator().is_valid(document), [(each.path, each.keyword) for each in found]


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    found = [path]
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            found += places(inner, (*path, key))
    return found


@pytest.mark.parametrize("document", SOUND)
def test_sound_documents(document: Any) -> None:
    assert violations(document) is None
    assert validator().is_valid(document)


@settings(max_examples=size(100, 200))
@given(st.data())
def test_changed_documents(data: st.DataObject) -> None:
    document = copy.deepcopy(data.draw(st.sampled_from(SOUND)))
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(places(document)))
        if not path:
            continue
        owner = document
        for part in path[:-1]:
            owner = owner[part]
        change = data.draw(st.sampled_from(["replace", "remove", "rename"]))
        if change == "replace" or isinstance(owner, list):
            owner[path[-1]] = copy.deepcopy(data.draw(ODD))
        else:
            value = owner.pop(path[-1])
            if change == "rename":
                owner[data.draw(st.sampled_from(["x", "a-b", "1", "é", "", "/t"]))] = value
    agree(document)


@pytest.mark.parametrize("file", sorted(GOLDEN.glob("*.yaml")), ids=lambda file: file.stem)
def test_broken_documents(file: Path) -> None:
    tree = load_spec(file, environ=ENVIRON).tree
    document = to_plain(tree) if tree is not None else None
    if isinstance(document, dict) and "$(" not in json.dumps(document):
        agree(document)
