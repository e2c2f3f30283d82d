"""``r2bspec trend``: metrics of finished runs over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli import shared_options
from r2bspec.errors import ExitStatus
from r2bspec.report.output import echo_document

if TYPE_CHECKING:
    from r2bspec.report.write_reports import ReportRequest


@click.command("trend")
@click.argument("results", nargs=-1, required=True, type=click.Path(path_type=Path))
@shared_options.format_option("text", "json", "markdown")
@shared_options.reports_option
def command(
    results: tuple[Path, ...], output_format: str, reports: tuple[ReportRequest, ...]
) -> int:
    """Show how each metric of RESULTS changed over time, and since which commit.

    RESULTS are run folders, result.json files, or folders of them, such as the artifacts of a
    branch, in the order in which they were run. Results of different machines, versions or data
    are not compared. With {name} in its path, a report is written for each benchmark; its formats
    are text, json, markdown, html and csv, in the columns that Otava reads.

    The exit status is 0, whatever has changed.
    """
    from r2bspec.cli.suite import NAME_FIELD
    from r2bspec.compare.history import read_histories
    from r2bspec.report.format_registry import ReportUsageError
    from r2bspec.report.terminal import show_document
    from r2bspec.report.trend_document import TREND_FORMATS, render, trend_document
    from r2bspec.report.write_reports import check_targets, takes_stdout, write_report

    for request in reports:
        if request.format not in TREND_FORMATS:
            raise ReportUsageError(
                f"a history has no report {request.format}",
                hint=f"Formats: {', '.join(TREND_FORMATS)}.",
            )
    check_targets(reports, map(str, results))
    histories, left_out = read_histories(results)
    if not takes_stdout(reports):
        if output_format == "text":
            show_document(trend_document(histories, left_out))
        else:
            echo_document(render(output_format, histories, left_out), nl=False)
    for request in reports:
        if NAME_FIELD not in request.path:
            write_report(request.path, render(request.format, histories, left_out))
            continue
        for history in histories:
            path = request.path.replace(NAME_FIELD, history.name)
            write_report(path, render(request.format, [history], left_out))
    return ExitStatus.OK
