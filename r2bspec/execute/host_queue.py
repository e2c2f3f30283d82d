"""The queue of a host: benchmarks that run at the same time disturb each other.

A run that wants the host takes a ticket: a file with the next number, in a folder for temporary
files that all users share. The lowest ticket runs. The process of each run locks its ticket, and
the kernel releases the lock when the process ends, however it ends: a ticket without a lock does
not count. Numbers are assigned, and abandoned tickets removed, under a lock of the folder.

A ticket also says whose it is and how long that will take, for people who wait. Nothing is decided
by that text.
"""

from __future__ import annotations

import contextlib
import fcntl
import math
import os
import re
import stat
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.diagnostics.quote import pluralize, printable, time_text
from r2bspec.errors import R2bspecError, is_refusal
from r2bspec.execute.errors import InterruptedRunError, UnwritableRunError
from r2bspec.execute.states import Interrupts

DISABLED_BY: Final = "R2BSPEC_NO_LOCK"
"""The variable that switches the queue off, for programs that make several runs at once."""

_TEMPORARY: Final = "/tmp"  # noqa: S108 - the folder that all users share
_FOLDER: Final = "r2bspec-queue"
_POLL_S = 0.2
_MAX_NAME_CHARACTERS = 100
_TICKET_BYTES = 1000
_NUMBER: Final = re.compile(r"[1-9][0-9]{0,14}")


class HostBusyError(R2bspecError):
    """Other runs have this host for longer than the user wants to wait."""

    code = "R2B697"
    way_out = (
        "--wait DURATION waits longer, and no --wait until it is free; with --no-lock the run "
        "measures next to the other one."
    )


class Holder(msgspec.Struct, frozen=True):
    """What a ticket says of the run that holds it.

    Attributes:
        name: the name of the benchmark.
        process: its id.
        seconds: how long it will take; None if that is not known.
        began_s: when it has got the host, on the monotonic clock; None while it waits.
    """

    name: str = "another run"
    process: int = 0
    seconds: float | None = None
    began_s: float | None = None

    def __str__(self) -> str:
        return f"{printable(self.name)} (process {self.process})" if self.process else self.name

    def left_s(self) -> float | None:
        """Return how long the run will still take; None if that is unknown, or was exceeded."""
        if self.seconds is None or self.began_s is None:
            return self.seconds
        left_s = self.seconds - (time.monotonic() - self.began_s)
        return left_s if left_s > 0 else None


@dataclass(frozen=True)
class Place:
    """A place in the queue.

    Attributes:
        ahead: who is before it; the first one runs.
    """

    ahead: tuple[Holder, ...]

    def __str__(self) -> str:
        more = len(self.ahead) - 1
        others = f" and {pluralize(more, 'other')}" if more else ""
        number = len(self.ahead) + 1
        return (
            f"waiting in place {number} of the queue of this host, behind {self.ahead[0]}{others}"
        )

    def left(self) -> str:
        """Return in words how long it will take until this place is the first."""
        left_s = [holder.left_s() for holder in self.ahead]
        known = math.fsum(each for each in left_s if each is not None)
        if None not in left_s:
            return f"about {time_text(max(known, 1.0))}"
        return f"{time_text(known)} or more" if known else "for an unknown time"


OnWait = Callable[[Place], None]


def queue_folder() -> Path:
    """Return the folder of the tickets, inside the folder for temporary files.

    `tempfile.gettempdir` would choose another folder if the disk is full, and thus another queue.
    """
    return Path(os.environ.get("TMPDIR") or _TEMPORARY) / _FOLDER


@contextlib.contextmanager
def host_to_itself(
    name: str, *, seconds: float | None = None, wait_s: float = math.inf, on_wait: OnWait
) -> Iterator[None]:
    """Wait for the runs that came before, then hold the host for the block.

    If another user has made the folder unusable there is no queue, and the run continues: a
    benchmark beside another is better than none.

    Args:
        name: the name of the benchmark, for those who wait.
        seconds: how long it will take; None if that is not known.
        wait_s: for the others; 0 does not wait.
        on_wait: is called several times a second while others are waited for.

    Raises:
        HostBusyError: others have the host for longer.
        InterruptedRunError: a signal arrived.
        UnwritableRunError: the disk is full.
    """
    holder = Holder(printable(name)[:_MAX_NAME_CHARACTERS], os.getpid(), seconds)
    with contextlib.ExitStack() as stack:
        with _full_disks_explained():
            folder = None if os.environ.get(DISABLED_BY) else _open_folder()
            if folder is not None:
                stack.callback(os.close, folder)
                ticket = _Ticket.take(folder, holder)
                stack.callback(ticket.give_back)
                _wait_for_others(ticket, wait_s, on_wait)
                ticket.write(msgspec.structs.replace(holder, began_s=time.monotonic()))
        yield


