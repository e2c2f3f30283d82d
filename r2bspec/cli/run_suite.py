"""Several runs of ``r2bspec run``, one after the other on this host, with one summary."""

from __future__ import annotations

import contextlib
import datetime
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.run_selection import RunItem
from r2bspec.cli.run_single import execute, folder_line, locked_host, show_differences
from r2bspec.cli.spec_selection import prepare_and_report
from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo, echo_document

if TYPE_CHECKING:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.cli.run_options import RunOptions
    from r2bspec.judge.result import Result
    from r2bspec.plan.time_estimate import TimeEstimate
    from r2bspec.report.suite_summary import SuiteRun, SuiteSummary
    from r2bspec.report.write_reports import ReportRequest

SUMMARY_FILE = "suite.json"
"""The summary in the folder of the suite; complete after each run."""

_NAME_FIELD = "{name}"
"""In the path of a report: one file for each run."""


@dataclass
class _Entry:
    """One run of the suite: prepared, or with the error that prevents it."""

    item: RunItem
    name: str
    prepared: PreparedBenchmark | None = None
    error: R2bspecError | None = None
    estimate: TimeEstimate | None = None
    folder: Path = field(default_factory=Path)

    @property
    def seconds(self) -> float:
        return self.estimate.seconds if self.estimate is not None else 0.0


def run_suite(items: Sequence[RunItem], options: RunOptions) -> int:
    """Make all runs; returns the worst exit status.

    Raises:
        InterruptedRunError: a signal ended a run; the summary of the others has been written.
    """
    from r2bspec import api
    from r2bspec.private_files import private_files

    _check_reports(options)
    root = options.output or api.default_run_folder("smoke-suite" if options.smoke else "suite")
    entries = [_prepare(item, options) for item in items]
    _assign_folders(entries, root)
    suite = _Suite(root, options, entries)
    with private_files():
        root.mkdir(parents=True, exist_ok=True)
    with locked_host(f"{len(entries)} benchmarks", options):
        suite.announce()
        return suite.run()


def _check_reports(options: RunOptions) -> None:
    from r2bspec.report.suite_formats import SUITE_FORMATS

    for each in options.reports:
        if each.format not in SUITE_FORMATS and _NAME_FIELD not in each.path:
            raise click.UsageError(
                f"the summary of several runs has no format {each.format}: it has "
                f"{', '.join(SUITE_FORMATS)}; with {_NAME_FIELD} in the path, as in "
                f"{each.format}=reports/{_NAME_FIELD}.{each.format}, each run has a report"
            )


def _prepare(item: RunItem, options: RunOptions) -> _Entry:
    """Check one spec before anything runs; its error is that of its run."""
    from r2bspec.cli.main import show_error
    from r2bspec.plan.time_estimate import estimate_time

    try:
        prepared = prepare_and_report(item.selection, smoke=options.smoke)
    except R2bspecError as error:
        show_error(error)
        case = f"[{item.selection.case}]" if item.selection.case else ""
        name = item.selection.spec.name.removesuffix(".r2b.yaml")
        return _Entry(item, f"{name}{case}{item.suffix}", error=error)
    if item.suffix:
        import msgspec

        named = msgspec.structs.replace(prepared.plan, name=f"{prepared.plan.name}{item.suffix}")
        prepared = replace(prepared, plan=named)
    return _Entry(item, prepared.plan.name, prepared, estimate=estimate_time(prepared.plan))


def _assign_folders(entries: Sequence[_Entry], root: Path) -> None:
    """A folder for each run, by its name; equal names are numbered in their order."""
    from r2bspec.api import folder_name

    taken: dict[str, int] = {}
    for entry in entries:
        plain = folder_name(entry.name)
        taken[plain] = taken.get(plain, 0) + 1
        entry.folder = root / (plain if taken[plain] == 1 else f"{plain}-{taken[plain]}")


