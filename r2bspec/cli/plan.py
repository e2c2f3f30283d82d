"""``r2bspec plan``: the plan of a run, as canonical JSON, a diagram, or a difference."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli import shared_options as options
from r2bspec.cli.spec_selection import SpecSelection, prepare_and_report
from r2bspec.diagnostics.plain_text import plain
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.report.output import echo, echo_document

if TYPE_CHECKING:
    from r2bspec.plan.plan import Plan


@click.command("plan")
@options.spec_argument
@click.option(
    "--graph",
    type=click.Choice(["mermaid", "html"]),
    help="Print a drawing instead, for Markdown (mermaid) or a browser (html).",
)
@click.option(
    "--diff",
    "other",
    type=options.FILE,
    metavar="OTHER",
    help="Print the differences from OTHER, a spec or a plan, instead; exit status "
    f"{ExitStatus.FINDINGS_OR_FAILED} if any.",
)
@options.spec_options
@click.option(
    "--output",
    "-o",
    type=click.Path(path_type=Path, dir_okay=False, writable=True),
    help="Write to this file instead of standard output.",
)
def command(
    spec: Path,
    graph: str | None,
    other: Path | None,
    values: SelectionValues,
    output: Path | None,
) -> int:
    """Compile SPEC and print its plan.

    SPEC is a spec, or a plan written by this command. The same spec and the same data give the same
    bytes on every machine. Nothing is started.
    """
    if graph is not None and other is not None:
        raise click.UsageError("--graph and --diff cannot be combined")
    for read in (spec, other):
        if output and read and os.path.realpath(output) == os.path.realpath(read):
            raise UsageError(f"{output} is an input: it is not written", hint="Name another file.")
    prepared = prepare_and_report(SpecSelection(spec, **values))
    plan = prepared.plan
    if other is not None:
        from r2bspec.plan.comparability import diff_plans

        other_plan = prepare_and_report(SpecSelection(other)).plan
        differences = diff_plans(other_plan, plan)
        _write("".join(f"{difference}\n" for difference in differences).encode(), output)
        return ExitStatus.FINDINGS_OR_FAILED if differences else ExitStatus.OK
    _write(_render(plan, graph), output, is_json=graph is None)
    from r2bspec.plan.time_estimate import estimate_time

    echo(f"a run takes {estimate_time(plan).text()}", err=True)
    return ExitStatus.OK


def _render(plan: Plan, graph: str | None) -> bytes:
    if graph == "mermaid":
        from r2bspec.plan.drawing import to_mermaid

        return to_mermaid(plan).encode()
    if graph == "html":
        from r2bspec.report.format_registry import GRAPH_PAGE, check_installed, load

        check_installed("html")
        page: bytes = load(GRAPH_PAGE)(plan)
        return page
    from r2bspec.plan.canonical_json import canonical_json

    return canonical_json(plan)


def _write(content: bytes, output: Path | None, *, is_json: bool = False) -> None:
    if output is None:
        if is_json:
            echo_document(content, nl=False)
        else:
            echo(content.decode(), nl=False)
        return
    from r2bspec.record.files import write_output

    # Text is made to be shown: by `cat`, in a review, in a comment.
    write_output(output, content if is_json else plain(content.decode()).encode())
