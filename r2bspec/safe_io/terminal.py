"""The terminal of this process, which its user may close."""

from __future__ import annotations

import os
from typing import Final

_OUTPUTS: Final = tuple(number for number in (1, 2) if os.isatty(number))
"""The standard streams that are a terminal. Of one that is closed, the system no longer says it."""


def leave_terminal() -> None:
    """Discard further output to the terminal, which would fail."""
    for number in _OUTPUTS:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, number)
        os.close(nothing)
