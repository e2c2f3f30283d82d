"""Promise: a pattern finds the files that the shell finds, and its search ends."""

from __future__ import annotations

import glob
from pathlib import Path

import pytest

from r2bspec.safe_io.file_search import matching_files

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
