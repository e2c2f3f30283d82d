"""The comments of a Python file, by line."""

from __future__ import annotations

import io
import tokenize
from dataclasses import dataclass, field


@dataclass(slots=True)
class ScriptComments:
    """Comments by the line that they are on.

    Attributes:
        own: comments that are alone on their line.
        trailing: comments at the end of a line with code.
    """

    own: dict[int, str] = field(default_factory=dict)
    trailing: dict[int, str] = field(default_factory=dict)

    def at(self, line: int) -> list[str]:
        """The comment directly above a line, and the one at its end."""
        found: list[str] = []
        above = line - 1
        while above in self.own:
            found.insert(0, self.own[above])
            above -= 1
        if line in self.trailing:
            found.append(self.trailing[line])
        return found

    def head(self) -> list[str]:
        """The comment at the beginning of the file: its licence."""
        found: list[str] = []
        line = 1
        while line in self.own:
            found.append(self.own[line])
            line += 1
        return [each for each in found if not each.startswith("!")]


def read_comments(text: str) -> ScriptComments:
    """The comments of a Python file; those after a part that is no Python are left out."""
    found = ScriptComments()
    try:
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.COMMENT:
                alone = not token.line[: token.start[1]].strip()
                place = found.own if alone else found.trailing
                place[token.start[0]] = token.string.lstrip("#").strip()
    except (tokenize.TokenError, SyntaxError):
        return found
    return found
