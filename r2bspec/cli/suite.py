"""Several runs of one call: their folders, results of an earlier call, and the summary."""

from __future__ import annotations

import contextlib
import datetime
import time
from collections.abc import Generator, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec import api
from r2bspec.api import folder_name
from r2bspec.cli.spec_selection import SuiteEntry
from r2bspec.compare.report_input import read_folder
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.execute.identity.identify_graph import changes_since
from r2bspec.plan.canonical_json import plan_hash
from r2bspec.record.files import FolderTakenError, write_atomically
from r2bspec.record.graph_identity import GraphIdentity
from r2bspec.report import suite as suites
from r2bspec.report.output import echo, echo_document
from r2bspec.report.write_reports import (
    STDOUT,
    ReportRequest,
    takes_stdout,
    write_folder_reports,
    write_report,
)
from r2bspec.safe_io.private_files import private_files
from r2bspec.safe_io.safe_file import is_regular

if TYPE_CHECKING:
    from r2bspec.cli.run import RunArguments
    from r2bspec.judge.result import Result

SUMMARY_FILE = "suite.json"
"""The summary in the folder of the suite; complete after each run."""

RUN_PAGE = "report.html"
"""The page of a run, in its folder, where the HTML of the suite has no other to link to."""

_SUMMARY_SHARE = 10.0
"""Of ten thousand runs, writing the summary after each would take longer than the runs: it is
written again when ten times as long has passed as it took."""

NAME_FIELD = "{name}"
"""In the path of a report: one file for each run."""

Playing = Generator[tuple[SuiteEntry, suites.SuiteRun], None, None]
"""Plays the runs of a suite, here or on other hosts, and yields each when it has ended; closing it
ends the suite."""


def folder_line(folder: Path) -> str:
    """Return the line that names a run folder."""
    return f"run folder: {folder}"


def suite_reports(reports: Iterable[ReportRequest]) -> tuple[ReportRequest, ...]:
    """Return the reports that are not of single runs."""
    return tuple(request for request in reports if NAME_FIELD not in request.path)


def write_reports_of(options: RunArguments, folder: Path, spec: Path) -> None:
    """Write the requested reports of a run folder."""
    write_folder_reports(
        options.reports, folder, spec, verbose=options.verbose, suite_page=options.suite_page
    )


def _check_reports(options: RunArguments) -> None:
    for report in suite_reports(options.reports):
        if report.format not in suites.SUITE_FORMATS:
            raise click.UsageError(
                f"the summary of several runs has no format {report.format}: it has "
                f"{', '.join(suites.SUITE_FORMATS)}; with {NAME_FIELD} in the path, as in "
                f"{report.format}=reports/{NAME_FIELD}.{report.format}, each run has a report"
            )


def _assign_folders(entries: Sequence[SuiteEntry], root: Path) -> None:
    """A folder for each run, by its host and name; equal names are numbered in their order."""
    taken: dict[Path, int] = {}
    for entry in entries:
        parent = root / folder_name(entry.host) if entry.host else root
        plain = parent / folder_name(entry.name)
        taken[plain] = taken.get(plain, 0) + 1
        entry.folder = plain if taken[plain] == 1 else Path(f"{plain}-{taken[plain]}")


