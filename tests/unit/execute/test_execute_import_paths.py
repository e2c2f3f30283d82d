"""Promise: every Python that r2bspec starts leaves the current folder out of where it imports."""

from __future__ import annotations

import ast
from pathlib import Path

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
