"""The time budget: what is not needed for a verdict is left out where it would not fit."""

from __future__ import annotations

import time
from collections.abc import Callable

from r2bspec.language.quantities import Duration


class TimeBudget:
    """The time that measuring may take, from `begin` on.

    More iterations, playing disturbed ones again, and a fresh batch are asked for here before they
    are played. What the spec declares is not: a run that cannot be judged is worth less than one
    that took too long.

    Attributes:
        left_out: a sentence for each thing that was left out.
    """

    def __init__(self, limit_ns: int, note: Callable[[str], None]) -> None:
        """Make a budget, which is not touched yet.

        Args:
            limit_ns: the budget; 0 for none.
            note: is told what is left out.
        """
        self._limit_ns = limit_ns
        self._note = note
        self._began_s: float | None = None
        self.left_out: list[str] = []

    def begin(self) -> None:
        """Count from now on."""
        self._began_s = time.monotonic()

    def spent_s(self) -> float:
        """Seconds since it began."""
        return 0.0 if self._began_s is None else time.monotonic() - self._began_s

    def allows(self, what: str, seconds: float) -> bool:
        """Whether something fits, as far as can be told; if not, that is noted.

        Args:
            what: such as ``no fresh batch``.
            seconds: how long it takes.
        """
        if not self._limit_ns or self.spent_s() + seconds <= self._limit_ns / 1e9:
            return True
        said = f"{what}: the time budget of {Duration(self._limit_ns)} does not allow it"
        self._note(said)
        self.left_out.append(f"{said[:1].upper()}{said[1:]}.")
        return False
