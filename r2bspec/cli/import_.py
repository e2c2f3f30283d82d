"""``r2bspec import``: scripts of NVIDIA's ros2_benchmark as specs, and its reports.

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
from r2bspec.cli.text_output import aligned_lines, print_findings
from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.diagnostics.quote import pluralize
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.report import finding_formats
from r2bspec.report.finding_formats import FORMATS
from r2bspec.report.output import echo, echo_document
from r2bspec.safe_io.safe_file import is_folder, is_there, open_regular

if TYPE_CHECKING:
    from r2bspec.interop.ros2_benchmark import MonitorFigures, ReferenceReport
    from r2bspec.interop.script_import.benchmark_script import BenchmarkScript
    from r2bspec.interop.script_import.spec_builder import ImportedSpec

_REPORT_FORMATS = ("text", "json")
_COLUMNS = (
    ("throughput", "throughput_hz", "Hz"),
    ("as reported", "reported_hz", "Hz"),
    ("sent", "sent", "count"),
    ("missed", "missed", "count"),
    ("latency mean", "latency_mean", "s"),
    ("first", "latency_first", "s"),
    ("jitter mean", "jitter_mean", "s"),
    ("CPU mean", "cpu_mean", "share"),
)


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
    help="The format of findings; of a report: text or json.",
)
@click.option(
    "--output",
    "-o",
    type=click.Path(path_type=Path),
    help="Write to this file, or for several scripts into this folder, instead of printing. "
    "A report is written as JSON, for 'r2bspec compare'.",
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
    """Make specs from scripts of ros2_benchmark, or read a report of it.

    FILE is a Python script, which is read as a syntax tree and never executed; or the JSON file
    of a report, which is printed in SI units and r2bspec's names. What a script does not determine
    becomes a comment in the spec and a finding. Values that a report lacks, such as percentiles,
    are left out and never estimated.
    """
    if all(_is_script(file) for file in files):
        scripts = _Scripts(files, package_paths, output, force)
        return scripts.check(output_format) if check else scripts.import_all(output_format)
    if len(files) > 1:
        raise UsageError(
            "reports are read one at a time, and not together with scripts",
            hint="Call 'r2bspec import' for each of them.",
        )
    if check or output_format not in _REPORT_FORMATS:
        raise UsageError(
            f"{files[0]} is no script, which --check and this --format need",
            hint="Give a .py file, or leave both options out: a report has text and json.",
        )
    return _import_report(files[0], output_format, output)


def _is_script(file: Path) -> bool:
    """Whether a file is a script: by its content, and by its name if it cannot be read."""
    try:
        with open_regular(file) as stream:
            start = stream.read(4096).lstrip(b"\xef\xbb\xbf \t\r\n")
    except OSError:
        return file.suffix == ".py"
    if start[:1] in {b"{", b"["}:
        return False
    return file.suffix == ".py" or b"import " in start


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


def _import_report(report: Path, output_format: str, output: Path | None) -> int:
    from r2bspec.interop.ros2_benchmark import read_report, to_json

    reference = read_report(report)
    if output is not None:
        from r2bspec.record.files import write_output

        write_output(output, to_json(reference))
    elif output_format == "json":
        echo_document(to_json(reference), nl=False)
    else:
        echo(_text(reference), nl=False)
    return ExitStatus.OK


def _text(report: ReferenceReport) -> str:
    from r2bspec.judge.measure.units import show

    lines = [report.name or "a report of ros2_benchmark"]
    if report.peak_hz is not None:
        lines.append(f"peak found by its search: {show(report.peak_hz, 'Hz')}")
    rows = [["offered", "monitor", *(name for name, _, _ in _COLUMNS)]]
    rows += [_row("at the peak", name, figures) for name, figures in report.peak.items()]
    for rate, monitors in sorted(report.rates.items(), key=lambda item: float(item[0])):
        rows += [_row(show(float(rate), "Hz"), name, figures) for name, figures in monitors.items()]
    lines += aligned_lines(rows, right_columns=range(len(rows[0])))
    return "\n".join([*lines, ""])


def _row(rate: str, monitor: str, figures: MonitorFigures) -> list[str]:
    from r2bspec.judge.measure.units import show

    return [rate, monitor or "-", *(show(getattr(figures, k), unit) for _, k, unit in _COLUMNS)]
