"""``r2bspec validate``: prove specs right before anything starts.

Nothing that a spec names is executed or imported. Findings go to standard output; the exit
status is 1 if there is an error among them, and 0 with warnings only.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.shared_options import (
    allow_path_option,
    base_ref_option,
    case_option,
    parse_variables,
    sets_option,
    untrusted_option,
    untrusted_specs,
    variables_option,
)
from r2bspec.report.findings.finding_formats import FORMATS

if TYPE_CHECKING:
    from r2bspec.cli.check_files import FileReport
    from r2bspec.diagnostics import Diagnostic


@click.command("validate")
@click.argument("paths", nargs=-1, required=True, metavar="PATH...")
@click.option(
    "--format",
    "output_format",
    type=click.Choice(list(FORMATS)),
    default="text",
    help="; ".join(f"{name}: {use}" for name, use in FORMATS.items()) + ".",
)
@sets_option
@variables_option
@case_option
@allow_path_option
@untrusted_option
@base_ref_option
@click.option(
    "--resolved",
    is_flag=True,
    help="Print the document, every case of it, with all written out, if it has no errors.",
)
@click.option("--offline", is_flag=True, help="Leave recorded data alone; skip what needs it.")
@click.option(
    "--fix", is_flag=True, help="Make the repairs that are safe, in the files themselves."
)
@click.option("--diff", is_flag=True, help="Show what --fix would change; write nothing.")
def command(
    paths: tuple[str, ...],
    output_format: str,
    sets: tuple[str, ...],
    variables: tuple[str, ...],
    case: str,
    allow_paths: tuple[Path, ...],
    untrusted: bool,
    base_ref: str,
    resolved: bool,
    offline: bool,
    fix: bool,
    diff: bool,
) -> int:
    """Check specs and show what is wrong with them.

    PATH is a file, a folder (all *.r2b.yaml below it), a pattern such as 'specs/*.yaml', or -
    for standard input. Of a spec with a matrix every case is checked, unless --case names one.
    """
    from r2bspec.cli.check_files import CheckOptions, check_files, check_text
    from r2bspec.cli.spec_files import spec_files

    check_options = CheckOptions(
        sets=sets,
        variables=parse_variables(variables),
        case=case,
        allow_paths=allow_paths,
        offline=offline,
        resolved=resolved,
        untrusted=untrusted_specs(untrusted=untrusted, base_ref=base_ref),
    )
    files = spec_files(paths)
    if fix and (diff or "-" in files):
        raise click.UsageError("--fix writes files: it goes with neither --diff nor '-'")
    if fix or diff:
        from r2bspec.cli.fix import repair

        changes = repair(files, lambda text, file: check_text(text, file, check_options), write=fix)
        if diff:
            return 1 if changes else 0
    checked = list(check_files(files, check_options))
    failed = any(one.severity == "error" for each in checked for one in each.findings)
    if resolved and not failed:
        _print_resolved(checked)
    else:
        _print_findings(checked, output_format, offline=offline)
    return 1 if failed else 0


def _print_findings(checked: list[FileReport], output_format: str, *, offline: bool) -> None:
    from r2bspec.report.findings import finding_formats
    from r2bspec.report.findings.print_findings import wants_colour

    found = [one for each in checked for one in each.findings]
    sources = {name: text for each in checked for name, text in each.texts.items()}
    colour = output_format == "text" and wants_colour(sys.stdout)
    names = [each.file for each in checked]
    shown = finding_formats.render(output_format, found, sources, names, colour=colour)
    click.echo(shown, nl=False, color=colour)
    if output_format not in finding_formats.DOCUMENT_FORMATS:
        click.echo(_summary(checked, found, offline=offline))


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
        line += "; the graph is checked once the document itself is right"
    elif offline:
        line += "; rules that read recorded data were skipped (--offline)"
    return line


def _pluralize(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _print_resolved(checked: list[FileReport]) -> None:
    documents = [(name, text) for each in checked for name, text in each.resolved.items()]
    for number, (name, text) in enumerate(documents):
        if len(documents) > 1:
            click.echo(f"{'---' if number else ''}\n# {name}".strip())
        click.echo(text, nl=False)
