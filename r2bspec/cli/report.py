"""``r2bspec report``: write reports of a finished run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.shared_options import junit_option, reports_option, verbose_option
from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.report.write_reports import ReportRequest


def _list_formats(ctx: click.Context, _param: click.Parameter, list_formats: bool) -> None:
    if not list_formats:
        return
    from r2bspec.report.format_registry import FORMATS

    width = max(map(len, FORMATS))
    for name, each in FORMATS.items():
        echo(f"{name:{width}}  {each.what}")
    ctx.exit()


@click.command("report")
@click.argument("run", type=click.Path(path_type=Path))
@reports_option
@junit_option
@verbose_option
@click.option(
    "--spec",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="SPEC",
    help="The spec of the run, so that annotations can refer to its lines.",
)
@click.option(
    "--against",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="BASE",
    help="Another run folder, shown next to RUN where a report supports it (html).",
)
@click.option(
    "--formats",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list_formats,
    help="List the formats and exit.",
)
def command(
    run: Path,
    reports: tuple[ReportRequest, ...],
    junit: tuple[ReportRequest, ...],
    verbose: bool,
    spec: Path | None,
    against: Path | None,
) -> int:
    """Write reports of RUN: the folder of a run or a comparison, or a result.json.

    A result.json gives fewer charts than the folder, which has every message. The exit status says
    whether the reports were written; for the verdict, use 'r2bspec judge'.
    """
    from r2bspec.compare.report_input import read_report_input
    from r2bspec.record.run_folder import open_run
    from r2bspec.report.errors import ReportUsageError
    from r2bspec.report.write_reports import write_reports

    requests = reports + junit
    if not requests:
        raise ReportUsageError(
            "no report was requested", hint="Name a format and a file: --report html=report.html"
        )
    baseline = open_run(against) if against is not None else None
    found = read_report_input(run, spec_file=spec, baseline=baseline)
    write_reports(requests, replace(found, verbose=verbose))
    return ExitStatus.OK
