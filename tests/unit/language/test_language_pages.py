"""Every code has a page; the examples of pages and of docs/language.md are true."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from r2bspec.diagnostics.code_pages import Page, all_pages
from r2bspec.language.load_spec import load_spec

SPEC = Path(__file__).parents[3] / "r2bspec" / "language"
TEXT = (SPEC.parents[1] / "docs" / "language.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```yaml\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)
CONSTRUCTS = yaml.safe_load(
    Path(__file__).with_name("public_constructs.yaml").read_text(encoding="utf-8")
)
ENVIRON = {"HOME": "/home/x", "HOME_TOKEN": "0123456789", "CAMERA_PASSWORD": "very-secret"}

# R2B04x are waivers, which another package reads.
PAGES = {
    code: page
    for code, page in all_pages().items()
    if code < "R2B200" and not code.startswith("R2B04")
}
WITH_EXAMPLES = [page for page in PAGES.values() if page.failing]


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=lambda page: page.code)
def test_the_failing_example_leads_to_the_code(page: Page) -> None:
    found = load_spec(page.failing, environ=ENVIRON).diagnostics
    assert page.code in {one.code for one in found}
    assert {one.severity for one in found if one.code == page.code} == {page.severity}


@pytest.mark.parametrize(
    "page", [page for page in WITH_EXAMPLES if page.passing], ids=lambda page: page.code
)
def test_the_passing_example_does_not(page: Page) -> None:
    codes = {diagnostic.code for diagnostic in load_spec(page.passing, environ=ENVIRON).diagnostics}
    # Parts of specs lack other parts; nothing else may be wrong with them.
    assert codes <= {"R2B102"}
    assert page.code == "R2B102" or page.code not in codes


def test_every_code_in_the_sources_has_a_page_and_the_other_way_round() -> None:
    used = {
        code
        for file in SPEC.rglob("*.py")
        for code in re.findall(r'"(R2B[01]\d\d)"', file.read_text())
    }
    assert used == set(PAGES)


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
