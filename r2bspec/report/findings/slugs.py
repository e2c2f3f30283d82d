"""The slugs of codes, looked up only when a finding is shown."""

from __future__ import annotations

from functools import cache


@cache
def slug_of(code: str) -> str:
    """The slug of a code, such as ``unknown-key``; empty for a code without a page."""
    from r2bspec.language.pages import PAGES

    page = PAGES.get(code)
    if page is None:
        from r2bspec.check.pages import find_page

        page = find_page(code)
    return page.slug if page is not None else ""


def code_with_slug(code: str) -> str:
    """The code with its slug, as shown to users: ``R2B101 unknown-key``."""
    return f"{code} {slug_of(code)}".rstrip()
