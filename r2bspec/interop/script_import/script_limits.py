"""Limits of what is evaluated, so that no script takes long or much memory."""

from __future__ import annotations

from typing import Final

MAX_FILE_BYTES: Final = 300_000
"""Of one Python file; the parser needs up to 700 bytes of memory for each byte."""
MAX_TOTAL_BYTES: Final = 2_000_000
"""Of a script and everything that is read with it."""
MAX_STEPS: Final = 200_000
"""Statements and expressions that are evaluated for one script."""
MAX_CALL_DEPTH: Final = 25
MAX_ITEMS: Final = 10_000
"""Items of one list or map, and characters of a text that is repeated."""
MAX_TEXT: Final = 100_000
"""Characters of one text."""


class ScriptLimitError(Exception):
    """A script needs more than the limits; the argument says of what."""


class StepCounter:
    """Counts the steps of one import, over all files that it evaluates."""

    def __init__(self) -> None:
        self._steps = 0

    def count(self) -> None:
        """Count a step.

        Raises:
            ScriptLimitError: there were too many.
        """
        self._steps += 1
        if self._steps > MAX_STEPS:
            raise ScriptLimitError(f"more than {MAX_STEPS:,} steps")
