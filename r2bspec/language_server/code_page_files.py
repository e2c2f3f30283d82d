"""The pages of the codes as files, to which diagnostics link; written when they are needed."""

from __future__ import annotations

import contextlib
import tempfile
from functools import cache
from pathlib import Path

from r2bspec.check.pages import find_page
from r2bspec.diagnostics.code_pages import Page


@cache
def _folder() -> Path:
    """A private folder of this process; it lasts as long as the files that editors open from it."""
    return Path(tempfile.mkdtemp(prefix="r2bspec-codes-"))


@cache
def page_uri(code: str) -> str:
    """The URI of the page of a code."""
    path = _folder() / f"{code}.md"
    page = find_page(code)
    if page is not None:
        # Without a page the link leads nowhere; the diagnostic itself is complete.
        with contextlib.suppress(OSError):
            path.write_text(page_markdown(page), encoding="utf-8")
    return path.as_uri()


def page_markdown(page: Page) -> str:
    """A page as Markdown."""
    parts = [f"# {page.code} {page.slug}", f"{page.title} ({page.severity})", page.why]
    for title, text in (("With the problem", page.failing), ("Without it", page.passing)):
        if text:
            parts.append(f"{title}:\n\n```yaml\n{text.rstrip()}\n```")
    return "\n\n".join(parts) + "\n"


def remove_pages() -> None:
    """Remove the files; for the end of the server."""
    if _folder.cache_info().currsize:
        for each in _folder().glob("*.md"):
            each.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            _folder().rmdir()
