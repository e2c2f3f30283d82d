"""Keeping other users out of the shared memory of a run, which the umask does not do."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable

from r2bspec.middleware.middleware import middleware_of

_PERIOD_S = 0.1
_ATTEMPTS = 20
"""How often a file is looked at: a process maps its segment a moment after it has made it."""


class SharedMemoryModes:
    """The segments of a run's processes, of which each is made private soon after it is made."""

    def __init__(self, pids: Callable[[], Iterable[int]]) -> None:
        self._pids = pids
        self._middleware = middleware_of(os.environ)
        self._attempts: dict[str, int] = {}
        self._next_s = 0.0

    def make_private(self) -> None:
        """Look for new segments, at most ten times a second.

        Those of programs that are not of the run stay readable, and are not looked at for ever.
        """
        if time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + _PERIOD_S
        readable = self._middleware.readable_shm_files()
        self._attempts = {name: self._attempts.get(name, 0) + 1 for name in readable}
        if any(number <= _ATTEMPTS for number in self._attempts.values()):
            self._middleware.make_shm_files_private(self._pids())
