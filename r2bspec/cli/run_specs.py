"""The loop of the verbs that play specs here: prepare all, have the host, play, report.

A single spec is a suite of one, whose folder, report and error are those of the call.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from r2bspec import api
from r2bspec.cli.main import show_error
from r2bspec.cli.run import Entry, Runs
from r2bspec.cli.spec_selection import SuiteEntry, prepare_and_report
from r2bspec.cli.suite import Playing, Suite, folder_line, suite_reports, write_reports_of
from r2bspec.cli.text_output import queued_host, show_findings
from r2bspec.diagnostics.quote import pluralize
from r2bspec.errors import R2bspecError
from r2bspec.execute.errors import InterruptedRunError
from r2bspec.plan.time_estimate import range_text
from r2bspec.record.files import FolderTakenError
from r2bspec.report.format_registry import ReportUsageError
from r2bspec.report.notes import notes
from r2bspec.report.output import echo, echo_json
from r2bspec.report.progress import RemainingTime, shown_progress
from r2bspec.report.wording import headline
from r2bspec.report.write_reports import check_targets, failure, takes_stdout, write_failure_reports

if TYPE_CHECKING:
    from r2bspec.cli.run import RunArguments
    from r2bspec.judge.result import Result
    from r2bspec.report.suite import SuiteRun


def run_specs(entries: Sequence[Entry], runs: Runs[Entry], *, several: bool) -> int:
    """Play entries one after the other on this host; return the worst exit status.

    Args:
        entries: what is played.
        runs: how.
        several: print a summary; otherwise there is one entry, whose error is raised.

    Raises:
        R2bspecError: nothing is played, or the single run failed.
        InterruptedRunError: a signal ended a run; the summary of the others has been written.
    """
    options = runs.options
    suite = Suite.of(options) if several else None
    with contextlib.ExitStack() as stack:
        told = replace(options, reports=suite_reports(options.reports)) if several else options
        spec = entries[0].selection.spec if entries else Path()
        with reported_failures(told, None, spec):
            prepare_entries(entries, options, several=several)
            runs.check(entries)
            if playable := _playable(entries, runs):
                for entry in playable:
                    entry.estimate = runs.estimate(entry)
                name = f"{len(entries)} benchmarks" if several else runs.name(entries[0])
                seconds = sum(entry.seconds for entry in playable)
                host = queued_host(name, seconds, options.wait_s, quiet=options.quiet)
                stack.enter_context(host)
                for entry in playable:
                    with kept_error(entry, several=several):
                        runs.build(entry)
        if suite is None:
            return _play_alone(entries[0], runs)
        suite.gate = runs.notes
        suite.enter(entries)
        if entries and not _playable(entries, runs):
            return suite.refuse()
        return suite.run(announcement(entries), _play_all(entries, runs, suite))


def prepare_entries(entries: Sequence[SuiteEntry], options: RunArguments, *, several: bool) -> None:
    """Check every spec before anything runs.

    Raises:
        R2bspecError: the only spec has an error; that of one of several is kept.
    """
    check_targets(options.reports, [str(entry.selection.spec) for entry in entries], options.output)
    for entry in entries:
        with kept_error(entry, several=several):
            prepared = prepare_and_report(
                entry.selection, smoke=options.smoke, infos=options.verbose
            )
            entry.name = f"{prepared.plan.name}{entry.suffix}"
            named = msgspec.structs.replace(prepared.plan, name=entry.name)
            entry.prepared = replace(prepared, plan=named)


@contextlib.contextmanager
def kept_error(entry: SuiteEntry, *, several: bool) -> Iterator[None]:
    """Print what refuses one of several entries, and keep it as its error."""
    try:
        yield
    except InterruptedRunError:
        raise
    except R2bspecError as error:
        if not several:
            raise
        show_error(error)
        case = f"[{entry.selection.case}]" if entry.selection.case else ""
        spec = entry.selection.spec.name.removesuffix(".r2b.yaml")
        entry.name = entry.name or f"{spec}{case}{entry.suffix}"
        entry.error = error


def _playable(entries: Sequence[Entry], runs: Runs[Entry]) -> list[Entry]:
    playable = [entry for entry in entries if entry.error is None]
    return [] if runs.needs_all and len(playable) < len(entries) else playable


def announcement(entries: Sequence[SuiteEntry]) -> str:
    """Return the line that says how many runs there are, and how long they will take."""
    estimates = [entry.estimate for entry in entries if entry.estimate is not None]
    times = (sum(each.least_s for each in estimates), sum(each.seconds for each in estimates))
    return f"{pluralize(len(entries), 'run')}: {range_text(*times)}"


def _play_alone(entry: Entry, runs: Runs[Entry]) -> int:
    """Play a single run into the folder of the call; return the exit status of its verdict."""
    options, spec, name = runs.options, entry.selection.spec, runs.name(entry)
    entry.folder = folder = options.output or api.default_run_folder(name)
    with reported_failures(options, folder, spec):
        result = _play(entry, runs, options, name, after_s=0)
        show_differences(result, entry)
        if not takes_stdout(options.reports):
            from r2bspec.report.terminal import show_result

            show_result(result, options.output_format, folder, verbose=options.verbose)
        if options.output_format == "json" or takes_stdout(options.reports):
            echo(folder_line(folder), err=True)
        write_reports_of(options, folder, spec)
    return result.verdict.exit_code


def _play_all(entries: Sequence[Entry], runs: Runs[Entry], suite: Suite) -> Playing:
    """Play several entries in their order."""
    for number, entry in enumerate(entries):
        settled = suite.settled(entry)
        yield entry, settled or _play_next(number, entries, runs, suite)


def _play_next(number: int, entries: Sequence[Entry], runs: Runs[Entry], suite: Suite) -> SuiteRun:
    entry, options = entries[number], suite.options_of(entries[number])
    later_s = sum(later.seconds for later in entries[number + 1 :])
    title = f"[{number + 1}/{len(entries)}] {entry.name}"
    try:
        result = _play(entry, runs, options, title, after_s=later_s)
        if not options.quiet:
            echo(f"  {headline(result)}", err=True)
            first = notes(result)[:1] if result.verdict.outcome == "inconclusive" else ()
            for sentence in (*first, *result.gate):
                echo(f"  {sentence}", err=True)
        show_differences(result, entry)
        return suite.keep(entry, result, resumed=False)
    except InterruptedRunError as error:
        suite.add(entry, suite.failed(entry, error))
        raise
    except R2bspecError as error:
        show_error(error)
        return suite.failed(entry, error)


def _play(
    entry: Entry, runs: Runs[Entry], options: RunArguments, title: str, *, after_s: float
) -> Result:
    """Play an entry, with its progress shown.

    Args:
        entry: what is played.
        runs: how.
        options: with the reports of this run.
        title: what is said first, with the time that it will take.
        after_s: how long other runs will take then.

    Raises:
        R2bspecError: it failed; reports of what was observed have been written, and the error has
            the run folder as a note.
    """
    assert entry.estimate is not None  # noqa: S101 - what is played has been prepared
    folder = entry.folder
    if not options.quiet:
        echo(f"{title}: {entry.estimate.text()}", err=True)
    remaining = RemainingTime(entry.estimate, after_s=after_s)
    try:
        with shown_progress(quiet=options.quiet, remaining=remaining) as progress:
            return runs.play(entry, progress)
    except BaseException as error:
        if isinstance(error, api.GraphMismatchError):
            show_findings(error.diagnostics, error.loaded)
            # It follows findings, and not the sentence that it was the end of.
            details = error.details.removeprefix("; ")
            error.remainder = f"{details[:1].upper()}{details[1:]}"
        # A folder that was refused has the files of another run.
        if not isinstance(error, FolderTakenError) and folder.exists():
            error.add_note(folder_line(folder))
            if isinstance(error, R2bspecError):
                with contextlib.suppress(R2bspecError):
                    write_reports_of(options, folder, entry.selection.spec)
        raise


def show_differences(result: Result, entry: SuiteEntry) -> None:
    """Print differences between graph and spec that did not end the run."""
    from r2bspec.check.rule import differences_to_diagnostics

    if (loaded := entry.benchmark.loaded) is not None:
        show_findings(differences_to_diagnostics(result.differences, loaded), loaded)


@contextlib.contextmanager
def reported_failures(options: RunArguments, folder: Path | None, spec: Path) -> Iterator[None]:
    """Let the requested reports and ``--format json`` say why there is no run.

    The reports do so if not even the folder of the run was created. The JSON has the measurements,
    or else the error.

    Args:
        options: with the reports.
        folder: the folder of the run; None before it is known.
        spec: as the user named it.
    """
    try:
        yield
    except R2bspecError as error:
        # A report that is refused, as it would replace something, is not written here either.
        wanted = not isinstance(error, ReportUsageError)
        if wanted and (folder is None or not folder.exists()):
            with contextlib.suppress(R2bspecError):
                write_failure_reports(options.reports, error, spec)
        if options.output_format == "json" and not takes_stdout(options.reports):
            _print_failure(error, folder)
        raise


def _print_failure(error: R2bspecError, folder: Path | None) -> None:
    from r2bspec.compare.report_input import read_folder
    from r2bspec.report.terminal import show_result

    if folder is not None and folder.exists() and not isinstance(error, FolderTakenError):
        with contextlib.suppress(R2bspecError):
            show_result(read_folder(folder).result, "json")
            return
    echo_json(failure(error))
