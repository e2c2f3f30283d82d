"""The pages of every code: of reading documents, of rules, of data, of plans and of runs."""

from __future__ import annotations

from r2bspec.check.pages.data import DATA_PAGES
from r2bspec.check.pages.files import FILE_PAGES
from r2bspec.check.pages.run import RUN_PAGES
from r2bspec.check.pages.waivers import WAIVER_PAGES
from r2bspec.check.registry import all_rules
from r2bspec.diagnostics.pages import Page


def all_pages() -> dict[str, Page]:
    """Every page by its code, in the order of the codes."""
    from r2bspec.spec.pages import PAGES

    rules = (rule.page for rule in all_rules())
    pages = {
        page.code: page for page in (*DATA_PAGES, *FILE_PAGES, *RUN_PAGES, *WAIVER_PAGES, *rules)
    }
    return dict(sorted({**PAGES, **pages}.items()))
