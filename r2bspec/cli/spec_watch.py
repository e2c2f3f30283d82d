"""``r2bspec validate --watch``: which specs a change on disk concerns, and their new reports."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Final

import click

from r2bspec.cli.file_report import FileReport
from r2bspec.untrusted.looked_up_files import Lookups, looked_up_files, shared_lookups, stamp

POLL_S: Final = 0.2
"""Time between two looks at the files: a few system calls for each."""


class SpecWatch:
    """The reports of specs, each kept as long as no file changes that its check looked up.

    Args:
        find: lists the specs; it raises click.UsageError where there is none.
        check: makes the report of one.
    """

    def __init__(self, find: Callable[[], list[str]], check: Callable[[str], FileReport]) -> None:
        self._find = find
        self._check = check
        self._known: dict[str, tuple[FileReport, Lookups]] = {}

    def updates(self) -> Iterator[list[FileReport]]:
        """All reports, now and whenever one of them has been made again; never ends.

        Raises:
            click.UsageError: at the beginning there is no spec.
        """
        files = self._find()
        while True:
            stale = [file for file in files if self._is_stale(file)]
            with shared_lookups():
                for file in stale:
                    with looked_up_files() as seen:
                        report = self._check(file)
                    self._known[file] = report, seen
            if stale or self._known.keys() - set(files):
                self._known = {file: self._known[file] for file in files}
                yield [report for report, _ in self._known.values()]
            time.sleep(POLL_S)
            try:
                files = self._find()
            except click.UsageError:
                # An editor may remove a file before it writes a new one in its place.
                files = [*self._known]

    def _is_stale(self, file: str) -> bool:
        if file not in self._known:
            return True
        _, seen = self._known[file]
        return any(stamp(path) != before for path, before in seen.files.items())
