"""The code blocks of a page of the documentation that are files, or commands that a shell runs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
_BLOCK = re.compile(r"<!-- (\w+)(?:: ([^\n>]+))? -->\n```\w*\n(.*?)```", re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A block: its kind, the argument of the kind, and its text."""

    kind: str
    argument: str
    text: str

    @property
    def commands(self) -> list[str]:
        """The commands of a console, without its prompts."""
        lines = self.text.splitlines()
        assert all(line.startswith("$ ") for line in lines), self.text
        return [line.removeprefix("$ ") for line in lines]


def page_blocks(name: str) -> list[Block]:
    """The blocks of a page; each code block of it has to be one of them."""
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    blocks = [Block(*found) for found in _BLOCK.findall(text)]
    assert len(blocks) == len(re.findall(r"^```\w", text, re.MULTILINE)), name
    return blocks


def page_file(name: str, path: str) -> str:
    """The content of a file that a page shows."""
    (text,) = {
        block.text for block in page_blocks(name) if (block.kind, block.argument) == ("file", path)
    }
    return text