@contextlib.contextmanager
def _full_disks_explained() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if not is_refusal(error):
            raise
        raise UnwritableRunError(
            f"the queue of this host, {queue_folder()}, cannot be written: {error.strerror}",
            hint="Free space on this disk, set TMPDIR to another disk, or do without the queue: "
            "--no-lock.",
        ) from error


def _wait_for_others(ticket: _Ticket, wait_s: float, on_wait: OnWait) -> None:
    until_s = time.monotonic() + wait_s
    with Interrupts() as interrupts:
        while ahead := ticket.ahead():
            if time.monotonic() >= until_s:
                waited = f", after {time_text(wait_s)} of waiting" if wait_s else ""
                raise HostBusyError(f"this host is in use by {ahead[0]}{waited}")
            on_wait(Place(ahead))
            time.sleep(_POLL_S)
            try:
                interrupts.check()
            except InterruptedRunError as error:
                raise InterruptedRunError(
                    f"{error} while it waited for {ahead[0]}", hint="Nothing was run."
                ) from None


def _open_folder() -> int | None:
    """Return the folder, open; None where that is not possible."""
    path = queue_folder()
    try:
        path.mkdir()
        # Everybody may put a ticket there, and remove only their own.
        path.chmod(0o1777)
    except FileExistsError:
        pass
    except OSError as error:
        if is_refusal(error):
            raise
        return None
    flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
    with contextlib.suppress(OSError):
        folder = os.open(path, flags)
        if os.access(path, os.W_OK | os.X_OK):
            return folder
        os.close(folder)
    return None


@dataclass(frozen=True)
class _Ticket:
    """A ticket of this process.

    Attributes:
        folder: a descriptor of the folder.
        number: its name.
        file: a descriptor of the file, which has the lock.
    """

    folder: int
    number: int
    file: int

    @classmethod
    def take(cls, folder: int, holder: Holder) -> _Ticket:
        """Take the next number.

        Raises:
            OSError: the disk is full.
        """
        fcntl.flock(folder, fcntl.LOCK_EX)
        try:
            for number in (numbers := _numbers(folder)):
                if _holder(folder, number) is None:
                    # In a folder of all users, only one's own can be removed.
                    with contextlib.suppress(OSError):
                        os.unlink(str(number), dir_fd=folder)
            number = max(numbers, default=0) + 1
            flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW
            ticket = cls(folder, number, os.open(str(number), flags, dir_fd=folder))
            try:
                os.fchmod(ticket.file, 0o644)
                fcntl.flock(ticket.file, fcntl.LOCK_EX)
                ticket.write(holder)
            except BaseException:
                ticket.give_back()
                raise
        finally:
            fcntl.flock(folder, fcntl.LOCK_UN)
        return ticket

    def write(self, holder: Holder) -> None:
        """Say who has the ticket; always as many bytes, which a full disk does not refuse later."""
        os.pwrite(self.file, msgspec.json.encode(holder).ljust(_TICKET_BYTES), 0)

    def ahead(self) -> tuple[Holder, ...]:
        """Return who has a lower number, the lowest first."""
        lower = (number for number in _numbers(self.folder) if number < self.number)
        holders = (_holder(self.folder, number) for number in lower)
        return tuple(holder for holder in holders if holder is not None)

    def give_back(self) -> None:
        """Let the next one run."""
        with contextlib.suppress(OSError):
            os.unlink(str(self.number), dir_fd=self.folder)
        os.close(self.file)


def _numbers(folder: int) -> list[int]:
    """Return the numbers of all tickets, sorted."""
    return sorted(int(name) for name in os.listdir(folder) if _NUMBER.fullmatch(name))


def _holder(folder: int, number: int) -> Holder | None:
    """Return who has a ticket; None for one that was abandoned."""
    flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        file = os.open(str(number), flags, dir_fd=folder)
    except OSError:
        return None
    try:
        if stat.S_ISREG(os.fstat(file).st_mode):
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        return None
    except BlockingIOError:
        try:
            return msgspec.json.decode(os.pread(file, _TICKET_BYTES, 0), type=Holder)
        except (msgspec.DecodeError, OSError):
            return Holder()
    finally:
        os.close(file)
