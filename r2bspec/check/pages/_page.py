"""Pages of what no example can show, because it is a file, a machine or a moment that is wrong."""

from __future__ import annotations

from r2bspec.diagnostics.model import Severity
from r2bspec.diagnostics.pages import Page


def error_page(code: str, title: str, why: str) -> Page:
    """The page of an error, without examples."""
    return Page(code=code, title=title, severity=Severity.ERROR, why=why, failing="", passing="")
