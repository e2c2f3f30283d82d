"""``r2bspec validate``: check specs before anything starts.

Nothing that a spec names is executed or imported. Findings are printed to standard output;
the exit status says whether one of them is an error.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, NoReturn

import click

from r2bspec.cli.shared_options import SpecValues, max_bytes_option, spec_options
from r2bspec.exit_status import ExitStatus
from r2bspec.report.finding_formats import FORMATS
from r2bspec.report.output import echo, echo_document

if TYPE_CHECKING:
    from r2bspec.cli.file_report import CheckOptions, FileReport
    from r2bspec.diagnostics import Diagnostic
    from r2bspec.errors import R2bspecError


@click.command("validate")
@click.argument("paths", nargs=-1, required=True, metavar="PATH...")
@click.option(
    "--format",
    "output_format",
    type=click.Choice(list(FORMATS)),
    default="text",
    help="; ".join(f"{name}: {use}" for name, use in FORMATS.items()) + ".",
)
@spec_options
@max_bytes_option
@click.option(
    "--resolved",
    is_flag=True,
    help="Print the resolved document, one for each case, if there are no errors.",
)
@click.option(
    "--offline", is_flag=True, help="Do not read recorded data; skip the rules that need it."
)
@click.option("--fix", is_flag=True, help="Apply safe fixes to the files.")
@click.option("--diff", is_flag=True, help="Show the changes of --fix without writing them.")
@click.option("--strict", is_flag=True, help="Warnings fail, too.")
@click.option(
    "--require-slos", is_flag=True, help="A spec without an objective that can fail is an error."
)
@click.option(
    "--quiet", "-q", is_flag=True, help="Print nothing but findings: no summary at the end."
)
@click.option("--watch", is_flag=True, help="Check again whenever a file changes; end with Ctrl-C.")
def command(
    paths: tuple[str, ...],
    output_format: str,
    values: SpecValues,
    resolved: bool,
    offline: bool,
    fix: bool,
    diff: bool,
    strict: bool,
    require_slos: bool,
    quiet: bool,
    watch: bool,
) -> int:
    """Check specs and report problems.

    PATH is a file, a folder (all *.r2b.yaml below it), a pattern such as 'specs/*.yaml', or -
    for standard input. All cases of a matrix are checked, unless --case selects one.
    """
    from r2bspec.cli.check_files import check_files, check_text
    from r2bspec.cli.file_report import CheckOptions
    from r2bspec.cli.internal_error import InternalError, WorkerEndedError
    from r2bspec.cli.spec_files import spec_files

    check_options = CheckOptions(
        *values, offline=offline, resolved=resolved, require_slos=require_slos
    )
    if watch:
        if fix or diff or resolved or output_format != "text" or "-" in paths:
            raise click.UsageError(
                "--watch prints findings as text; it cannot be combined with --fix, --diff, "
                "--resolved, another --format or '-'"
            )
        _watch(paths, check_options, quiet=quiet)
    files = spec_files(paths)
    if fix and (diff or "-" in files):
        raise click.UsageError("--fix cannot be combined with --diff or with '-'")
    if fix or diff:
        from r2bspec.cli.fix import repair

        changes = repair(files, lambda text, file: check_text(text, file, check_options), write=fix)
        if diff:
            return ExitStatus.FINDINGS_OR_FAILED if changes else ExitStatus.OK
    checked: list[FileReport] = []
    crash: R2bspecError | None = None
    try:
        checked.extend(check_files(files, check_options))
    except (InternalError, WorkerEndedError) as error:
        crash = error
    failing = {"error", "warning"} if strict else {"error"}
    failed = any(one.severity in failing for each in checked for one in each.findings)
    if resolved and not failed and crash is None:
        _print_resolved(checked)
    else:
        _print_findings(checked, output_format, offline=offline, quiet=quiet)
    if crash is not None:
        # One file that r2bspec cannot check does not hide what is wrong with the others.
        raise crash
    return ExitStatus.FINDINGS_OR_FAILED if failed else ExitStatus.OK


def _watch(paths: tuple[str, ...], options: CheckOptions, *, quiet: bool) -> NoReturn:
    """Print the findings of all files, now and after each change, until Ctrl-C."""
    from functools import partial

    from r2bspec.cli.check_files import check_file, naming_the_file
    from r2bspec.cli.spec_files import spec_files
    from r2bspec.cli.spec_watch import SpecWatch

    check = partial(naming_the_file, partial(check_file, options=options))
    for checked in SpecWatch(partial(spec_files, paths), check).updates():
        _print_findings(checked, "text", offline=options.offline, quiet=quiet)
    raise AssertionError("updates end with an exception only")


def _print_findings(
    checked: list[FileReport], output_format: str, *, offline: bool, quiet: bool
) -> None:
    from r2bspec.report import finding_formats
    from r2bspec.report.findings_text import wants_colour

    found = [one for each in checked for one in each.findings]
    sources = {name: text for each in checked for name, text in each.texts.items()}
    colour = output_format == "text" and wants_colour(sys.stdout)
    names = [each.file for each in checked]
    shown = finding_formats.render(output_format, found, sources, names, colour=colour)
    if output_format in {"json", "sarif"}:
        echo_document(shown, nl=False)
    else:
        echo(shown, nl=False, styled=colour, commands=output_format == "github")
    if not quiet and output_format not in finding_formats.DOCUMENT_FORMATS:
        echo(_summary(checked, found, offline=offline))


def _summary(checked: list[FileReport], found: list[Diagnostic], *, offline: bool) -> str:
    errors = sum(one.severity == "error" for one in found)
    warnings = sum(one.severity == "warning" for one in found)
    parts = [_pluralize(len(checked), "file")]
    cases = sum(each.cases for each in checked)
    if cases > len(checked):
        parts.append(_pluralize(cases, "case"))
    if errors or warnings:
        parts += [_pluralize(errors, "error"), _pluralize(warnings, "warning")]
    else:
        parts.append("no problems")
    line = ", ".join(parts)
    if not all(each.complete for each in checked):
        line += "; the graph was not checked, because the document has errors"
    elif offline:
        line += "; rules that read recorded data were skipped (--offline)"
    return line


def _pluralize(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _print_resolved(checked: list[FileReport]) -> None:
    documents = [(name, text) for each in checked for name, text in each.resolved.items()]
    for number, (name, text) in enumerate(documents):
        if len(documents) > 1:
            echo(f"{'---' if number else ''}\n# {name}".strip())
        echo(text, nl=False)
