"""Regular expressions of users, matched in time proportional to the text.

Python's own engine tries combinations: ``(a+)+$`` takes longer than any timeout on thirty
characters, and Ctrl-C waits for it. RE2 has no such case, and no backreferences or lookaround.
"""

from __future__ import annotations

from collections.abc import Callable


class PatternError(ValueError):
    """A text that is not a regular expression.

    Attributes:
        part: offset and length of the wrong part.
    """

    def __init__(self, message: str, part: tuple[int, int]) -> None:
        super().__init__(message)
        self.part = part


LinePattern = Callable[[str], bool]
"""Whether a line has a part that a regular expression matches."""


def compile_line_pattern(text: str) -> LinePattern:
    """Compile a regular expression in the syntax of RE2.

    Raises:
        PatternError: it is not one.
    """
    import re2

    options = re2.Options()
    options.log_errors = False
    try:
        compiled = re2.compile(text, options)
    except (re2.error, UnicodeError) as error:
        reason = error.args[0] if error.args else ""
        message = reason.decode(errors="replace") if isinstance(reason, bytes) else str(error)
        said, _, wrong = message.partition(": ")
        at = max(text.find(wrong), 0)
        raise PatternError(said, (at, min(len(wrong), len(text) - at) or 1)) from None
    return lambda line: compiled.search(line) is not None
