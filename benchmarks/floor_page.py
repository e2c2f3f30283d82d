"""Putting what was measured into its places on a page of the documentation."""

from __future__ import annotations

from pathlib import Path


def put(page: Path, section: str, text: str) -> None:
    """Replace what stands between ``<!-- measured: SECTION -->`` and the next ``<!-- end -->``.

    Raises:
        ValueError: the page has no such place.
    """
    begin, end = f"<!-- measured: {section} -->\n", "<!-- end -->"
    before, found, rest = page.read_text(encoding="utf-8").partition(begin)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise ValueError(f"{page} has no place for {section!r}")
    page.write_text(f"{before}{begin}{text.rstrip()}\n{end}{after}", encoding="utf-8")
