"""``r2bspec compare``: play two specs in pairs, or compare finished runs."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from r2bspec.cli import shared_options
from r2bspec.cli.run import RunArguments, Runs
from r2bspec.cli.spec_selection import ALL_CASES, SpecSelection, SuiteEntry
from r2bspec.errors import ExitStatus
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.report.output import echo_document
from r2bspec.safe_io.safe_file import is_folder, open_regular

if TYPE_CHECKING:
    from r2bspec.report.write_reports import ReportRequest


@click.command("compare")
@click.argument("what", nargs=-1, required=True, metavar="BASE HEAD...")
@shared_options.against_option
@click.option("--control", is_flag=True, help="Compare a spec with itself to see the noise.")
@shared_options.pairs_option
@click.option("--force", is_flag=True, help="Compare even if load, data or machine differ.")
@shared_options.output_option
@shared_options.spec_options
@shared_options.queue_options
@shared_options.result_options("text", "json", "markdown")
def command(
    what: tuple[str, ...],
    values: SelectionValues,
    reports: tuple[ReportRequest, ...],
    **others: Any,
) -> int:
    """Compare HEAD with BASE: two specs, or finished runs.

    Two specs are played in interleaved runs, both at once by turns where that is possible, and
    HEAD is judged by its objectives, those 'of baseline' included. With --against or --control,
    one SPEC is compared with itself under other values or in another environment.

    Finished runs, each a run folder or a result.json, are compared metric by metric. Differences
    between them do not change the exit status: they are advisory.

    The gate of a pull request is 'r2bspec gate'.
    """
    options = RunArguments(reports=reports, **others)
    if not options.compares and any(map(_is_finished, what)):
        if reports:
            raise click.UsageError("finished runs are compared without --report: use --format")
        options.refuse("is for specs, which are played", *_FOR_SPECS)
        if any(values.values()):
            raise click.UsageError("--set, --var and --case are for specs")
        return _compare_finished(what, options)
    if options.output_format == "markdown":
        raise click.UsageError("the comparison of specs is a report: --report markdown=PATH")
    if options.against and options.control:
        raise click.UsageError("--control compares SPEC with itself, and takes no --against")
    if options.compares and len(what) > 1:
        raise click.UsageError("--against and --control take one SPEC")
    if values["case"] == ALL_CASES:
        raise click.UsageError("--case takes one case here; 'r2bspec gate' compares all")
    if not options.compares:
        if len(what) != 2:
            raise click.UsageError(
                f"two specs are compared, not {len(what)}; 'r2bspec gate' takes a folder"
            )
        options = replace(options, against=what[:1])
    from r2bspec.cli.run_specs import run_specs

    entry = SuiteEntry(SpecSelection(Path(what[-1]), **values))
    return run_specs([entry], Runs(options), several=False)


_FOR_SPECS = ("--pairs", "--output", "--no-lock", "--wait", "--quiet", "--verbose")


def _is_finished(path: str) -> bool:
    """Return True for the folder or the result of a run; a plan is JSON, too."""
    place = Path(path)
    if is_folder(place):
        return True
    return place.suffix == ".json" and '"r2bspec_plan"' not in _beginning(place)


def _beginning(file: Path) -> str:
    try:
        with open_regular(file) as opened:
            return opened.read(1_000).decode(errors="replace")
    except OSError:
        return ""


def _compare_finished(what: Sequence[str], options: RunArguments) -> int:
    from r2bspec.compare.comparison import compare, read_compared_result
    from r2bspec.report.comparison_document import render

    if len(what) < 2:
        raise click.UsageError("compare takes a BASE and at least one HEAD")
    base, *heads = (read_compared_result(Path(path)) for path in what)
    comparisons = [compare(base, head, force=options.force) for head in heads]
    width = shutil.get_terminal_size((100, 24)).columns
    echo_document(render(comparisons, options.output_format, width), nl=False)
    return ExitStatus.OK
