"""``r2bspec import``: scripts of NVIDIA's ros2_benchmark as specs, and its reports."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.errors import UsageError
from r2bspec.exit_status import ExitStatus
from r2bspec.report.findings.finding_formats import FORMATS
from r2bspec.report.output import echo, echo_document

if TYPE_CHECKING:
    from r2bspec.interop.ros2_benchmark import MonitorFigures, ReferenceReport

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
    type=click.Path(path_type=Path, dir_okay=False),
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
@click.option(
    "--package-path",
    "package_paths",
    multiple=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="A folder with packages whose modules and launch files a script names, in addition to "
    "the folders above the script; may be repeated.",
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
    if all(_is_script(each) for each in files):
        from r2bspec.cli.import_scripts import ImportOptions, import_scripts

        options = ImportOptions(check, output_format, output, package_paths, force)
        return import_scripts(files, options)
    if len(files) > 1:
        raise UsageError("reports are read one at a time, and not together with scripts")
    if check or output_format not in _REPORT_FORMATS:
        raise UsageError(f"{files[0]} is no script, which --check and this --format need")
    return _import_report(files[0], output_format, output)


def _is_script(file: Path) -> bool:
    """Whether a file is a script: by its content, and by its name if it cannot be read."""
    from r2bspec.untrusted.safe_file import open_regular

    try:
        with open_regular(file) as stream:
            start = stream.read(4096).lstrip(b"\xef\xbb\xbf \t\r\n")
    except OSError:
        return file.suffix == ".py"
    if start[:1] in {b"{", b"["}:
        return False
    return file.suffix == ".py" or b"import " in start


def _import_report(report: Path, output_format: str, output: Path | None) -> int:
    from r2bspec.interop.ros2_benchmark import read_report, to_json

    found = read_report(report)
    if output is not None:
        from r2bspec.record.atomic_files import write_atomically

        write_atomically(output, to_json(found))
    elif output_format == "json":
        echo_document(to_json(found), nl=False)
    else:
        echo(_text(found), nl=False)
    return ExitStatus.OK


def _text(report: ReferenceReport) -> str:
    from r2bspec.measure.units import show

    lines = [report.name or "a report of ros2_benchmark"]
    if report.peak_hz is not None:
        lines.append(f"peak found by its search: {show(report.peak_hz, 'Hz')}")
    rows = [["offered", "monitor", *(name for name, _, _ in _COLUMNS)]]
    rows += [_row("at the peak", name, each) for name, each in report.peak.items()]
    for rate, monitors in sorted(report.rates.items(), key=lambda item: float(item[0])):
        rows += [_row(show(float(rate), "Hz"), name, each) for name, each in monitors.items()]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        lines.append("  ".join(cells).rstrip())
    return "\n".join([*lines, ""])


def _row(rate: str, monitor: str, figures: MonitorFigures) -> list[str]:
    from r2bspec.measure.units import show

    return [rate, monitor or "-", *(show(getattr(figures, k), unit) for _, k, unit in _COLUMNS)]
