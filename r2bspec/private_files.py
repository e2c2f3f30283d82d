"""Files and folders that no other user of the machine may read."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

PRIVATE_UMASK = 0o077
"""New files get the mode 0600, and new folders 0700."""

_replaced: list[int] = []
"""The umasks that `private_files` has put aside; the first is the user's."""


@contextlib.contextmanager
def private_files() -> Iterator[None]:
    """Make what this process creates unreadable to other users, for as long as the block lasts."""
    before = os.umask(PRIVATE_UMASK)
    _replaced.append(before)
    try:
        yield
    finally:
        _replaced.pop()
        os.umask(before)


def user_umask() -> int:
    """The umask that the user has chosen, for programs that make files of theirs; -1: the same."""
    return _replaced[0] if _replaced else -1
