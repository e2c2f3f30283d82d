"""``r2bspec import SCRIPT.py``: specs from scripts of ros2_benchmark, and checks of scripts."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.cli.spec_files import SUFFIX
from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.errors import UsageError
from r2bspec.exit_status import ExitStatus
from r2bspec.report.findings import finding_formats
from r2bspec.report.findings.print_findings import wants_colour
from r2bspec.report.output import echo, echo_document
from r2bspec.untrusted.safe_file import is_folder, is_there

if TYPE_CHECKING:
    from r2bspec.interop.script_import.spec_builder import ImportedSpec


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """The options of an import.

    Attributes:
        check: only look for mistakes.
        output: a file, or a folder for several scripts; None prints the spec.
        package_paths: folders with packages that scripts name.
        force: overwrite what exists.
    """

    check: bool
    output_format: str
    output: Path | None
    package_paths: tuple[Path, ...]
    force: bool


@dataclass(slots=True)
class _Findings:
    found: list[Diagnostic]
    sources: dict[str, str]

    def add(self, found: Sequence[Diagnostic], sources: dict[str, str]) -> None:
        self.found += found
        self.sources |= sources


def import_scripts(files: Sequence[Path], options: ImportOptions) -> int:
    """Import or check scripts; returns the exit status.

    Raises:
        UsageError: specs of several scripts have no folder, or a file exists.
    """
    findings = _Findings([], {})
    if options.check:
        for file in files:
            _check(file, options, findings)
        _print(findings, files, options.output_format, to_stderr=False)
        if options.output_format not in finding_formats.DOCUMENT_FORMATS:
            echo(_summary(files, findings.found))
        failing = {Severity.ERROR, Severity.WARNING}
        failed = any(each.severity in failing for each in findings.found)
        return ExitStatus.FINDINGS_OR_FAILED if failed else ExitStatus.OK
    written = [_import(file, _target(file, files, options), options, findings) for file in files]
    _print(findings, files, options.output_format, to_stderr=True)
    for target in filter(None, written):
        echo(f"wrote {target}; next: r2bspec validate {target}", err=True)
    failed = any(each.severity is Severity.ERROR for each in findings.found)
    return ExitStatus.FINDINGS_OR_FAILED if failed else ExitStatus.OK


def _check(file: Path, options: ImportOptions, findings: _Findings) -> None:
    from r2bspec.interop.script_import.benchmark_script import read_benchmark_script
    from r2bspec.interop.script_import.script_mistakes import find_mistakes
    from r2bspec.interop.script_import.script_reader import UnusableScriptError

    try:
        script = read_benchmark_script(file, options.package_paths)
    except UnusableScriptError as error:
        findings.add([error.finding], {})
        return
    findings.add(find_mistakes(script), script.texts)


def _import(
    file: Path, target: Path | None, options: ImportOptions, findings: _Findings
) -> Path | None:
    from r2bspec.interop.script_import.benchmark_script import read_benchmark_script
    from r2bspec.interop.script_import.script_reader import UnusableScriptError
    from r2bspec.interop.script_import.spec_builder import build_spec

    try:
        script = read_benchmark_script(file, options.package_paths)
    except UnusableScriptError as error:
        findings.add([error.finding], {})
        return None
    spec = build_spec(script, target.parent if target is not None else Path())
    findings.add(spec.findings, spec.sources)
    _add_errors_of_spec(spec, target, findings)
    if target is None:
        echo_document(spec.text, nl=False)
        return None
    from r2bspec.record.atomic_files import write_atomically

    write_atomically(target, spec.text.encode())
    return target


def _add_errors_of_spec(spec: ImportedSpec, target: Path | None, findings: _Findings) -> None:
    """Add what `validate` calls an error in the spec, whatever this machine has."""
    from r2bspec.cli.check_files import check_text
    from r2bspec.cli.file_report import CheckOptions

    name = str(target) if target is not None else f"{spec.name}{SUFFIX}"
    found = check_text(spec.text, name, CheckOptions(offline=True))
    errors = [each for each in found if each.severity is Severity.ERROR]
    findings.add(errors, {name: spec.text} if errors else {})


def _target(file: Path, files: Sequence[Path], options: ImportOptions) -> Path | None:
    """Where the spec of a script is written.

    Raises:
        UsageError: there is no folder for several, or it exists.
    """
    output = options.output
    if output is None:
        if len(files) > 1:
            raise UsageError("several scripts need a folder for their specs: --output FOLDER")
        return None
    if len(files) > 1 and is_there(output) and not is_folder(output):
        raise UsageError(f"{output} is not a folder")
    inside = len(files) > 1 or is_folder(output)
    target = output / f"{file.stem}{SUFFIX}" if inside else output
    if is_there(target) and not options.force:
        raise UsageError(f"{target} already exists", hint="Add --force to overwrite it.")
    if inside:
        output.mkdir(parents=True, exist_ok=True)
    return target


def _print(
    findings: _Findings, files: Sequence[Path], output_format: str, *, to_stderr: bool
) -> None:
    stream = sys.stderr if to_stderr else sys.stdout
    colour = output_format == "text" and wants_colour(stream)
    shown = finding_formats.render(
        output_format,
        findings.found,
        findings.sources,
        [str(each) for each in files],
        colour=colour,
    )
    if output_format in {"json", "sarif"} and not to_stderr:
        echo_document(shown, nl=False)
    else:
        echo(shown, err=to_stderr, nl=False, styled=colour, commands=output_format == "github")


def _summary(files: Sequence[Path], found: Sequence[Diagnostic]) -> str:
    scripts = "1 script" if len(files) == 1 else f"{len(files)} scripts"
    counts = [
        f"{number} {name}{'s' * (number != 1)}"
        for severity, name in (
            (Severity.ERROR, "error"),
            (Severity.WARNING, "warning"),
            (Severity.INFO, "note"),
        )
        if (number := sum(each.severity is severity for each in found))
    ]
    return ", ".join([scripts, *(counts or ["no problems"])])
