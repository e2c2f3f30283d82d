"""Promise: whatever a file contains, its reader returns a value or raises its own error.

Specs have theirs in tests/property/language, and recordings in tests/property/bags.
"""

from __future__ import annotations

import contextlib
import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hostile_calls import small_run
from hypothesis import given, settings
from hypothesis import strategies as st

from nightly import size
from r2bspec.compare.report_input import read_folder, read_report_input
from r2bspec.errors import R2bspecError
from r2bspec.judge.judge_run import result_of, to_json
from r2bspec.plan.wiring.parameter_files import read_parameter_file
from r2bspec.record.run_folder import open_run
from r2bspec.report.format_registry import renderer
from run_simulation import renew_digests

ATOMS = st.sampled_from(
    [None, True, -1, 0, 0.5, 2**31, 2**63 - 1, -(2**63), 2**64, 5e-324, 1e30, -1e300, "", "x"]
) | st.text(max_size=5)
VALUES = st.recursive(
    ATOMS,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=4,
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = small_run(tmp_path_factory.mktemp("runs") / "run")
    (folder / "result.json").write_bytes(to_json(result_of(open_run(folder))))
    return folder


@contextlib.contextmanager
def changed(file: Path, content: bytes) -> Iterator[None]:
    """Give a file another content while the block lasts."""
    before = file.read_bytes()
    file.write_bytes(content)
    try:
        yield
    finally:
        file.write_bytes(before)


def with_another_value(document: Any, data: st.DataObject) -> Any:
    """Replace one value anywhere in a document."""
    document = place = copy.deepcopy(document)
    while True:
        keys = sorted(place) if isinstance(place, dict) else list(range(len(place)))
        key = data.draw(st.sampled_from(keys))
        if not isinstance(place[key], dict | list) or not place[key] or data.draw(st.booleans()):
            place[key] = data.draw(VALUES)
            return document
        place = place[key]


def damaged(content: bytes, data: st.DataObject) -> bytes:
    """Replace a few bytes."""
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(content)))
        end = start + data.draw(st.integers(0, 12))
        content = content[:start] + data.draw(st.binary(max_size=12)) + content[end:]
    return content


@pytest.mark.parametrize("name", ["record.json", "plan.json", "result.json"])
@settings(max_examples=size(40, 1_000))
@given(data=st.data())
def test_a_document_of_a_run(run: Path, name: str, data: st.DataObject) -> None:
    document = with_another_value(json.loads((run / name).read_bytes()), data)
    with changed(run / name, json.dumps(document).encode()), contextlib.suppress(R2bspecError):
        read = read_report_input(run / name) if name == "result.json" else read_folder(run)
        for form in ("text", "json"):
            renderer(form)(read)


@settings(max_examples=size(40, 1_000))
@given(data=st.data())
def test_an_array_of_a_run(run: Path, data: st.DataObject) -> None:
    file = data.draw(st.sampled_from(sorted(run.rglob("*.npy"))))
    record = run / "record.json"
    with changed(record, record.read_bytes()), changed(file, damaged(file.read_bytes(), data)):
        renew_digests(run)
        with contextlib.suppress(R2bspecError):
            read_folder(run)


PARAMETERS = b"/**:\n  ros__parameters:\n    a: [1, 2]\n    b: {c: true, d: x}\n/n*: *a\n"


@settings(max_examples=size(100, 1_000))
@given(data=st.data())
def test_a_parameter_file(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.getbasetemp() / "parameters.yaml"
    file.write_bytes(damaged(PARAMETERS, data))
    read_parameter_file(file)
