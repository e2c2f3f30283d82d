"""Launch files of tests, and the specs that are made from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from r2bspec.api import load, validate
from r2bspec.cli.main import main

FOLDER = Path(__file__).parents[1] / "unit" / "authoring" / "launch_files"


def stored(name: str) -> str:
    """A launch file of the folder; one in Python has a suffix more, as it is no code of tests."""
    file = FOLDER / (f"{name}.txt" if name.endswith(".py") else name)
    return file.read_text(encoding="utf-8")


def made(name: str, content: str, *arguments: str) -> tuple[Any, str]:
    """The spec of a launch file, of which only parameter files may be missing, and its text."""
    Path(name).write_text(content)
    assert main(["init", "made", "--from-launch", name, *arguments]) == 0
    file = Path("made.r2b.yaml")
    errors = {each.code for each in validate(file) if each.severity == "error"}
    assert errors <= {"R2B614"}
    return load(file), file.read_text()
