"""``r2bspec validate``: check specs before anything starts, once or whenever a file changes.

Nothing that a spec names is executed or imported. Findings are printed to standard output;
the exit status says whether one of them is an error.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Final, NoReturn

import click

from r2bspec.cli.check_files import (
    CheckOptions,
    FileReport,
    check_file,
    check_files,
    check_text,
    naming_the_file,
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
from r2bspec.safe_io.looked_up_files import Lookups, Stamp, looked_up_files, shared_lookups, stamp

if TYPE_CHECKING:
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
@click.option("--watch", is_flag=True, help="Check again whenever a file changes; end with Ctrl-C.")
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
    watch: bool,
) -> int:
    """Check specs and report problems.

    PATH is a file, a folder (all *.r2b.yaml below it), a pattern such as 'specs/*.yaml', or -
    for standard input. All cases of a matrix are checked, unless --case selects one.
    """
    from r2bspec.cli.internal_error import InternalError, WorkerEndedError

    check_options = CheckOptions(values, offline=offline, resolved=resolved)
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
    failed = any(finding.severity in failing for file in checked for finding in file.findings)
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
    check = partial(naming_the_file, partial(check_file, options=options))
    for checked in SpecWatch(partial(spec_files, paths), check).updates():
        _print_findings(checked, "text", offline=options.offline, quiet=quiet)
    raise AssertionError("updates end with an exception only")


def _print_findings(
    checked: list[FileReport], output_format: str, *, offline: bool, quiet: bool
) -> None:
    findings = [finding for file in checked for finding in file.findings]
    sources = {name: text for file in checked for name, text in file.texts.items()}
    print_findings(output_format, findings, sources, [file.file for file in checked])
    if not quiet and output_format not in DOCUMENT_FORMATS:
        echo(_summary(checked, findings, offline=offline))


def _summary(checked: list[FileReport], found: list[Diagnostic], *, offline: bool) -> str:
    errors = sum(finding.severity == "error" for finding in found)
    warnings = sum(finding.severity == "warning" for finding in found)
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


POLL_S: Final = 0.2
"""Time between two looks at the files: a system call for each."""


class SpecWatch:
    """The reports of specs, each kept as long as nothing changes that its check looked up.

    Args:
        find: lists the specs; it raises click.UsageError where there is none.
        check: makes the report of one.
    """

    def __init__(self, find: Callable[[], list[str]], check: Callable[[str], FileReport]) -> None:
        self._find = find
        self._check = check
        self._known: dict[str, tuple[FileReport, Lookups]] = {}
        self._stamps: dict[str, Stamp] = {}

    def updates(self) -> Iterator[list[FileReport]]:
        """All reports, now and whenever there is something new to tell; never ends.

        That is: a spec or a file that one names has been saved, even if the findings are the same,
        or the findings are others, even if only the installation has changed.

        Raises:
            click.UsageError: at the beginning there is no spec.
        """
        files = self._find()
        while True:
            changed = self._changed()
            stale = [file for file in files if self._is_stale(file, changed)]
            gone = self._known.keys() - set(files)
            with shared_lookups():
                told = [self._check_again(file, changed) for file in stale]
            if stale or gone:
                self._known = {file: self._known[file] for file in files}
                self._stamps = self._agreed_stamps()
            if any(told) or gone:
                yield [report for report, _ in self._known.values()]
            time.sleep(POLL_S)
            try:
                files = self._find()
            except click.UsageError:
                # An editor may remove a file before it writes a new one in its place.
                files = [*self._known]

    def _changed(self) -> set[str]:
        """The paths that are no longer what a check saw; each is looked at once for all specs."""
        return {path for path, before in self._stamps.items() if stamp(path) != before}

    def _is_stale(self, file: str, changed: set[str]) -> bool:
        known_stamp = self._known.get(file)
        return known_stamp is None or not changed.isdisjoint(known_stamp[1].files)

    def _check_again(self, file: str, changed: set[str]) -> bool:
        """Make a new report; returns whether there is something new to tell."""
        before = self._known.get(file)
        with looked_up_files() as seen:
            report = self._check(file)
        self._known[file] = report, seen
        return before is None or report != before[0] or not changed.isdisjoint(before[1].read)

    def _agreed_stamps(self) -> dict[str, Stamp]:
        """What the checks saw; of a path that changed between two of them, what the first saw."""
        stamps: dict[str, Stamp] = {}
        for _, seen in self._known.values():
            for path, file_stamp in seen.files.items():
                if stamps.setdefault(path, file_stamp) != file_stamp:
                    # Not what it is now for one of them: both are checked again.
                    stamps[path] = _NEVER
        return stamps


_NEVER: Final = (-1, -1, -1, -1)
"""The stamp of no file."""
