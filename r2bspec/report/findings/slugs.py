"""Codes as they are shown to users, with their slugs."""

from __future__ import annotations

from r2bspec.diagnostics.code_pages import find_page


def slug_of(code: str) -> str:
    """The slug of a code, such as ``unknown-key``; empty for a code without a page."""
    page = find_page(code)
    return page.slug if page is not None else ""


def code_with_slug(code: str) -> str:
    """The code with its slug, as shown to users: ``R2B101 unknown-key``."""
    return f"{code} {slug_of(code)}".rstrip()
