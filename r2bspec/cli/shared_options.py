"""Options that several verbs share."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from r2bspec.report.write_reports import ReportRequest

sets_option = click.option(
    "--set",
    "sets",
    multiple=True,
    metavar="PATH=VALUE",
    help="Replace a value of the spec, such as benchmark.iterations=3; may be repeated.",
)

variables_option = click.option(
    "--var",
    "variables",
    multiple=True,
    metavar="NAME=VALUE",
    help="Set a declared variable; may be repeated.",
)

case_option = click.option(
    "--case",
    default="",
    metavar="CASE",
    help="The case of the matrix, such as threads=2.",
)

allow_path_option = click.option(
    "--allow-path",
    "allow_paths",
    multiple=True,
    type=click.Path(path_type=Path, file_okay=False),
    metavar="PATH",
    help="A folder, besides that of the spec, from which files may be extended; may be repeated.",
)


def parse_variables(options: Iterable[str]) -> dict[str, str]:
    """Split ``NAME=VALUE`` options.

    Raises:
        click.UsageError: one has no equals sign.
    """
    found = {}
    for option in options:
        name, equals, value = option.partition("=")
        if not equals:
            raise click.UsageError(f"--var takes NAME=VALUE, not {option!r}")
        found[name] = value
    return found


def _parse_reports(
    _ctx: click.Context, _param: click.Parameter, options: tuple[str, ...]
) -> tuple[ReportRequest, ...]:
    if not options:
        return ()
    from r2bspec.report.write_reports import parse_report_requests

    return parse_report_requests(options)


reports_option = click.option(
    "--report",
    "reports",
    multiple=True,
    metavar="FORMAT=PATH",
    callback=_parse_reports,
    help="Write a report, such as html=report.html, or markdown=- for standard output; may be "
    "repeated. 'r2bspec report --formats' lists the formats.",
)


def _parse_junit(
    ctx: click.Context, param: click.Parameter, path: str | None
) -> tuple[ReportRequest, ...]:
    return _parse_reports(ctx, param, (f"junit={path}",) if path is not None else ())


junit_option = click.option(
    "--junit-xml",
    "junit",
    metavar="PATH",
    callback=_parse_junit,
    help="Same as --report junit=PATH, under the name used by ROS test runners.",
)
