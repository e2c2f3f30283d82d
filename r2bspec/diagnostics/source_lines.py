"""Splitting a source into lines as YAML does."""

from __future__ import annotations

import re

LINE_BREAK = re.compile(r"\r\n|[\n\r\x85\u2028\u2029]")


def split_lines(text: str) -> list[str]:
    """The lines of a text, without line breaks."""
    return LINE_BREAK.split(text)
