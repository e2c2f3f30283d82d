"""docs/language.md says what the schema says, and its examples are true."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from r2bspec.language.json_schema import with_tables
from r2bspec.language.load_spec import load_spec

PAGE = Path(__file__).parents[3] / "docs" / "language.md"
TEXT = PAGE.read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```yaml\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)
ROWS = re.findall(r"^\| [^|]+ \| ([\d–]+) \| [^|]+ \| `(.+)` \|$", TEXT, re.MULTILINE)
ENVIRON = {"HOME": "/home/someone", "CAMERA_PASSWORD": "very-secret"}


def test_the_tables_are_those_of_the_schema() -> None:
    made = with_tables(TEXT)
    if os.environ.get("R2BSPEC_REWRITE"):
        PAGE.write_text(made, encoding="utf-8")
    assert made == PAGE.read_text(encoding="utf-8"), "run this test with R2BSPEC_REWRITE=1"


def test_every_map_of_the_language_has_its_table() -> None:
    shown = set(re.findall(r"^<!-- keys of (\S+) -->$", TEXT, re.MULTILINE))
    assert len(shown) > 20
    for key in ("spec", "data_loader", "graph.nodes.<name>", "playback", "benchmark"):
        assert key in shown


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda text: text[:30])
def test_examples(example: str) -> None:
    found = load_spec(example, environ=ENVIRON).diagnostics
    codes = {one.code for one in found}
    # Parts of specs lack other parts; nothing else may be wrong with them.
    assert codes <= (set() if "r2bspec: 1" in example else {"R2B102"}), found


def test_every_counted_construct_has_a_row() -> None:
    assert len(ROWS) > 40


@pytest.mark.parametrize(("count", "example"), ROWS)
def test_what_public_scripts_use_can_be_written(count: str, example: str) -> None:
    found = load_spec(example, environ=ENVIRON).diagnostics
    assert {one.code for one in found} <= {"R2B102"}, (count, found)
