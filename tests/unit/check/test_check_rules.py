"""Every rule is complete and well formed; so is every page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from r2bspec.check.engine import all_rules
from r2bspec.check.rule import Rule
from r2bspec.diagnostics import Severity
from r2bspec.diagnostics.code_pages import Page, all_pages, find_page

ROOT = Path(__file__).parents[3]
EVERY_RULE = pytest.mark.parametrize("rule", all_rules(), ids=lambda rule: rule.code)


def test_causes_come_before_consequences() -> None:
    found = [rule.code for rule in all_rules()]
    late = [rule.code for rule in all_rules() if not rule.early]
    assert late == sorted(late)
    assert found[len(found) - len(late) :] == late


@EVERY_RULE
def test_a_rule_says_what_and_why(rule: Rule) -> None:
    assert re.fullmatch(r"R2B[2-6]\d\d", rule.code)
    page = rule.page
    assert page.title[0].islower() or page.title.startswith("ROS")
    assert bool(page.failing) == bool(page.passing)


@EVERY_RULE
def test_the_examples_of_a_rule_differ_in_a_few_lines(rule: Rule) -> None:
    failing, passing = set(rule.page.failing.splitlines()), set(rule.page.passing.splitlines())
    assert len(failing ^ passing) <= 14


def test_every_code_in_the_sources_has_a_page() -> None:
    sources = [file.read_text(encoding="utf-8") for file in (ROOT / "r2bspec").rglob("*.py")]
    used = {code for text in sources for code in re.findall(r'"(R2B\d{3})"', text)}
    assert used - all_pages().keys() == set()


def test_every_code_has_one_slug_of_its_own() -> None:
    slugs = {code: page.slug for code, page in all_pages().items()}
    assert len(set(slugs.values())) == len(slugs)
    for code, slug in slugs.items():
        assert re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", slug), code
        assert len(slug) <= 40, code
        assert find_page(code) == all_pages()[code]
    assert find_page("R2B999") is None


def test_every_code_has_one_rule() -> None:
    codes = [rule.code for rule in all_rules()]
    assert len(codes) == len(set(codes)) > 100


def test_the_slug_of_a_rule_is_the_name_of_its_function() -> None:
    for rule in all_rules():
        assert rule.page.slug == rule.find.__name__.replace("_", "-")


@pytest.mark.parametrize("page", all_pages().values(), ids=lambda page: page.code)
def test_a_page_says_what_and_why(page: Page) -> None:
    assert page.title
    assert not page.title.endswith(".")
    assert page.why.endswith((".", ")"))
    assert isinstance(page.severity, Severity)
