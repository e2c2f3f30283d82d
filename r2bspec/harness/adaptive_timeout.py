"""How long to wait for an answer that may never come.

Some graphs answer only some of what they are given, and some nothing at all. The first time nothing
comes, that takes the full patience. From then on it is known that waiting may be in vain: each
further time-out halves the patience, and an answer brings it back to a multiple of the longest
pause that an answer ever took.
"""

from __future__ import annotations

_LEAST_NS = 20_000_000
_USUAL_NS = 500_000_000
_FACTOR = 10


class Patience:
    """Tells how long to wait; `full_ns` is how long at most."""

    def __init__(self, full_ns: int) -> None:
        self._full_ns = full_ns
        self._limit_ns = full_ns
        self._longest_ns = 0
        self._in_vain = False

    @property
    def limit_ns(self) -> int:
        """How long to wait for the next answer."""
        return self._limit_ns

    @property
    def last_ns(self) -> int:
        """How long to wait at the end, when nothing more is given."""
        return max(self._limit_ns, self._usual_ns)

    def answered(self, after_ns: int) -> None:
        """An answer has come, so long after the last sign of life."""
        self._longest_ns = max(self._longest_ns, after_ns)
        if self._in_vain:
            self._limit_ns = max(self._limit_ns, self._usual_ns)

    def ended(self) -> None:
        """Nothing came for as long as the patience lasted."""
        self._in_vain = True
        self._limit_ns = max(_LEAST_NS, self._limit_ns // 2)

    @property
    def _usual_ns(self) -> int:
        return min(self._full_ns, max(_USUAL_NS, _FACTOR * self._longest_ns))
