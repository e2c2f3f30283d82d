"""Promise: every Python that r2bspec starts leaves the current folder out of where it imports."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

from command_line import Call
from example_spec import example

PACKAGE = Path(__file__).parents[3] / "r2bspec"


def command_words() -> list[tuple[str, list[object]]]:
    """Every list or tuple of words in the package in which a module is executed by its name."""
    found = []
    for file in sorted(PACKAGE.rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        # Parsing all of the package takes most of the time.
        tree = ast.parse(text if '"-m"' in text or '"-c"' in text else "")
        for each in ast.walk(tree):
            if isinstance(each, ast.List | ast.Tuple):
                words = [getattr(elt, "value", None) for elt in each.elts]
                if "-m" in words or "-c" in words:
                    found.append((f"{file.relative_to(PACKAGE)}:{each.lineno}", words))
    return found


def test_every_command_line_has_the_option() -> None:
    found = command_words()
    assert len(found) >= 5
    # `bash -c` of a setup file, and not of Python.
    python = [(place, words) for place, words in found if "-m" in words and len(words) > 1]
    assert [place for place, words in python if words[words.index("-m") - 1] != "-P"] == []


def test_validate_with_several_processes_imports_nothing_from_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    for name in sys.stdlib_module_names:
        (tmp_path / f"{name}.py").write_text("raise SystemExit('the module of a stranger')\n")
    for number in range(110):
        (tmp_path / f"{number}.r2b.yaml").write_text(example(), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
    assert "110 files" in call("validate", "--offline", ".", status=0).out
