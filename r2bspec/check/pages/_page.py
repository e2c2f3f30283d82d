"""Pages without examples, for errors of files, machines and runs."""

from __future__ import annotations

from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity


def error_page(slug: str, code: str, title: str, why: str) -> Page:
    """The page of an error, without examples."""
    return Page(slug, code, title, Severity.ERROR, why, failing="", passing="")