class _Suite:
    """The runs that were made, and the summary of them."""

    def __init__(self, root: Path, options: RunOptions, entries: Sequence[_Entry]) -> None:
        self._root = root
        self._options = options
        self._entries = entries
        self._started_at = _now()
        self._runs: list[SuiteRun] = []
        self._results: dict[str, Result] = {}

    def announce(self) -> None:
        """Say how long all of it will take."""
        from r2bspec.plan.time_estimate import time_text

        if not self._options.quiet:
            number = len(self._entries)
            total = time_text(sum(each.seconds for each in self._entries))
            echo(f"{number} {'run' if number == 1 else 'runs'}: about {total}", err=True)

    def run(self) -> int:
        """Make the runs in their order, then print the summary."""
        try:
            for number, entry in enumerate(self._entries):
                stop = self._options.fail_fast and any(one.exit_status for one in self._runs)
                self._runs.append(self._skipped(entry) if stop else self._make(number, entry))
                self._write_summary()
        except BaseException as error:
            # The folder of the suite is named below, and in place of that of the run.
            getattr(error, "__notes__", []).clear()
            error.add_note(folder_line(self._root))
            raise
        finally:
            self._finish()
        echo(folder_line(self._root), err=True)
        return self._summary().exit_status

    def _make(self, number: int, entry: _Entry) -> SuiteRun:
        from r2bspec.cli.main import show_error
        from r2bspec.execute.errors import InterruptedRunError
        from r2bspec.report.suite_summary import run_with_error

        spec = str(entry.item.selection.spec)
        if entry.prepared is None:
            assert entry.error is not None  # noqa: S101 - it is one or the other
            return run_with_error(entry.error, name=entry.name, spec=spec)
        if self._options.resume and (earlier := self._earlier(entry)) is not None:
            return self._keep(entry, earlier, resumed=True)
        later_s = sum(each.seconds for each in self._entries[number + 1 :])
        try:
            result = self._play(number, entry, later_s)
            show_differences(result, entry.prepared)
            return self._keep(entry, result, resumed=False)
        except InterruptedRunError as error:
            self._runs.append(
                run_with_error(error, name=entry.name, spec=spec, folder=str(entry.folder))
            )
            raise
        except R2bspecError as error:
            show_error(error)
            folder = str(entry.folder) if entry.folder.exists() else ""
            return run_with_error(error, name=entry.name, spec=spec, folder=folder)

    def _play(self, number: int, entry: _Entry, later_s: float) -> Result:
        from r2bspec.report.remaining_time import RemainingTime

        assert entry.prepared is not None  # noqa: S101 - see the caller
        assert entry.estimate is not None  # noqa: S101 - prepared specs have one
        if not self._options.quiet:
            echo(
                f"[{number + 1}/{len(self._entries)}] {entry.name}: {entry.estimate.text()}",
                err=True,
            )
        remaining = RemainingTime(entry.estimate, after_s=later_s)
        of_run = replace(self._options, reports=self._reports_of(entry))
        result = execute(entry.prepared, entry.item.selection, of_run, entry.folder, remaining)
        if not self._options.quiet:
            echo(f"  {result.verdict.outcome}: {result.verdict.reason}", err=True)
        return result

    def _keep(self, entry: _Entry, result: Result, *, resumed: bool) -> SuiteRun:
        from r2bspec.cli.run_single import write_reports_of
        from r2bspec.report.suite_summary import run_with_result

        spec = entry.item.selection.spec
        self._results[str(entry.folder)] = result
        write_reports_of(
            replace(self._options, reports=self._reports_of(entry)), entry.folder, spec
        )
        return run_with_result(
            result, spec=str(spec), folder=str(entry.folder), name=entry.name, resumed=resumed
        )

    def _reports_of(self, entry: _Entry) -> tuple[ReportRequest, ...]:
        """The reports of one run."""
        return tuple(
            replace(each, path=each.path.replace(_NAME_FIELD, entry.folder.name))
            for each in self._options.reports
            if _NAME_FIELD in each.path
        )

    def _earlier(self, entry: _Entry) -> Result | None:
        """The result of a complete run of the same plan; an incomplete one makes room."""
        from r2bspec.compare.load_results import read_folder
        from r2bspec.plan.canonical_json import plan_hash

        if not entry.folder.exists():
            return None
        assert entry.prepared is not None  # noqa: S101 - nothing is played otherwise
        result: Result | None = None
        with contextlib.suppress(R2bspecError):
            result = read_folder(entry.folder).result
        if (
            result is not None
            and result.status == "complete"
            and result.plan_hash == plan_hash(entry.prepared.plan)
        ):
            return result
        _move_away(entry.folder)
        return None

    def _skipped(self, entry: _Entry) -> SuiteRun:
        from r2bspec.report.suite_summary import SuiteRun

        return SuiteRun(
            name=entry.name,
            spec=str(entry.item.selection.spec),
            folder="",
            outcome="skipped",
            reason="not run, because an earlier run did not pass (--fail-fast)",
            exit_status=ExitStatus.OK,
        )

    def _summary(self) -> SuiteSummary:
        from r2bspec.report.suite_summary import SuiteSummary, worst_status

        return SuiteSummary(
            started_at=self._started_at,
            ended_at=_now(),
            exit_status=worst_status(one.exit_status for one in self._runs),
            runs=tuple(self._runs),
        )

    def _write_summary(self) -> None:
        from r2bspec.record.atomic_files import write_atomically
        from r2bspec.report.suite_formats import to_json

        write_atomically(self._root / SUMMARY_FILE, to_json(self._summary(), self._results))

    def _finish(self) -> None:
        """Write the summary to its file, to the requested reports, and to standard output."""
        from r2bspec.report.suite_formats import SUITE_FORMATS
        from r2bspec.report.write_reports import takes_stdout, write_report

        self._write_summary()
        summary = self._summary()
        wanted = [each for each in self._options.reports if _NAME_FIELD not in each.path]
        for each in wanted:
            write_report(each.path, SUITE_FORMATS[each.format](summary, self._results))
        if not takes_stdout(wanted):
            shown = SUITE_FORMATS[self._options.output_format](summary, self._results)
            echo_document(shown, nl=False)


def _move_away(folder: Path) -> None:
    """Keep what is there under another name."""
    numbers = iter(range(1, 10_000))
    while (place := folder.with_name(f"{folder.name}.earlier-{next(numbers)}")).exists():
        pass
    folder.rename(place)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
