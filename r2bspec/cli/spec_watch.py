"""``r2bspec validate --watch``: which specs a change on disk concerns, and their new reports."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Final

import click

from r2bspec.cli.file_report import FileReport
from r2bspec.safe_io.looked_up_files import (
    Lookups,
    Stamp,
    looked_up_files,
    shared_lookups,
    stamp,
)

POLL_S: Final = 0.2
"""Time between two looks at the files: a system call for each."""


class SpecWatch:
    """The reports of specs, each kept as long as nothing changes that its check looked up.

    Args:
        find: lists the specs; it raises click.UsageError where there is none.
        check: makes the report of one.
    """

    def __init__(self, find: Callable[[], list[str]], check: Callable[[str], FileReport]) -> None:
        self._find = find
        self._check = check
        self._known: dict[str, tuple[FileReport, Lookups]] = {}
        self._stamps: dict[str, Stamp] = {}

    def updates(self) -> Iterator[list[FileReport]]:
        """All reports, now and whenever there is something new to tell; never ends.

        That is: a spec or a file that one names has been saved, even if the findings are the same,
        or the findings are others, even if only the installation has changed.

        Raises:
            click.UsageError: at the beginning there is no spec.
        """
        files = self._find()
        while True:
            changed = self._changed()
            stale = [file for file in files if self._is_stale(file, changed)]
            gone = self._known.keys() - set(files)
            with shared_lookups():
                told = [self._check_again(file, changed) for file in stale]
            if stale or gone:
                self._known = {file: self._known[file] for file in files}
                self._stamps = self._agreed_stamps()
            if any(told) or gone:
                yield [report for report, _ in self._known.values()]
            time.sleep(POLL_S)
            try:
                files = self._find()
            except click.UsageError:
                # An editor may remove a file before it writes a new one in its place.
                files = [*self._known]

    def _changed(self) -> set[str]:
        """The paths that are no longer what a check saw; each is looked at once for all specs."""
        return {path for path, before in self._stamps.items() if stamp(path) != before}

    def _is_stale(self, file: str, changed: set[str]) -> bool:
        known = self._known.get(file)
        return known is None or not changed.isdisjoint(known[1].files)

    def _check_again(self, file: str, changed: set[str]) -> bool:
        """Make a new report; returns whether there is something new to tell."""
        before = self._known.get(file)
        with looked_up_files() as seen:
            report = self._check(file)
        self._known[file] = report, seen
        return before is None or report != before[0] or not changed.isdisjoint(before[1].read)

    def _agreed_stamps(self) -> dict[str, Stamp]:
        """What the checks saw; of a path that changed between two of them, what the first saw."""
        stamps: dict[str, Stamp] = {}
        for _, seen in self._known.values():
            for path, one in seen.files.items():
                if stamps.setdefault(path, one) != one:
                    # Not what it is now for one of them: both are checked again.
                    stamps[path] = _NEVER
        return stamps


_NEVER: Final = (-1, -1, -1, -1)
"""The stamp of no file."""
