"""``r2bspec validate``: check specs before anything starts.

Nothing that a spec names is executed or imported. Findings are printed to standard output;
the exit status says whether one of them is an error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from r2bspec.cli.check_files import (
    CheckOptions,
    FileReport,
    check_files,
    check_text,
    repair,
    spec_files,
)
from r2bspec.cli.shared_options import flag_options, spec_options
from r2bspec.cli.text_output import print_findings
from r2bspec.diagnostics.quote import pluralize
from r2bspec.errors import ExitStatus
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.report.finding_formats import DOCUMENT_FORMATS, FORMATS
from r2bspec.report.output import echo

if TYPE_CHECKING:
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
@spec_options
@flag_options(
    {
        "--resolved": "Print the resolved document, one for each case, if there are no errors.",
        "--offline": "Do not read recorded data; skip the rules that need it.",
        "--fix": "Apply safe fixes to the files.",
        "--diff": "Show the changes of --fix without writing them.",
        "--strict": "Warnings fail, too.",
    }
)
@click.option(
    "--quiet", "-q", is_flag=True, help="Print nothing but findings: no summary at the end."
)
def command(
    paths: tuple[str, ...],
    output_format: str,
    values: SelectionValues,
    resolved: bool,
    offline: bool,
    fix: bool,
    diff: bool,
    strict: bool,
    quiet: bool,
) -> int:
    """Check specs and report problems.

    PATH is a file, a folder (all *.r2b.yaml below it), a pattern such as 'specs/*.yaml', or -
    for standard input. All cases of a matrix are checked, unless --case selects one.
    """
    check_options = CheckOptions(values, offline=offline, resolved=resolved)
    files = spec_files(paths)
    if fix and (diff or "-" in files):
        raise click.UsageError("--fix cannot be combined with --diff or with '-'")
    if fix or diff:
        changes = repair(files, lambda text, file: check_text(text, file, check_options), write=fix)
        if diff:
            return ExitStatus.FINDINGS_OR_FAILED if changes else ExitStatus.OK
    checked = list(check_files(files, check_options))
    failing = {"error", "warning"} if strict else {"error"}
    failed = any(finding.severity in failing for file in checked for finding in file.findings)
    if resolved and not failed:
        _print_resolved(checked)
    else:
        _print_findings(checked, output_format, offline=offline, quiet=quiet)
    return ExitStatus.FINDINGS_OR_FAILED if failed else ExitStatus.OK


def _print_findings(
    checked: list[FileReport], output_format: str, *, offline: bool, quiet: bool
) -> None:
    findings = [finding for file in checked for finding in file.findings]
    sources = {name: text for file in checked for name, text in file.texts.items()}
    print_findings(output_format, findings, sources, [file.file for file in checked])
    if not quiet and output_format not in DOCUMENT_FORMATS:
        echo(_summary(checked, findings, offline=offline))


def _summary(checked: list[FileReport], findings: list[Diagnostic], *, offline: bool) -> str:
    errors = sum(finding.severity == "error" for finding in findings)
    warnings = sum(finding.severity == "warning" for finding in findings)
    parts = [pluralize(len(checked), "file")]
    cases = sum(file.cases for file in checked)
    if cases > len(checked):
        parts.append(pluralize(cases, "case"))
    if errors or warnings:
        parts += [pluralize(errors, "error"), pluralize(warnings, "warning")]
    else:
        parts.append("no problems")
    line = ", ".join(parts)
    if not all(file.complete for file in checked):
        line += "; the graph was not checked, because the document has errors"
    elif offline:
        line += "; rules that read recorded data were skipped (--offline)"
    return line


def _print_resolved(checked: list[FileReport]) -> None:
    documents = [(name, text) for file in checked for name, text in file.resolved.items()]
    for number, (name, text) in enumerate(documents):
        if len(documents) > 1:
            if number:
                echo("---")
            echo(f"# {name}")
        echo(text, nl=False)
