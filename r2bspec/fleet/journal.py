"""The journal of a suite on a fleet: which run was sent where, and how it ended.

A line of JSON for each event, appended and synchronised. The folders of runs say what is done; the
journal says how it came about, and gives the suite the identity by which hosts know its runs.
"""

from __future__ import annotations

import datetime
import fcntl
import os
import secrets
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from r2bspec.errors import UsageError
from r2bspec.safe_io.limits import MAX_JOURNAL_BYTES
from r2bspec.safe_io.safe_file import read_bytes

JOURNAL_FILE: Final = "fleet.jsonl"

State = Literal["sent", "lost", "invalid", "full", "refused", "failed", "done"]
"""Of an attempt: ``sent`` to a host; ``lost`` with it; ``invalid``, to be tried again; ``full``
if the host had no room; ``refused`` if it cannot make the run; ``failed`` for good; ``done`` when
its folder is here."""


class Event(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One line.

    Attributes:
        suite: of the first line only: the identity of the suite.
        run: the path of the run folder, relative to that of the suite.
        identity: of the attempt, as the host knows it.
        attempt: counted from 1; an attempt whose host was lost is the same one elsewhere.
    """

    at: str
    suite: str = ""
    run: str = ""
    host: str = ""
    identity: str = ""
    attempt: int = 0
    state: State | Literal[""] = ""
    reason: str = ""


class Journal:
    """The journal of one suite."""

    def __init__(self, folder: Path) -> None:
        """Open the journal of a suite, or begin it.

        Raises:
            UsageError: the file is no journal, or another client writes it.
        """
        self._file = (folder / JOURNAL_FILE).open("ab+")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            events = read_journal(folder)
        except BlockingIOError:
            self._file.close()
            raise UsageError(
                f"another client runs the suite in {folder}",
                hint="Wait for its end, or choose another folder with --output.",
            ) from None
        except UsageError:
            self._file.close()
            raise
        self.suite = next((event.suite for event in events if event.suite), "")
        self.hosts = frozenset(event.host for event in events if event.host)
        if not self.suite:
            self.suite = secrets.token_hex(8)
            self.write(suite=self.suite)
            return
        self._file.seek(-1, os.SEEK_END)
        if self._file.read(1) != b"\n":
            # What follows a line that a crash has cut off must not become a part of it.
            self._file.write(b"\n")

    def write(self, **fields: Any) -> None:
        """Add an `Event` with these fields, now."""
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds")
        self._file.write(msgspec.json.encode(Event(at=now, **fields)) + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Let another client have the suite."""
        self._file.close()


def read_journal(folder: Path) -> list[Event]:
    """The events of a suite; a line that a crash has cut off is left out.

    Raises:
        UsageError: the file is no journal.
    """
    path = folder / JOURNAL_FILE
    try:
        lines = read_bytes(path, max_bytes=MAX_JOURNAL_BYTES).split(b"\n")
    except OSError as error:
        raise UsageError(
            f"{path} cannot be read: {error.strerror or error}",
            hint="See that it is a file that you may read, or give another --output.",
        ) from error
    events = []
    for number, line in enumerate(lines):
        try:
            events += [msgspec.json.decode(line, type=Event)] if line else []
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            if not number:
                raise UsageError(
                    f"{path} is no journal of a fleet: {error}",
                    hint="Give another --output, or run without --resume.",
                ) from error
    return events
