"""Pages without examples, for errors of files, machines and runs."""

from __future__ import annotations

from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity


def error_page(code: str, title: str, why: str) -> Page:
    """The page of an error, without examples."""
    return Page(code=code, title=title, severity=Severity.ERROR, why=why, failing="", passing="")
