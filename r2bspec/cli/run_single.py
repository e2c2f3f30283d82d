"""A run of ``r2bspec run``, or a comparison in pairs: played, reported, and its folder named."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from r2bspec.cli.spec_selection import SpecSelection, base_selection, prepare_and_report
from r2bspec.cli.text_output import queued_host, show_findings
from r2bspec.errors import R2bspecError
from r2bspec.report.output import echo, echo_json

if TYPE_CHECKING:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.cli.run import RunArguments
    from r2bspec.execute.states import Progress
    from r2bspec.judge.result import Result
    from r2bspec.plan.time_estimate import TimeEstimate
    from r2bspec.report.progress import RemainingTime


def run_single(selection: SpecSelection, options: RunArguments) -> int:
    """Run a spec, or compare it, and return the exit status of the verdict.

    Raises:
        R2bspecError: it could not be run; with the run folder as a note, where there is one.
    """
    with reported_failures(options, folder := OutputFolder(), selection.spec):
        return _run(selection, options, folder)


def _run(selection: SpecSelection, options: RunArguments, folder: OutputFolder) -> int:
    from r2bspec import api
    from r2bspec.report.progress import RemainingTime

    with options.sparing_inputs():
        prepared = prepare_and_report(selection, smoke=options.smoke, infos=options.verbose)
    name = prepared.plan.name
    name += "-pairs" if options.compares else "-smoke" if options.smoke else ""
    path = folder.path = options.output or api.default_run_folder(name)
    estimate = estimate_of(prepared, options)
    with queued_host(name, estimate.seconds, options.wait_s, quiet=options.quiet):
        if not options.quiet:
            echo(f"{name}: {estimate.text()}", err=True)
        result = execute(
            options,
            path,
            selection.spec,
            RemainingTime(estimate),
            lambda progress: play(prepared, selection, options, path, progress),
        )
    show(result, prepared, options, path, selection.spec)
    return result.verdict.exit_code


def show(
    result: Result, prepared: PreparedBenchmark, options: RunArguments, folder: Path, spec: Path
) -> None:
    """Print a result, and write its reports."""
    from r2bspec.report.terminal import show_result
    from r2bspec.report.write_reports import takes_stdout

    show_differences(result, prepared)
    if not takes_stdout(options.reports):
        show_result(result, options.output_format, folder, verbose=options.verbose)
    if options.output_format == "json" or takes_stdout(options.reports):
        echo(folder_line(folder), err=True)
    write_reports_of(options, folder, spec)


class OutputFolder:
    """The run folder, once it is known."""

    path: Path | None = None


def folder_line(folder: Path) -> str:
    """Return the line that names a run folder."""
    return f"run folder: {folder}"


def estimate_of(prepared: PreparedBenchmark, options: RunArguments) -> TimeEstimate:
    """Return how long the run of a spec will take, or its comparison with another."""
    from r2bspec.plan.time_estimate import estimate_time

    if not options.compares:
        return estimate_time(prepared.plan)
    from r2bspec.compare.comparison_time import estimate_comparison

    return estimate_comparison(prepared.plan, options.pairs)


def execute(
    options: RunArguments,
    folder: Path,
    spec: Path,
    remaining: RemainingTime | None,
    play: Callable[[Progress], Result],
) -> Result:
    """Play a run or a comparison, and show its progress. The caller has the lock of the host.

    Args:
        options: of the run.
        folder: receives what is measured.
        spec: as the user named it.
        remaining: the expected time, for the progress that is shown.
        play: makes it.

    Raises:
        R2bspecError: it failed; reports of what was observed have been written, and the error has
            the run folder as a note.
    """
    from r2bspec import api
    from r2bspec.record.files import FolderTakenError
    from r2bspec.report.progress import shown_progress

    try:
        with shown_progress(quiet=options.quiet, remaining=remaining) as progress:
            return play(progress)
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
                    write_reports_of(options, folder, spec)
        raise


def play(
    prepared: PreparedBenchmark,
    selection: SpecSelection,
    options: RunArguments,
    folder: Path,
    progress: Progress,
) -> Result:
    """Run a spec, or compare it with another, as `execute` asks for."""
    from r2bspec import api

    if not options.compares:
        return api.run(prepared, folder, progress, wait_s=None, **_ways(options))
    return api.run_pairs(
        prepared,
        options.against,
        folder,
        progress,
        prepare_base=lambda reference: prepare_and_report(base_selection(selection, reference)),
        pairs=options.pairs,
        control=options.control,
        force=options.force,
        wait_s=None,
    )


def _ways(options: RunArguments) -> dict[str, Any]:
    """Return how a single run is made, as arguments of `api.run`."""
    return {
        "anatomy": options.anatomy,
        "profile": options.profile or "",
    }


def show_differences(result: Result, prepared: PreparedBenchmark) -> None:
    """Print differences between graph and spec that did not end the run."""
    from r2bspec.check.rule import differences_to_diagnostics

    if prepared.loaded is not None:
        show_findings(
            differences_to_diagnostics(result.differences, prepared.loaded), prepared.loaded
        )


def write_reports_of(options: RunArguments, folder: Path, spec: Path) -> None:
    """Write the requested reports of a run folder."""
    from r2bspec.report.write_reports import write_folder_reports

    write_folder_reports(
        options.reports,
        folder,
        spec,
        verbose=options.verbose,
        suite_page=options.suite_page,
    )


@contextlib.contextmanager
def reported_failures(options: RunArguments, folder: OutputFolder, spec: Path) -> Iterator[None]:
    """Let the requested reports and ``--format json`` say why there is no run.

    The reports do so if not even the folder of the run was created. The JSON has the measurements,
    or else the error.
    """
    try:
        yield
    except R2bspecError as error:
        from r2bspec.report.format_registry import ReportUsageError
        from r2bspec.report.write_reports import takes_stdout, write_failure_reports

        # A report that is refused, as it would replace something, is not written here either.
        wanted = not isinstance(error, ReportUsageError)
        if wanted and (folder.path is None or not folder.path.exists()):
            with contextlib.suppress(R2bspecError):
                write_failure_reports(options.reports, error, spec)
        if options.output_format == "json" and not takes_stdout(options.reports):
            _print_failure(error, folder.path)
        raise


def _print_failure(error: R2bspecError, folder: Path | None) -> None:
    from r2bspec.compare.report_input import read_folder
    from r2bspec.record.files import FolderTakenError
    from r2bspec.report.terminal import show_result
    from r2bspec.report.write_reports import failure

    if folder is not None and folder.exists() and not isinstance(error, FolderTakenError):
        with contextlib.suppress(R2bspecError):
            show_result(read_folder(folder).result, "json")
            return
    echo_json(failure(error))
