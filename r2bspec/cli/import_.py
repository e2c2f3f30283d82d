"""``r2bspec import``: read a report of NVIDIA's ros2_benchmark."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo, echo_document

if TYPE_CHECKING:
    from r2bspec.interop.ros2_benchmark import MonitorFigures, ReferenceReport

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
@click.argument("report", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--format",
    "output_format",
    type=click.Choice(["text", "json"]),
    default="text",
    show_default=True,
    help="The output format.",
)
@click.option(
    "--output",
    "-o",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write JSON to this file, for 'r2bspec compare', instead of printing.",
)
def command(report: Path, output_format: str, output: Path | None) -> int:
    """Read REPORT, the JSON file of ros2_benchmark, and print it in SI units and r2bspec's names.

    Values that the report lacks, such as percentiles, are left out and never estimated.
    """
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
