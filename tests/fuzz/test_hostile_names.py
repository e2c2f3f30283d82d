"""Names that no file can have, and texts of a history that are none, are answered by every verb."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest
from test_hostile_bags import _history
from test_hostile_files import LONGEST_S, r2bspec

pytestmark = pytest.mark.timeout(4 * LONGEST_S)

LONG = "x" * 300
CALLS = {
    "judge": ["judge", LONG],
    "report": ["report", LONG],
    "compare": ["compare", LONG, LONG],
    "import": ["import", LONG],
    "info": ["data", "info", f"./{LONG}"],
    "verify": ["data", "verify", LONG],
    "history": ["history", "list", "--file", LONG],
    "validate": ["validate", LONG],
    "plan": ["plan", LONG],
    "run": ["run", f"{LONG}.json", "--output", "o"],
    "output": ["plan", "none.json", "-o", LONG],
}


@pytest.mark.parametrize("verb", CALLS)
def test_a_name_that_no_file_can_have_is_answered(verb: str, tmp_path: Path) -> None:
    status, said = r2bspec(*CALLS[verb], cwd=tmp_path)
    assert status in (1, 2), said
    assert "error" in said.lower()


def test_a_history_whose_texts_are_not_utf_8_is_answered(tmp_path: Path) -> None:
    file = tmp_path / "history.sqlite"
    _history(file)
    content = file.read_bytes()
    place = content.index(b"CREATE TABLE runs") + len(b"CREATE TABLE ru")
    file.write_bytes(content[:place] + b"\xff\xfe" + content[place + 2 :])
    status, said = r2bspec("history", "list", "--file", file, cwd=tmp_path)
    assert status in (2, 4), said
    assert "the history" in said


def test_long_texts_of_a_history_are_clipped(tmp_path: Path) -> None:
    file = tmp_path / "history.sqlite"
    _history(file)
    with sqlite3.connect(file) as database:
        row = ["x" * 1_000_000] * 9
        database.execute("INSERT INTO runs VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, 1, '')", row)
    database.close()
    status, said = r2bspec("history", "list", "--file", file, cwd=tmp_path)
    assert status == 0
    assert len(said) < 10_000
