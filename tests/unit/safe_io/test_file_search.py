"""Promise: a pattern finds the files that the shell finds, and its search ends."""

from __future__ import annotations

import glob
import os
import sys
from pathlib import Path
from typing import Any

import pytest

from r2bspec.safe_io.file_search import matching_files, regular_files, walk
from r2bspec.safe_io.private_files import remove_folder

FILES = ["a.yaml", "x/a.yaml", "x/y/a.yaml", "x/y/b.txt", ".h/a.yaml", "x/.h/a.yaml", "[q]/a.yaml"]
PATTERNS = [
    "*.yaml",
    "**/*.yaml",
    "**",
    "x/**",
    "**/y/*",
    "*/*/a.yaml",
    "x/../*/a.yaml",
    ".h/*",
    "**/.h/*",
    "**/**/?.txt",
    "[[]q]/*",
    "./*.yaml",
    "no/**",
]


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("absolute", [False, True])
def test_a_pattern_finds_what_the_shell_finds(
    pattern: str, absolute: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    asked = str(tmp_path / pattern) if absolute else pattern
    expected = {Path(name) for name in glob.glob(asked, recursive=True) if Path(name).is_file()}  # noqa: PTH207
    assert {Path(name) for name in matching_files(asked)} == expected


def test_a_search_is_not_led_in_a_circle_and_takes_nothing_but_files(tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "up").symlink_to("..")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "x" / "a.yaml").touch()
    assert matching_files(f"{tmp_path}/**") == [f"{tmp_path}/x/a.yaml"]
    assert matching_files(f"{tmp_path}/*/*/*/*.yaml") == [f"{tmp_path}/x/up/x/a.yaml"]


def test_folders_are_walked_as_by_the_standard_library(tmp_path: Path) -> None:
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "x" / "up").symlink_to(tmp_path)
    (tmp_path / "x" / "loop").symlink_to("loop")
    (tmp_path / "x" / "linked.yaml").symlink_to("a.yaml")
    os.mkfifo(tmp_path / "pipe")

    def ordered(walked: Any) -> list[tuple[str, list[str], list[str]]]:
        return sorted((str(at), sorted(folders), sorted(files)) for at, folders, files in walked)

    assert ordered(walk(tmp_path)) == ordered(os.walk(tmp_path))
    expected = {path for path in tmp_path.rglob("*") if path.is_file()}
    assert set(regular_files(tmp_path)) == expected
    assert list(walk(tmp_path / "no")) == [(tmp_path / "no", [], [])]
    for parent, folders, _ in walk(tmp_path):
        assert "y" not in parent.parts
        folders[:] = [name for name in folders if name != "y"]


def test_folders_are_walked_as_far_as_paths_lead(tmp_path: Path) -> None:
    """Deeper than functions are called, and than a path may be long."""
    descriptor = os.open(tmp_path, os.O_RDONLY)
    for _ in range(200):
        os.mkdir(30 * "d", dir_fd=descriptor)
        os.close(os.open("f", os.O_CREAT, dir_fd=descriptor))
        below = os.open(30 * "d", os.O_RDONLY, dir_fd=descriptor)
        os.close(descriptor)
        descriptor = below
    os.close(descriptor)
    whole = sys.getrecursionlimit()
    sys.setrecursionlimit(100)
    try:
        files = list(regular_files(tmp_path))
    finally:
        sys.setrecursionlimit(whole)
        remove_folder(tmp_path)
    longest = 4095 - len(str(tmp_path)) - len("/f")
    assert len(files) == longest // 31 + 1
