"""Names that no file can have, and texts of a history that are none, are answered by every verb."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hostile_calls import INSERT_RUN, LONGEST_S, answered, call, change_database, make_history

from r2bspec.diagnostics.plain_text import message_text

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


FORGED = "a\nerror[R2B999]: forged\n::error::x \x1b[31m\u202e"
"""Line breaks, a command of a workflow, a colour and a mark that turns a text around."""
_WRITTEN = {".r2b.yaml": "r2bspec: 1\n", ".json": "{", ".py": "x=", ".db3": "x"}
_VERBS = ("validate", "plan", "run", "judge", "report", "import", "interfaces", "calibrate")


def forged_names(folder: Path) -> Iterator[str]:
    """Files and folders that are no valid input of any verb, and what does not exist."""
    for suffix, content in _WRITTEN.items():
        (folder / f"{FORGED}{suffix}").write_text(content)
        yield f"{FORGED}{suffix}"
    (folder / f"{FORGED} bag").mkdir()
    (folder / f"{FORGED} bag" / "metadata.yaml").write_text("x")
    yield from (f"{FORGED} bag", f"{FORGED} none")


def forged_calls(names: list[str]) -> Iterator[tuple[str, ...]]:
    """Calls of every verb that names a path or takes a word."""
    yaml, report, script, database, bag, none = names
    yield from ((verb, name) for verb in _VERBS for name in names)
    yield from (("validate", "--format", each, yaml) for each in ("github", "gitlab", "junit"))
    yield ("compare", bag, none)
    yield ("compare", report, report)
    yield ("suggest", bag)
    yield ("history", "list", "--file", database)
    yield ("history", "list", "--file", none)
    yield from (("data", verb, name) for verb in ("info", "verify") for name in (bag, none))
    yield ("data", "create", none)
    yield ("init", f"{none}/x.r2b.yaml")
    yield ("init", f"{FORGED} new.r2b.yaml")
    yield ("init", "--from-launch", script)
    yield ("init", "--from-bag", bag)
    yield ("fleet", "status", "--fleet", report)
    yield ("plan", yaml, "-o", f"{none}/x")
    yield ("judge", bag, "--slos", report)
    yield ("report", report, "--report", f"html={none}")
    yield from ((verb, none) for verb in ("explain", "docs", "schema", "completion", "doctor"))
    yield (none,)


def test_no_name_makes_a_line_of_its_own(tmp_path: Path) -> None:
    """Whatever a file is called, no line of the output is one that its author has written."""
    names = list(forged_names(tmp_path))
    for words in forged_calls(names):
        answer = call(*words, cwd=tmp_path)
        said = answer.said.decode()
        assert answer.status in (0, 1, 2, 3, 4), said
        forged = re.findall(r"(?m)^(?:error\[R2B999\]|::error::x).*", said)
        assert not forged, (words, said)
        assert not {"\x1b", "\u202e"} & set(said), (words, said)


def test_details_of_a_message_are_below_it() -> None:
    assert message_text("it ended; its last output:\nerror: x\n  y") == (
        "it ended; its last output:\n  error: x\n  y"
    )
    assert message_text("no messages\n  /a: 0\n/b: 1") == "no messages\n  /a: 0\n  /b: 1"
    assert message_text("a\nb cannot be read") == "a\ufffdb cannot be read"
