"""``r2bspec validate``: prove specs right before anything starts.

Nothing that a spec names is executed or imported. Findings go to standard output; the exit
status is 1 if there is an error among them, and 0 with warnings only.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

from r2bspec.cli.options import parse_variables, sets_option, variables_option
from r2bspec.report.findings.formats import FORMATS

if TYPE_CHECKING:
    from r2bspec.diagnostics import Diagnostic
    from r2bspec.spec.load import Loaded


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
@click.option(
    "--resolved",
    is_flag=True,
    help="Print the document with variables and merge keys written out, if it has no errors.",
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
    resolved: bool,
    offline: bool,
    fix: bool,
    diff: bool,
) -> int:
    """Check specs and show what is wrong with them.

    PATH is a file, a folder (all *.r2b.yaml below it), a pattern such as 'specs/*.yaml', or -
    for standard input.
    """
    from pathlib import Path

    from r2bspec.cli.spec_files import spec_files
    from r2bspec.spec.load import load_spec

    values = parse_variables(variables)
    files = spec_files(paths)

    def check_text(text: str, file: str) -> list[Diagnostic]:
        return _checked(load_spec(text, file=file, sets=sets, variables=values), offline=offline)

    if fix and (diff or "-" in files):
        raise click.UsageError("--fix writes files: it goes with neither --diff nor '-'")
    changes = 0
    if fix or diff:
        from r2bspec.cli.repairs import repair

        changes = repair(files, check_text, write=fix)
    if diff:
        return 1 if changes else 0
    loaded, found = [], []
    for file in files:
        one = load_spec(Path(file), sets=sets, variables=values)
        loaded.append(one)
        found.append(_checked(one, offline=offline))
    failed = any(each.severity == "error" for each in _flat(found))
    if resolved and not failed:
        _print_resolved(loaded)
    else:
        _print_findings(loaded, found, output_format, offline=offline)
    return 1 if failed else 0


def _checked(loaded: Loaded, *, offline: bool) -> list[Diagnostic]:
    if loaded.spec is None:
        return list(loaded.diagnostics)
    from r2bspec.check.engine import check

    return check(loaded, offline=offline)


def _print_findings(
    loaded: list[Loaded], found: list[list[Diagnostic]], output_format: str, *, offline: bool
) -> None:
    from r2bspec.report.findings import formats
    from r2bspec.report.findings.show import wants_colour

    everything = _flat(found)
    sources = {
        name: full
        for one, findings in zip(loaded, found, strict=True)
        if findings
        for name, full in one.texts.items()
    }
    colour = output_format == "text" and wants_colour(sys.stdout)
    names = [one.file for one in loaded]
    shown = formats.render(output_format, everything, sources, names, colour=colour)
    click.echo(shown, nl=False, color=colour)
    if output_format not in formats.DOCUMENTS:
        click.echo(_summary(loaded, everything, offline=offline))


def _summary(loaded: list[Loaded], found: list[Diagnostic], *, offline: bool) -> str:
    errors = sum(one.severity == "error" for one in found)
    warnings = sum(one.severity == "warning" for one in found)
    parts = [_counted(len(loaded), "file")]
    if errors or warnings:
        parts += [_counted(errors, "error"), _counted(warnings, "warning")]
    else:
        parts.append("no problems")
    line = ", ".join(parts)
    if any(one.spec is None for one in loaded):
        line += "; the graph is checked once the document itself is right"
    elif offline:
        line += "; rules that read recorded data were skipped (--offline)"
    return line


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _print_resolved(loaded: list[Loaded]) -> None:
    for number, one in enumerate(loaded):
        if len(loaded) > 1:
            click.echo(f"{'---' if number else ''}\n# {one.file}".strip())
        click.echo(one.resolved_yaml(), nl=False)


def _flat(found: list[list[Diagnostic]]) -> list[Diagnostic]:
    return [one for findings in found for one in findings]
