"""``r2bspec import``: scripts of NVIDIA's ros2_benchmark as specs.

Several scripts are imported together: one list of findings, one exit status. Of a spec that was
made, what `validate` calls an error on any machine is a finding, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import click

from r2bspec.cli.check_files import SUFFIX, CheckOptions, check_text
from r2bspec.cli.shared_options import FILE, FOLDER, repeatable_option
from r2bspec.cli.text_output import print_findings
from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.report.finding_formats import FORMATS
from r2bspec.report.output import echo, echo_document
from r2bspec.safe_io.safe_file import is_folder, is_there


@click.command("import")
@click.argument("files", nargs=-1, required=True, metavar="SCRIPT...", type=FILE)
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
    help="A folder with packages that a script imports from, in addition to the folders above it",
)
@click.option("--force", is_flag=True, help="Overwrite specs that exist.")
def command(
    files: tuple[Path, ...],
    output_format: str,
    output: Path | None,
    package_paths: tuple[Path, ...],
    force: bool,
) -> int:
    """Make specs from scripts of ros2_benchmark.

    SCRIPT is executed, in a process with stand-ins for launch and ros2_benchmark: import only what
    you would run. What it does not determine becomes a placeholder with a comment in the spec, and
    a finding.
    """
    return _Import(files, package_paths, output, force).run(output_format)


@dataclass
class _Import:
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

    def run(self, output_format: str) -> int:
        """Make specs; returns the exit status.

        Raises:
            UsageError: specs of several scripts have no folder, or a file exists.
        """
        written = [self._import(file, self._target(file)) for file in self.files]
        names = [str(file) for file in self.files]
        print_findings(output_format, self.findings, self.sources, names, err=True)
        for target in filter(None, written):
            echo(f"wrote {target}; next: r2bspec validate {target}", err=True)
        failed = any(finding.severity is Severity.ERROR for finding in self.findings)
        return ExitStatus.FINDINGS_OR_FAILED if failed else ExitStatus.OK

    def _import(self, file: Path, target: Path | None) -> Path | None:
        from r2bspec.interop.recording import UnusableFileError
        from r2bspec.interop.script_spec import import_script
        from r2bspec.record.files import write_output

        folder = target.parent if target is not None else Path()
        try:
            spec = import_script(file, folder, self.package_paths)
        except UnusableFileError as error:
            self.findings.append(error.finding)
            return None
        self.findings += spec.findings
        self.sources |= spec.sources
        if all(finding.severity is not Severity.ERROR for finding in spec.findings):
            self._add_errors_of(spec.text, str(target or f"{spec.name}{SUFFIX}"))
        if target is None:
            echo_document(spec.text, nl=False)
        else:
            write_output(target, spec.text.encode())
        return target

    def _add_errors_of(self, text: str, name: str) -> None:
        """Add what `validate` calls an error in the spec, whatever this machine has."""
        findings = check_text(text, name, CheckOptions(offline=True))
        errors = [finding for finding in findings if finding.severity is Severity.ERROR]
        self.findings += errors
        self.sources |= {name: text} if errors else {}

    def _target(self, file: Path) -> Path | None:
        """Return where the spec of a script is written.

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
