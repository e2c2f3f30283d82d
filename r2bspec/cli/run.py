"""``r2bspec run``: run a benchmark on real ROS 2 and judge it by its SLOs."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.options import (
    allow_path_option,
    case_option,
    junit_option,
    parse_variables,
    reports_option,
    sets_option,
    variables_option,
)
from r2bspec.errors import R2bspecError

if TYPE_CHECKING:
    from r2bspec.report.write import Asked


@click.command("run")
@click.argument("spec", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--output",
    "-o",
    type=click.Path(path_type=Path, file_okay=False),
    help="The run folder; it must be new or empty.  [default: runs/NAME-TIME]",
)
@sets_option
@variables_option
@case_option
@allow_path_option
@click.option("--format", "output_format", type=click.Choice(["text", "json"]), default="text")
@click.option("--quiet", "-q", is_flag=True, help="Show no progress.")
@reports_option
@junit_option
def command(
    spec: Path,
    output: Path | None,
    sets: tuple[str, ...],
    variables: tuple[str, ...],
    case: str,
    allow_paths: tuple[Path, ...],
    output_format: str,
    quiet: bool,
    reports: tuple[Asked, ...],
    junit: tuple[Asked, ...],
) -> int:
    """Run SPEC and judge it by its SLOs.

    SPEC is a spec, or a plan that 'r2bspec plan' wrote. Progress goes to standard error, the
    report to standard output. Everything observed is kept in the run folder.
    """
    from r2bspec import api
    from r2bspec.report.findings.show import show
    from r2bspec.report.progress import shown_progress
    from r2bspec.report.terminal import show_result
    from r2bspec.report.write import takes_stdout, write_of_folder

    try:
        prepared = api.prepare(
            spec,
            sets=sets,
            variables=parse_variables(variables),
            case=case,
            allow_paths=allow_paths,
        )
    except api.InvalidSpecError as error:
        show(error.diagnostics, error.loaded.texts)
        raise
    if prepared.loaded is not None:
        show(prepared.diagnostics, prepared.loaded.texts)
    folder = output or api.new_folder(prepared.plan.name)
    try:
        with shown_progress(quiet=quiet) as progress:
            result = api.run(prepared, folder, progress)
    except R2bspecError:
        # What was observed until then is worth its reports; the failure is the one to tell.
        with contextlib.suppress(R2bspecError):
            write_of_folder(reports + junit, folder, spec)
        raise
    if not takes_stdout(reports + junit):
        show_result(result, output_format, folder)
    write_of_folder(reports + junit, folder, spec)
    return result.verdict.exit_code
