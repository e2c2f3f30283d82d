"""``r2bspec compare``: compare finished runs."""

from __future__ import annotations

import shutil
from pathlib import Path

import click

from r2bspec.cli.quantity_options import share
from r2bspec.exit_status import ExitStatus
from r2bspec.language.quantities import Share
from r2bspec.report.output import echo_document

FORMATS = ("text", "json", "markdown", "html", "csv", "github")

_RESULT = click.Path(path_type=Path)


@click.command("compare")
@click.argument("base", type=_RESULT)
@click.argument("heads", type=_RESULT, nargs=-1, required=True, metavar="HEAD...")
@click.option(
    "--margin",
    type=share("0.001 %", "100 %"),
    default="5 %",
    show_default=True,
    help="Differences up to this share count as none.",
)
@click.option("--force", is_flag=True, help="Compare even if load, data or machine differ.")
@click.option(
    "--format",
    "output_format",
    type=click.Choice(FORMATS),
    default="text",
    show_default=True,
    help="The output format.",
)
def command(
    base: Path, heads: tuple[Path, ...], margin: Share, force: bool, output_format: str
) -> int:
    """Compare each HEAD with BASE, metric by metric.

    Each is a run folder, a result.json, or a report of ros2_benchmark. Differences do not change
    the exit status: comparisons of stored results are advisory. To gate, use 'r2bspec run
    --against'.
    """
    from r2bspec.compare.comparison import compare, read_compared_result
    from r2bspec.report.comparison_formats import render

    first = read_compared_result(base)
    found = [
        compare(first, read_compared_result(head), margin=margin.fraction, force=force)
        for head in heads
    ]
    width = shutil.get_terminal_size((100, 24)).columns
    content = render(found, output_format, width)
    echo_document(content, nl=False)
    return ExitStatus.OK
