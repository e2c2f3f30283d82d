"""The files that docs/tutorial.md shows."""

from __future__ import annotations

import re
from pathlib import Path

_PAGE = Path(__file__).parents[2] / "docs" / "tutorial.md"
_FILE = re.compile(r"<!-- file: ([^\n>]+) -->\n```\w*\n(.*?)```", re.DOTALL)


def page_files() -> dict[str, str]:
    """The content of each file by its name."""
    return dict(_FILE.findall(_PAGE.read_text(encoding="utf-8")))
