"""``r2bspec run``: run a benchmark on real ROS 2 and judge it by its SLOs."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.shared_options import (
    SpecValues,
    junit_option,
    max_bytes_option,
    reports_option,
    spec_options,
)
from r2bspec.cli.spec_selection import SpecSelection, base_selection, prepare_and_report
from r2bspec.errors import R2bspecError

if TYPE_CHECKING:
    from r2bspec.report.write_reports import ReportRequest


@click.command("run")
@click.argument("spec", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--output",
    "-o",
    type=click.Path(path_type=Path, file_okay=False),
    help="The run folder, new or empty.  [default: runs/NAME-TIME]",
)
@spec_options
@max_bytes_option
@click.option(
    "--against",
    "against",
    multiple=True,
    metavar="REF",
    help="Compare with a base in interleaved runs: another spec, var:NAME=VALUE, set:PATH=VALUE, "
    "or env: with a setup file, an installed workspace or NAME=VALUE; may be repeated.",
)
@click.option("--control", is_flag=True, help="Compare SPEC with itself to see the noise.")
@click.option(
    "--pairs",
    type=click.IntRange(min=1),
    help="The number of pairs of runs to compare.  [default: benchmark.iterations]",
)
@click.option(
    "--history",
    metavar="FILE",
    help="Gate by the earlier runs in FILE and add this one; 'user' is a file in your data folder.",
)
@click.option(
    "--baseline",
    type=click.Path(path_type=Path),
    metavar="RUN",
    help="Compare with a stored run or result; advisory, never gates.",
)
@click.option("--force", is_flag=True, help="Compare even if load, plan, data or machine differ.")
@click.option(
    "--format",
    "output_format",
    type=click.Choice(["text", "json"]),
    default="text",
    show_default=True,
    help="The output format.",
)
@click.option("--quiet", "-q", is_flag=True, help="Show no progress.")
@reports_option
@junit_option
def command(
    spec: Path,
    output: Path | None,
    values: SpecValues,
    against: tuple[str, ...],
    control: bool,
    pairs: int | None,
    history: str | None,
    baseline: Path | None,
    force: bool,
    output_format: str,
    quiet: bool,
    reports: tuple[ReportRequest, ...],
    junit: tuple[ReportRequest, ...],
) -> int:
    """Run SPEC and judge it by its SLOs.

    SPEC is a spec, or a plan written by 'r2bspec plan'. Progress is printed to standard error, the
    report to standard output. All samples and logs are stored in the run folder.

    Requirements 'of baseline' are judged by interleaved runs of a base and of SPEC (--against), or
    by earlier runs (--history). Without either they are inconclusive.
    """
    from r2bspec import api
    from r2bspec.cli.history import history_file
    from r2bspec.record.errors import FolderTakenError
    from r2bspec.report.findings.print_findings import show
    from r2bspec.report.progress_display import shown_progress
    from r2bspec.report.terminal import show_result
    from r2bspec.report.write_reports import takes_stdout, write_folder_reports

    is_comparison = bool(against) or control
    _check_option_conflicts(against, control, pairs, history, baseline, force=force)
    selection = SpecSelection(spec, *values)
    prepared = prepare_and_report(selection)
    name = f"{prepared.plan.name}-pairs" if is_comparison else prepared.plan.name
    folder = output or api.default_run_folder(name)
    stored = None
    if baseline is not None:
        stored = api.stored_baseline(baseline, prepared, force=force)
    try:
        with shown_progress(quiet=quiet) as progress:
            if is_comparison:
                result = api.run_pairs(
                    prepared,
                    against,
                    folder,
                    progress,
                    prepare_base=lambda reference: prepare_and_report(
                        base_selection(selection, reference)
                    ),
                    pairs=pairs,
                    control=control,
                    force=force,
                )
            else:
                history_path = history_file(history) if history is not None else None
                result = api.run(prepared, folder, progress, history=history_path, baseline=stored)
    except R2bspecError as error:
        if isinstance(error, api.GraphMismatchError):
            show(error.diagnostics, error.loaded.texts)
        # Reports are written of what was observed; the failure of the run is reported. A folder
        # that was refused has the files of another run.
        if not isinstance(error, FolderTakenError):
            with contextlib.suppress(R2bspecError):
                write_folder_reports(reports + junit, folder, spec)
        raise
    if prepared.loaded is not None:
        # Harmless differences did not end the run, and are shown.
        show(api.differences_to_diagnostics(result, prepared.loaded), prepared.loaded.texts)
    if not takes_stdout(reports + junit):
        show_result(result, output_format, folder)
    write_folder_reports(reports + junit, folder, spec)
    return result.verdict.exit_code


def _check_option_conflicts(
    against: tuple[str, ...],
    control: bool,
    pairs: int | None,
    history: str | None,
    baseline: Path | None,
    *,
    force: bool,
) -> None:
    """Report options that exclude each other, or need another one.

    Raises:
        click.UsageError: there are some.
    """
    if against and control:
        raise click.UsageError(
            "--control cannot be combined with --against: it compares SPEC with itself"
        )
    comparisons = {
        "--against": bool(against),
        "--control": control,
        "--history": history is not None,
        "--baseline": baseline is not None,
    }
    used_options = [name for name, given in comparisons.items() if given]
    if len(used_options) > 1:
        raise click.UsageError(
            f"{' and '.join(used_options)} cannot be combined: choose one comparison"
        )
    if pairs is not None and not (against or control):
        raise click.UsageError("--pairs needs --against or --control")
    if force and not (against or baseline is not None):
        raise click.UsageError("--force needs --against or --baseline")
