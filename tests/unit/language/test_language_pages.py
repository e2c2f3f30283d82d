"""Every code has a page, and every page's examples are true."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from r2bspec.diagnostics.code_pages import Page, all_pages
from r2bspec.language.load_spec import load_spec

SPEC = Path(__file__).parents[3] / "r2bspec" / "language"
ENVIRON = {"HOME": "/home/someone", "HOME_TOKEN": "0123456789"}

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
    codes = {one.code for one in load_spec(page.passing, environ=ENVIRON).diagnostics}
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
