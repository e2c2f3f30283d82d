"""Options that several verbs share."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

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

_case_option = click.option(
    "--case",
    default="",
    metavar="CASE",
    help="The case of the matrix, such as threads=2.",
)

_allow_path_option = click.option(
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


class SpecValues(NamedTuple):
    """The options of a spec on the command line; the arguments of `r2bspec.api.prepare`."""

    sets: tuple[str, ...] = ()
    variables: Mapping[str, str] = {}
    case: str = ""
    allow_paths: tuple[Path, ...] = ()


def spec_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add the options of a spec to a verb, which takes them as `values`, a `SpecValues`."""

    @sets_option
    @variables_option
    @_case_option
    @_allow_path_option
    @functools.wraps(command)
    def with_values(
        sets: tuple[str, ...],
        variables: tuple[str, ...],
        case: str,
        allow_paths: tuple[Path, ...],
        **others: Any,
    ) -> int:
        values = SpecValues(sets, parse_variables(variables), case, allow_paths)
        return command(values=values, **others)

    return with_values


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
