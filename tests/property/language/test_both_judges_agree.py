"""The quick judge of documents and jsonschema always say the same."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.language.load_spec import load_spec
from r2bspec.language.located_tree import to_plain
from r2bspec.language.schema_validator import is_valid, schema_errors

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


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    found = [path]
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            found += places(inner, (*path, key))
    return found


@pytest.mark.parametrize("document", SOUND)
def test_sound_documents(document: Any) -> None:
    assert is_valid(document)
    assert not list(schema_errors(document))


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
            owner[path[-1]] = data.draw(ODD)
        else:
            value = owner.pop(path[-1])
            if change == "rename":
                owner[data.draw(st.sampled_from(["x", "a-b", "1", "é", "", "/t"]))] = value
    assert is_valid(document) == (not list(schema_errors(document)))


@pytest.mark.parametrize("file", sorted(GOLDEN.glob("*.yaml")), ids=lambda file: file.stem)
def test_broken_documents(file: Path) -> None:
    tree = load_spec(file, environ=ENVIRON).tree
    document = to_plain(tree) if tree is not None else None
    assert is_valid(document) == (not list(schema_errors(document)))
