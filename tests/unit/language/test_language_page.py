"""docs/language.md has every map of the language, its examples are true, and public scripts fit."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from r2bspec.language.load_spec import load_spec

PAGE = Path(__file__).parents[3] / "docs" / "language.md"
TEXT = PAGE.read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```yaml\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)
CONSTRUCTS = yaml.safe_load(
    Path(__file__).with_name("public_constructs.yaml").read_text(encoding="utf-8")
)
ENVIRON = {"HOME": "/home/someone", "CAMERA_PASSWORD": "very-secret"}


def test_every_map_of_the_language_has_its_table() -> None:
    shown = set(re.findall(r"^<!-- keys of (\S+) -->$", TEXT, re.MULTILINE))
    assert len(shown) > 20
    for key in ("spec", "data_loader", "graph.nodes.<name>", "playback", "benchmark"):
        assert key in shown


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda text: text[:30])
def test_examples(example: str) -> None:
    diagnostics = load_spec(example, environ=ENVIRON).diagnostics
    codes = {diagnostic.code for diagnostic in diagnostics}
    # Parts of specs lack other parts; nothing else may be wrong with them.
    assert codes <= (set() if "r2bspec: 1" in example else {"R2B102"}), diagnostics


@pytest.mark.parametrize("row", CONSTRUCTS, ids=lambda row: row["construct"])
def test_what_public_scripts_use_can_be_written(row: dict[str, str]) -> None:
    diagnostics = load_spec(row["example"], environ=ENVIRON).diagnostics
    assert {diagnostic.code for diagnostic in diagnostics} <= {"R2B102"}, diagnostics
