"""The timeout for an output that may not arrive.

Some graphs publish an output for only some of their inputs, and some never do. The first missing
output takes the full timeout. Each further one halves the timeout, and each output restores it to a
multiple of the longest time that an output has taken.
"""

from __future__ import annotations

_MIN_TIMEOUT_NS = 20_000_000
_MIN_FINAL_NS = 500_000_000
_PAUSE_FACTOR = 10


class AdaptiveTimeout:
    """Computes the timeout; `max_ns` is its maximum."""

    def __init__(self, max_ns: int) -> None:
        self._max_ns = max_ns
        self._limit_ns = max_ns
        self._longest_ns = 0
        self._has_expired = False

    @property
    def limit_ns(self) -> int:
        """How long to wait for the next output."""
        return self._limit_ns

    @property
    def final_ns(self) -> int:
        """How long to wait at the end, after the last input."""
        return max(self._limit_ns, self._usual_timeout_ns)

    def answered(self, after_ns: int) -> None:
        """Record an output that arrived so long after the previous one."""
        self._longest_ns = max(self._longest_ns, after_ns)
        if self._has_expired:
            self._limit_ns = max(self._limit_ns, self._usual_timeout_ns)

    def expired(self) -> None:
        """Record that no output arrived within the timeout."""
        self._has_expired = True
        self._limit_ns = max(_MIN_TIMEOUT_NS, self._limit_ns // 2)

    @property
    def _usual_timeout_ns(self) -> int:
        return min(self._max_ns, max(_MIN_FINAL_NS, _PAUSE_FACTOR * self._longest_ns))