class Suite:
    """The runs that were played, and their summary.

    Attributes:
        gate: what is said of the set of specs, beside that of the base.
    """

    def __init__(self, root: Path, options: RunArguments) -> None:
        self.root = root
        self.gate: tuple[str, ...] = ()
        self._options = options
        self._entries: Sequence[SuiteEntry] = ()
        self._started_at = _now()
        self._results: dict[str, Result] = {}
        self._written = self._writing = 0.0

    @classmethod
    def of(cls, options: RunArguments) -> Suite:
        """Return the suite of a call.

        Raises:
            FolderTakenError: its folder has the runs of an earlier call.
        """
        _check_reports(options)
        root = options.output or api.default_run_folder("smoke-suite" if options.smoke else "suite")
        if not options.resume and is_regular(root / SUMMARY_FILE):
            raise FolderTakenError(
                f"{root} has the runs of an earlier call",
                hint="Choose a new folder with --output, or go on with --resume.",
            )
        return cls(root, options)

    def enter(self, entries: Sequence[SuiteEntry]) -> None:
        """Take the runs to play, each with its folder, and create the folder of the suite."""
        with private_files():
            self.root.mkdir(parents=True, exist_ok=True)
        _assign_folders(entries, self.root)
        self._entries = entries

    def run(self, announcement: str, playing: Playing) -> int:
        """Play the runs, print the summary, and return the worst exit status."""
        if self._entries and not self._options.quiet:
            echo(announcement, err=True)
        try:
            with contextlib.closing(playing):
                for entry, run in playing:
                    self.add(entry, run)
                    if self._options.fail_fast and run.exit_status:
                        break
            self._skip_rest("an earlier run did not pass (--fail-fast)")
        except BaseException as error:
            # The folder of the suite is named below, and in place of that of the run.
            getattr(error, "__notes__", []).clear()
            error.add_note(folder_line(self.root))
            raise
        finally:
            self._finish()
        echo(folder_line(self.root), err=True)
        return self._summary().exit_status

    def refuse(self) -> int:
        """Play nothing, because some runs have an error, and return the worst exit status."""
        for entry in self._entries:
            if entry.error is not None:
                entry.run = self.failed(entry, entry.error)
        self._skip_rest("the gate refuses another spec")
        self._finish()
        echo(folder_line(self.root), err=True)
        return self._summary().exit_status

    def _skip_rest(self, reason: str) -> None:
        """Say of the runs that have not been made why."""
        for entry in self._entries:
            entry.run = entry.run or suites.SuiteRun(
                name=entry.name,
                spec=str(entry.selection.spec),
                folder="",
                outcome="skipped",
                reason=f"not run, because {reason}",
                exit_status=ExitStatus.OK,
                host=entry.host,
            )

    def add(self, entry: SuiteEntry, run: suites.SuiteRun) -> None:
        """Add a run to the summary, and write it."""
        entry.run = run
        began = time.monotonic()
        if began - self._written < _SUMMARY_SHARE * self._writing:
            return
        self._write_summary()
        self._written = time.monotonic()
        self._writing = self._written - began

    def settled(self, entry: SuiteEntry) -> suites.SuiteRun | None:
        """Return an entry that need not be played: with an error, or with an earlier run."""
        if entry.error is not None:
            return self.failed(entry, entry.error)
        if self._options.resume and (earlier := self._earlier(entry)) is not None:
            return self.keep(entry, earlier, resumed=True)
        return None

    def failed(self, entry: SuiteEntry, error: R2bspecError, host: str = "") -> suites.SuiteRun:
        """Return a failed run as a row of the summary."""
        # What is in the folder of a run that was not begun is of an earlier one.
        was_begun = entry.error is None
        return suites.run_with_error(
            error,
            name=entry.name,
            spec=str(entry.selection.spec),
            folder=str(entry.folder) if was_begun and entry.folder.exists() else "",
            host=host or entry.host,
            report=self._page_of(entry) if was_begun else "",
        )

    def keep(
        self, entry: SuiteEntry, result: Result, *, resumed: bool, host: str = ""
    ) -> suites.SuiteRun:
        """Write the reports of a run with a result, and return it as a row of the summary."""
        spec = entry.selection.spec
        self._results[str(entry.folder)] = result
        write_reports_of(self.options_of(entry), entry.folder, spec)
        return suites.run_with_result(
            result,
            spec=str(spec),
            folder=str(entry.folder),
            name=entry.name,
            resumed=resumed,
            host=host or entry.host,
            report=self._page_of(entry),
        )

    def options_of(self, entry: SuiteEntry) -> RunArguments:
        """Return the options of a run, with its reports."""
        page = self._summary_page()
        return replace(
            self._options,
            reports=self.reports_of(entry),
            suite_page=Path(page.path) if page is not None else None,
        )

    def _summary_page(self) -> ReportRequest | None:
        """Return the HTML page of the summary, where one was requested as a file."""
        pages = (
            request
            for request in suite_reports(self._options.reports)
            if request.format == "html" and request.path != STDOUT
        )
        return next(pages, None)

    def _page_of(self, entry: SuiteEntry) -> str:
        """Return the HTML page of a run, where there is one."""
        paths = [request.path for request in self.reports_of(entry) if request.format == "html"]
        return next((path for path in paths if is_regular(Path(path))), "")

    def reports_of(self, entry: SuiteEntry) -> tuple[ReportRequest, ...]:
        """Return the reports of a run; a summary in HTML links to a page of each run."""
        name = "-".join(entry.folder.relative_to(self.root).parts)
        requests = tuple(
            replace(request, path=request.path.replace(NAME_FIELD, name))
            for request in self._options.reports
            if NAME_FIELD in request.path
        )
        summary = self._summary_page()
        if summary is None or any(request.format == "html" for request in requests):
            return requests
        return (*requests, replace(summary, path=str(entry.folder / RUN_PAGE)))

    def _earlier(self, entry: SuiteEntry) -> Result | None:
        """Return the result of a complete run of the same plan and code; any other makes room."""
        if not entry.folder.exists():
            return None
        benchmark = entry.benchmark
        result: Result | None = None
        with contextlib.suppress(R2bspecError):
            result = read_folder(entry.folder).result
        if (
            result is not None
            and result.status == "complete"
            and result.plan_hash == plan_hash(benchmark.plan)
            and self._is_same_code(entry, result.identity)
        ):
            return result
        _move_away(entry.folder)
        return None

    def _is_same_code(self, entry: SuiteEntry, earlier: GraphIdentity | None) -> bool:
        """Return whether an earlier run was of the code that there is now.

        Says what has changed.
        """
        if earlier is None:
            changes = ["it does not say what code it ran"]
        else:
            is_elsewhere = bool(self._options.on)
            changes = changes_since(earlier, entry.benchmark.base_dir, is_elsewhere=is_elsewhere)
        if changes and not self._options.quiet:
            echo(f"{entry.name}: the earlier run does not count: {', '.join(changes)}", err=True)
        return not changes

    def _summary(self) -> suites.SuiteSummary:
        runs = tuple(entry.run for entry in self._entries if entry.run is not None)
        return suites.SuiteSummary(
            started_at=self._started_at,
            ended_at=_now(),
            exit_status=suites.worst_status(run.exit_status for run in runs),
            gate=self.gate,
            runs=runs,
        )

    def _write_summary(self) -> None:
        write_atomically(self.root / SUMMARY_FILE, suites.render("json", self._summary(), {}))

    def _finish(self) -> None:
        """Write the summary to its file, to the requested reports, and to standard output."""
        self._write_summary()
        summary = self._summary()
        requests = suite_reports(self._options.reports)
        for request in requests:
            content = suites.render(request.format, summary, self._results, request.path)
            write_report(request.path, content)
        if not takes_stdout(requests):
            shown = suites.render(self._options.output_format, summary, self._results)
            echo_document(shown, nl=False)


def _move_away(folder: Path) -> None:
    """Keep what is there under another name."""
    numbers = iter(range(1, 10_000))
    while (place := folder.with_name(f"{folder.name}.earlier-{next(numbers)}")).exists():
        pass
    folder.rename(place)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
