"""Files, JSON and YAML from outside: only regular ones, within limits."""

from __future__ import annotations

import ast
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from r2bspec.safe_io import limits
from r2bspec.safe_io.safe_file import (
    OutsideFolderError,
    RefusedFileError,
    TooLargeError,
    open_regular,
    read_bytes,
    read_text,
)
from r2bspec.safe_io.safe_json import decode_json
from r2bspec.safe_io.safe_yaml import RefusedYamlError, load_texts, load_values

# Files from outside: only regular ones, from allowed folders, up to a size.


def test_a_regular_file_is_read_up_to_the_limit(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_bytes(b"x" * 10)
    assert read_bytes(file, max_bytes=10) == b"x" * 10
    with pytest.raises(TooLargeError, match="larger than 9 bytes"):
        read_bytes(file, max_bytes=9)


def test_a_sparse_file_is_refused_before_it_fills_memory(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    os.truncate(tmp_path / "a", 10**12)
    with pytest.raises(TooLargeError):
        read_bytes(tmp_path / "a", max_bytes=1000)


@pytest.mark.parametrize(
    ("file", "error", "words"),
    [
        ("/dev/zero", RefusedFileError, "device"),
        ("/dev/ptmx", RefusedFileError, "device"),
        ("/proc/self/environ", OutsideFolderError, "kernel"),
        ("/proc/version", OutsideFolderError, "kernel"),
    ],
)
def test_devices_and_files_of_the_kernel_are_refused_also_through_a_link(
    file: str, error: type[OSError], words: str, tmp_path: Path
) -> None:
    (tmp_path / "link").symlink_to(file)
    for path in (Path(file), tmp_path / "link"):
        with pytest.raises(error, match=words):
            open_regular(path)


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        (".", RefusedFileError, "folder"),
        # Nobody writes to it: whoever opens it waits.
        ("pipe", RefusedFileError, "pipe"),
        ("a\0b", RefusedFileError, "NUL"),
        ("none", FileNotFoundError, "none"),
        ("x" * 300, OSError, "name too long"),
        ("itself", OSError, "symbolic links"),
    ],
)
def test_what_is_no_regular_file_is_an_error_at_once(
    name: str, error: type[OSError], words: str, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "itself").symlink_to(tmp_path / "itself")
    with pytest.raises(error, match=words):
        open_regular(tmp_path / name)


def test_links_are_followed_inside_of_the_allowed_folders_only(tmp_path: Path) -> None:
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    (inside / "below").mkdir(parents=True)
    outside.mkdir()
    (inside / "below/a").write_text("a", encoding="utf-8")
    (outside / "secret").write_text("s", encoding="utf-8")
    (inside / "near").symlink_to("below/a")
    (inside / "far").symlink_to("../outside/secret")
    (inside / "folder").symlink_to("../outside")
    assert read_text(inside / "near", max_bytes=9, folders=(inside,)) == "a"
    for name in ("far", "folder/secret", "../outside/secret"):
        with pytest.raises(OutsideFolderError) as refused:
            read_text(inside / name, max_bytes=9, folders=(inside,))
        assert "secret" not in str(refused.value)
        assert read_text(inside / name, max_bytes=9, folders=(inside, outside)) == "s"
        assert read_text(inside / name, max_bytes=9) == "s"


def test_text_that_is_not_utf8_is_named_by_its_line_and_not_quoted(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"one\ntoken=\xff\n")
    with pytest.raises(RefusedFileError) as refused:
        read_text(tmp_path / "a", max_bytes=99)
    assert str(refused.value) == "it is not UTF-8 (line 2)"


# JSON from outside: every problem is one kind of error.


@pytest.mark.parametrize(
    "text",
    [b'{"a":' * 100_000, b"[" * 100_000, b'{"a": "\xff"}', b"{", b"", b"9" * 5000 + b"x"],
)
def test_what_is_not_json_or_too_deep_is_one_kind_of_error(text: bytes) -> None:
    with pytest.raises(msgspec.DecodeError):
        decode_json(text, Any)


# YAML that is not a spec: limits on depth, aliases, merge keys and numbers.


def _nested_merges(levels: int) -> str:
    first = "m0: &m0 {" + ", ".join(f"k{i}: 1" for i in range(10)) + "}\n"
    rest = (
        f"m{i}: &m{i} {{<<: [{', '.join([f'*m{i - 1}'] * 10)}]}}\n" for i in range(1, levels + 1)
    )
    return first + "".join(rest)


def test_values_are_those_of_ros() -> None:
    text = "a: &a {b: yes, n: 0x10, f: 1e3, t: '1', s: 1:59:59}\nc: {<<: *a, d: [1, 2.5, ~]}\n"
    found = load_values(text)
    assert found["a"] == {"b": True, "n": 16, "f": "1e3", "t": "1", "s": 7199}
    assert found["c"] == {**found["a"], "d": [1, 2.5, None]}
    assert load_texts("a: on\nb: 010\n") == {"a": "on", "b": "010"}


@pytest.mark.parametrize("load", [load_values, load_texts])
@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("- " * 40_000 + "a", "line 1: values are nested more than 100 levels deep"),
        ("[" * 40_000, "line 1: values are nested more than 100 levels deep"),
        (_nested_merges(8), "line 5: aliases expand to more than 200,000 values"),
        ("a: &a [1, *a]", "line 1: an alias refers to a value that contains it"),
        ("a:\n" + "- 1\n" * 50_000, "line 49999: there are more than 50,000 values"),
    ],
)
def test_what_exceeds_a_limit_is_refused_with_its_line(
    load: Callable[..., object], text: str, reason: str
) -> None:
    with pytest.raises(RefusedYamlError) as refused:
        load(text, max_values=50_000)
    assert str(refused.value) == reason


@pytest.mark.parametrize(
    "text",
    [
        "a: 2024-99-99",
        "{[]: 1}",
        "a: [",
        "a: *none",
        f"a: {'9' * 5000}",
        "a: !!python/name:os.system",
        "\0",
    ],
)
def test_everything_else_is_an_error_of_yaml(text: str) -> None:
    with pytest.raises(yaml.YAMLError):
        load_values(text)


# Promise: every limit on what is read is in one table, with its reason, and is used.


def test_every_limit_has_a_reason_and_a_reader() -> None:
    file = Path(limits.__file__)
    table = ast.parse(file.read_text()).body
    rows = [row for row in table if isinstance(row, ast.AnnAssign)]
    for row in rows:
        reason = table[table.index(row) + 1]
        assert isinstance(reason, ast.Expr), ast.unparse(row)
    texts = (each.read_text() for each in file.parents[1].rglob("*.py") if each != file)
    used = set[str]().union(*(re.findall(r"\w+", text) for text in texts))
    assert {ast.unparse(row.target) for row in rows} <= used
