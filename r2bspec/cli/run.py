"""``r2bspec run``: run a benchmark on real ROS 2 and judge it by its SLOs."""

from __future__ import annotations

from pathlib import Path

import click

from r2bspec.cli.options import parse_variables, sets_option, variables_option


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
@click.option("--format", "output_format", type=click.Choice(["text", "json"]), default="text")
@click.option("--quiet", "-q", is_flag=True, help="Show no progress.")
def command(
    spec: Path,
    output: Path | None,
    sets: tuple[str, ...],
    variables: tuple[str, ...],
    output_format: str,
    quiet: bool,
) -> int:
    """Run SPEC and judge it by its SLOs.

    SPEC is a spec, or a plan that 'r2bspec plan' wrote. Progress goes to standard error, the
    report to standard output. Everything observed is kept in the run folder.
    """
    from r2bspec import api
    from r2bspec.report.findings.show import show
    from r2bspec.report.progress import shown_progress
    from r2bspec.report.terminal import show_result

    try:
        prepared = api.prepare(spec, sets=sets, variables=parse_variables(variables))
    except api.InvalidSpecError as error:
        show(error.diagnostics, error.loaded.texts)
        raise
    if prepared.loaded is not None:
        show(prepared.diagnostics, prepared.loaded.texts)
    folder = output or api.new_folder(prepared.plan.name)
    with shown_progress(quiet=quiet) as progress:
        result = api.run(prepared, folder, progress)
    show_result(result, output_format, folder)
    return result.verdict.exit_code
