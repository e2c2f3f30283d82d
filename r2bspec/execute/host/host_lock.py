"""The lock of this host: benchmarks that run at the same time measure each other.

The lock is an advisory one on a file, which the kernel releases when its holder ends, however it
ends. The file also says who holds it, for people who wait; nothing depends on that text.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from r2bspec.diagnostics.quote import printable
from r2bspec.errors import R2bspecError

DISABLED_BY: Final = "R2BSPEC_NO_LOCK"
"""The variable that switches the lock off, for programs that make several runs at once."""

_NAME: Final = "r2bspec-host.lock"
_POLL_S = 0.2
_MAX_HOLDER_BYTES = 300


class HostBusyError(R2bspecError):
    """Another run has this host, and waiting was not wanted."""

    code = "R2B697"


def lock_file() -> Path:
    """The file of the lock, in the folder for temporary files, which all users share."""
    return Path(tempfile.gettempdir()) / _NAME


@contextlib.contextmanager
def host_lock(what: str, *, wait: bool = True, on_wait: Callable[[str], None]) -> Iterator[None]:
    """Have the host to oneself for as long as the context lasts.

    Without the permission to open the file of another user there is no lock, and the run goes on:
    a benchmark next to another one is better than none.

    Args:
        what: is shown to those who wait, such as the name of the benchmark.
        wait: for the end of another run.
        on_wait: is called once, with the holder, if it has to be waited for.

    Raises:
        HostBusyError: another run has the host, and `wait` is False.
    """
    if os.environ.get(DISABLED_BY):
        yield
        return
    place = _open()
    if place is None:
        yield
        return
    try:
        _acquire(place, wait=wait, on_wait=on_wait)
        os.ftruncate(place, 0)
        os.pwrite(place, f"{printable(what)[:200]} (process {os.getpid()})".encode(), 0)
        yield
    finally:
        os.close(place)


def _open() -> int | None:
    """The file, open; None where that is not possible."""
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    for more in (0, os.O_CREAT):
        with contextlib.suppress(OSError):
            # Not with O_CREAT at first: the kernel refuses that for files of others in /tmp.
            place = os.open(lock_file(), flags | more, 0o666)
            with contextlib.suppress(OSError):
                os.fchmod(place, 0o666)
            return place
    return None


def _acquire(place: int, *, wait: bool, on_wait: Callable[[str], None]) -> None:
    told = False
    while True:
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if not wait:
                raise HostBusyError(
                    f"this host is in use by {_holder(place)}",
                    hint="Without --no-wait (lock: wait) a run waits for its end; with --no-lock "
                    "(lock: off) it measures next to it.",
                ) from None
            if not told:
                on_wait(_holder(place))
                told = True
            time.sleep(_POLL_S)
        else:
            return


def _holder(place: int) -> str:
    """Who holds the lock, as it says itself."""
    text = os.pread(place, _MAX_HOLDER_BYTES, 0).decode(errors="replace")
    return printable(text) or "another run"
