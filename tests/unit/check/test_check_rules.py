"""Every rule is complete and well formed; so is every page."""

from __future__ import annotations

import re
from pathlib import Path

from r2bspec.check.engine import all_rules
from r2bspec.diagnostics import Severity
from r2bspec.diagnostics.code_pages import all_pages, find_page

ROOT = Path(__file__).parents[3]


def test_causes_come_before_consequences() -> None:
    found = [rule.code for rule in all_rules()]
    late = [rule.code for rule in all_rules() if not rule.early]
    assert late == sorted(late)
    assert found[len(found) - len(late) :] == late
    assert len(found) == len(set(found)) > 100, "every code has one rule"


def test_a_rule_is_named_as_its_page_which_shows_it_in_a_few_lines() -> None:
    for rule in all_rules():
        page = rule.page
        assert re.fullmatch(r"R2B[2-6]\d\d", rule.code)
        assert page.slug == rule.find.__name__.replace("_", "-")
        assert page.title[0].islower() or page.title.startswith("ROS"), rule.code
        assert bool(page.failing) == bool(page.passing), rule.code
        failing, passing = set(page.failing.splitlines()), set(page.passing.splitlines())
        assert len(failing ^ passing) <= 14, rule.code


def test_every_code_in_the_sources_has_a_page() -> None:
    sources = [file.read_text(encoding="utf-8") for file in (ROOT / "r2bspec").rglob("*.py")]
    used = {code for text in sources for code in re.findall(r'"(R2B\d{3})"', text)}
    assert used - all_pages().keys() == set()


def test_every_page_says_what_and_why_and_has_a_slug_of_its_own() -> None:
    pages = all_pages()
    assert len({page.slug for page in pages.values()}) == len(pages)
    for code, page in pages.items():
        assert re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", page.slug), code
        assert len(page.slug) <= 40, code
        assert page.title, code
        assert not page.title.endswith("."), code
        assert page.why.endswith((".", ")")), code
        assert isinstance(page.severity, Severity)
        assert find_page(code) == page
    assert find_page("R2B999") is None
