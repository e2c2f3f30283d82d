"""Options that several verbs share."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from r2bspec.cli.completions import complete_case, complete_report, complete_variable

if TYPE_CHECKING:
    from r2bspec.language.environment_access import UntrustedSpecs
    from r2bspec.report.write_reports import ReportRequest

sets_option = click.option(
    "--set",
    "sets",
    multiple=True,
    metavar="PATH=VALUE",
    help="Set a value of the spec, such as benchmark.iterations=3; may be repeated.",
)

variables_option = click.option(
    "--var",
    "variables",
    multiple=True,
    metavar="NAME=VALUE",
    shell_complete=complete_variable,
    help="Set a declared variable; may be repeated.",
)

_case_option = click.option(
    "--case",
    default="",
    metavar="CASE",
    shell_complete=complete_case,
    help="The case of the matrix, such as threads=2; for 'run' also all.",
)

_allow_path_option = click.option(
    "--allow-path",
    "allow_paths",
    multiple=True,
    type=click.Path(path_type=Path, file_okay=False),
    metavar="PATH",
    help="A folder, besides that of the spec, from which files may be extended; may be repeated.",
)


_untrusted_option = click.option(
    "--untrusted",
    is_flag=True,
    help="SPEC is a stranger's: it may read no environment variable that --base-ref does not list.",
)

_base_ref_option = click.option(
    "--base-ref",
    default="",
    metavar="REF",
    help="With --untrusted: the commit that the change is based on, such as origin/main.",
)


def _parse_max_bytes(ctx: click.Context, param: click.Parameter, text: str | None) -> int | None:
    """The bytes of ``--max-bytes``; the limit then applies until the verb has ended."""
    if text is None:
        return None
    from r2bspec.language.quantities import parse_size_option
    from r2bspec.safe_io.decompression_budget import max_unpacked_bytes

    try:
        max_bytes = parse_size_option(text)
    except ValueError as error:
        raise click.BadParameter(str(error), ctx, param) from error
    ctx.with_resource(max_unpacked_bytes(max_bytes))
    return max_bytes


max_bytes_option = click.option(
    "--max-bytes",
    metavar="SIZE",
    callback=_parse_max_bytes,
    expose_value=False,
    help="The most that each file of a bag may unpack to, such as '4 GiB'.  [default: 512 MiB, or "
    "1,000 times its size]",
)


def connection_options(command: Callable[..., int]) -> Callable[..., int]:
    """The options of a connection to a scheduler."""
    for option in (
        click.option(
            "--insecure",
            is_flag=True,
            help="Connect to a scheduler on another machine without TLS; every machine of the "
            "network is trusted then.",
        ),
        click.option(
            "--key",
            type=click.Path(path_type=Path, dir_okay=False),
            help="Of a tls:// scheduler: the private key of --certificate.",
        ),
        click.option(
            "--certificate",
            type=click.Path(path_type=Path, dir_okay=False),
            help="Of a tls:// scheduler: the certificate that this command shows, such as "
            "client.pem.",
        ),
        click.option(
            "--ca",
            type=click.Path(path_type=Path, dir_okay=False),
            help="Of a tls:// scheduler: the certificate of the fleet's authority, ca.pem.",
        ),
    ):
        command = option(command)
    return command


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
    untrusted: UntrustedSpecs | None = None


def spec_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add the options of a spec to a verb, which takes them as `values`, a `SpecValues`."""

    @sets_option
    @variables_option
    @_case_option
    @_allow_path_option
    @_untrusted_option
    @_base_ref_option
    @functools.wraps(command)
    def with_values(
        sets: tuple[str, ...],
        variables: tuple[str, ...],
        case: str,
        allow_paths: tuple[Path, ...],
        untrusted: bool,
        base_ref: str,
        **others: Any,
    ) -> int:
        stranger = None
        if untrusted or base_ref:
            from r2bspec.language.environment_access import untrusted_specs

            stranger = untrusted_specs(Path.cwd(), untrusted=untrusted, base_ref=base_ref)
        values = SpecValues(sets, parse_variables(variables), case, allow_paths, stranger)
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
    shell_complete=complete_report,
    help="Write a report, such as html=report.html, or markdown=- for standard output; may be "
    "repeated. 'r2bspec report --formats' lists the formats.",
)


verbose_option = click.option(
    "--verbose",
    is_flag=True,
    help="The reason of each requirement, and all notes; without it a report has five.",
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
