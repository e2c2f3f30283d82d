"""How long to wait for an answer that may never come.

Some graphs answer only some of what they are given, and some nothing at all. The first time nothing
comes, that takes the full patience. From then on it is known that waiting may be in vain: each
further time-out halves the patience, and an answer brings it back to a multiple of the longest
pause that an answer ever took.
"""

from __future__ import annotations

_MIN_TIMEOUT_NS = 20_000_000
_MIN_FINAL_NS = 500_000_000
_PAUSE_FACTOR = 10


class AdaptiveTimeout:
    """Tells how long to wait; `max_ns` is how long at most."""

    def __init__(self, max_ns: int) -> None:
        self._max_ns = max_ns
        self._limit_ns = max_ns
        self._longest_ns = 0
        self._has_expired = False

    @property
    def limit_ns(self) -> int:
        """How long to wait for the next answer."""
        return self._limit_ns

    @property
    def final_ns(self) -> int:
        """How long to wait at the end, when nothing more is given."""
        return max(self._limit_ns, self._usual_timeout_ns)

    def answered(self, after_ns: int) -> None:
        """An answer has come, so long after the last sign of life."""
        self._longest_ns = max(self._longest_ns, after_ns)
        if self._has_expired:
            self._limit_ns = max(self._limit_ns, self._usual_timeout_ns)

    def expired(self) -> None:
        """Nothing came for as long as the patience lasted."""
        self._has_expired = True
        self._limit_ns = max(_MIN_TIMEOUT_NS, self._limit_ns // 2)

    @property
    def _usual_timeout_ns(self) -> int:
        return min(self._max_ns, max(_MIN_FINAL_NS, _PAUSE_FACTOR * self._longest_ns))
