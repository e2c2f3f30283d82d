"""``r2bspec import``: scripts of NVIDIA's ros2_benchmark as specs.

Several scripts are imported, or checked, together: one list of findings, one exit status. Of a
spec that was made, what `validate` calls an error on any machine is a finding, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.check_files import SUFFIX, CheckOptions, check_text
from r2bspec.cli.shared_options import FILE, FOLDER, repeatable_option
from r2bspec.cli.text_output import print_findings
from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.diagnostics.quote import pluralize
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.report import finding_formats
from r2bspec.report.finding_formats import FORMATS
from r2bspec.report.output import echo, echo_document
from r2bspec.safe_io.safe_file import is_folder, is_there

if TYPE_CHECKING:
    from r2bspec.interop.script_import.benchmark_script import BenchmarkScript
    from r2bspec.interop.script_import.spec_builder import ImportedSpec


@click.command("import")
@click.argument(
    "files",
    nargs=-1,
    required=True,
    metavar="FILE...",
    type=FILE,
)
@click.option("--check", is_flag=True, help="Only look for mistakes in scripts; write no spec.")
@click.option(
    "--format",
    "output_format",
    type=click.Choice(list(FORMATS)),
    default="text",
    show_default=True,
    help="The format of findings.",
)
@click.option(
    "--output",
    "-o",
    type=click.Path(path_type=Path),
    help="Write to this file, or for several scripts into this folder, instead of printing.",
)
@repeatable_option(
    "--package-path",
    "package_paths",
    type=FOLDER,
    help="A folder with packages whose modules and launch files a script names, in addition to "
    "the folders above the script",
)
@click.option("--force", is_flag=True, help="Overwrite specs that exist.")
def command(
    files: tuple[Path, ...],
    check: bool,
    output_format: str,
    output: Path | None,
    package_paths: tuple[Path, ...],
    force: bool,
) -> int:
    """Make specs from scripts of ros2_benchmark.

    FILE is a Python script, which is read as a syntax tree and never executed. What a script does
    not determine becomes a comment in the spec and a finding.
    """
    scripts = _Scripts(files, package_paths, output, force)
    return scripts.check(output_format) if check else scripts.import_all(output_format)


@dataclass
class _Scripts:
    """The scripts of one call, and the findings about them.

    Attributes:
        files: the scripts.
        package_paths: folders with packages that scripts name.
        output: a file, or a folder for several scripts; None prints the spec.
        force: overwrite what exists.
    """

    files: Sequence[Path]
    package_paths: Sequence[Path]
    output: Path | None
    force: bool
    findings: list[Diagnostic] = field(default_factory=list)
    sources: dict[str, str] = field(default_factory=dict)

    def check(self, output_format: str) -> int:
        """Look for mistakes; returns the exit status."""
        from r2bspec.interop.script_import.script_mistakes import find_mistakes

        for file in self.files:
            script = self._read(file)
            if script is not None:
                self._add(find_mistakes(script), script.texts)
        self._print(output_format)
        if output_format not in finding_formats.DOCUMENT_FORMATS:
            echo(self._summary())
        return self._status(Severity.ERROR, Severity.WARNING)

    def import_all(self, output_format: str) -> int:
        """Make specs; returns the exit status.

        Raises:
            UsageError: specs of several scripts have no folder, or a file exists.
        """
        written = [self._import(file, self._target(file)) for file in self.files]
        self._print(output_format, err=True)
        for target in filter(None, written):
            echo(f"wrote {target}; next: r2bspec validate {target}", err=True)
        return self._status(Severity.ERROR)

    def _add(self, findings: Sequence[Diagnostic], sources: dict[str, str]) -> None:
        self.findings += findings
        self.sources |= sources

    def _status(self, *failing: Severity) -> int:
        failed = any(finding.severity in failing for finding in self.findings)
        return ExitStatus.FINDINGS_OR_FAILED if failed else ExitStatus.OK

    def _read(self, file: Path) -> BenchmarkScript | None:
        from r2bspec.interop.script_import.benchmark_script import read_benchmark_script
        from r2bspec.interop.script_import.source_files import UnusableScriptError

        try:
            return read_benchmark_script(file, self.package_paths)
        except UnusableScriptError as error:
            self._add([error.finding], {})
            return None

    def _import(self, file: Path, target: Path | None) -> Path | None:
        from r2bspec.interop.script_import.spec_builder import build_spec
        from r2bspec.record.files import write_output

        script = self._read(file)
        if script is None:
            return None
        spec = build_spec(script, target.parent if target is not None else Path())
        self._add(spec.findings, spec.sources)
        if spec.is_whole:
            self._add_errors_of(spec, target)
        if target is None:
            echo_document(spec.text, nl=False)
        else:
            write_output(target, spec.text.encode())
        return target

    def _add_errors_of(self, spec: ImportedSpec, target: Path | None) -> None:
        """Add what `validate` calls an error in the spec, whatever this machine has."""
        name = str(target) if target is not None else f"{spec.name}{SUFFIX}"
        findings = check_text(spec.text, name, CheckOptions(offline=True))
        errors = [finding for finding in findings if finding.severity is Severity.ERROR]
        self._add(errors, {name: spec.text} if errors else {})

    def _target(self, file: Path) -> Path | None:
        """Where the spec of a script is written.

        Raises:
            UsageError: there is no folder for several, or it exists.
        """
        output, several = self.output, len(self.files) > 1
        if output is None:
            if several:
                raise UsageError(
                    "several scripts need a folder for their specs",
                    hint="Name it with --output FOLDER.",
                )
            return None
        if several and is_there(output) and not is_folder(output):
            raise UsageError(
                f"{output} is not a folder", hint="Name a folder, which is made if need be."
            )
        inside = several or is_folder(output)
        target = output / f"{file.stem}{SUFFIX}" if inside else output
        if is_there(target) and not self.force:
            raise UsageError(f"{target} already exists", hint="Add --force to overwrite it.")
        if inside:
            output.mkdir(parents=True, exist_ok=True)
        return target

    def _print(self, output_format: str, *, err: bool = False) -> None:
        names = [str(file) for file in self.files]
        print_findings(output_format, self.findings, self.sources, names, err=err)

    def _summary(self) -> str:
        counts = [
            pluralize(count, name)
            for severity, name in (
                (Severity.ERROR, "error"),
                (Severity.WARNING, "warning"),
                (Severity.INFO, "note"),
            )
            if (count := sum(finding.severity is severity for finding in self.findings))
        ]
        return ", ".join([pluralize(len(self.files), "script"), *(counts or ["no problems"])])
