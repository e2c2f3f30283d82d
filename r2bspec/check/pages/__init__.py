"""The pages of all codes: documents, rules, data, plans and runs."""

from __future__ import annotations

from r2bspec.check.pages.data_codes import DATA_PAGES
from r2bspec.check.pages.file_codes import FILE_PAGES
from r2bspec.check.pages.fleet_codes import FLEET_PAGES
from r2bspec.check.pages.gate_codes import GATE_PAGES
from r2bspec.check.pages.run_codes import RUN_PAGES
from r2bspec.check.pages.script_codes import SCRIPT_PAGES
from r2bspec.check.pages.waiver_codes import WAIVER_PAGES
from r2bspec.check.rule_registry import all_rules
from r2bspec.diagnostics.code_pages import Page

_PAGES_WITHOUT_RULE = {
    page.code: page
    for page in (
        *DATA_PAGES,
        *FILE_PAGES,
        *FLEET_PAGES,
        *GATE_PAGES,
        *RUN_PAGES,
        *SCRIPT_PAGES,
        *WAIVER_PAGES,
    )
}


def all_pages() -> dict[str, Page]:
    """Every page by its code, in the order of the codes."""
    from r2bspec.language.pages import PAGES

    rules = {rule.code: rule.page for rule in all_rules()}
    return dict(sorted({**PAGES, **_PAGES_WITHOUT_RULE, **rules}.items()))


def find_page(code: str) -> Page | None:
    """The page of one code; the rules are imported only for a code that may be one of theirs."""
    return _PAGES_WITHOUT_RULE.get(code) or all_pages().get(code)
