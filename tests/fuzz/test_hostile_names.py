"""Names that no file can have, and texts of a history that are none, are answered by every verb."""

from __future__ import annotations

from pathlib import Path

import pytest
from hostile_calls import INSERT_RUN, LONGEST_S, answered, change_database, make_history

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
    assert "error" in answered(*CALLS[verb], cwd=tmp_path, status=(1, 2)).lower()


def test_a_history_whose_texts_are_not_utf_8_is_answered(tmp_path: Path) -> None:
    file = make_history(tmp_path)
    content = file.read_bytes()
    place = content.index(b"CREATE TABLE runs") + len(b"CREATE TABLE ru")
    file.write_bytes(content[:place] + b"\xff\xfe" + content[place + 2 :])
    calls = ("history", "list", "--file", file)
    answered(*calls, cwd=tmp_path, status=(2, 4), says="the history")


def test_long_texts_of_a_history_are_clipped(tmp_path: Path) -> None:
    file = make_history(tmp_path)
    change_database(file, INSERT_RUN, *["x" * 1_000_000] * 9)
    assert len(answered("history", "list", "--file", file, cwd=tmp_path, status=0)) < 10_000
