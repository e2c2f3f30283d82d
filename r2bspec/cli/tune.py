"""``r2bspec tune``: the listed values that meet the objectives at the least cost."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from r2bspec.cli import shared_options as options
from r2bspec.cli.spec_selection import prepare_and_report
from r2bspec.cli.text_output import queued_host
from r2bspec.errors import ExitStatus
from r2bspec.language.quantities import Duration
from r2bspec.language.selected_spec import SelectionValues, SpecSelection
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.tune.tuning_result import TuningOutcome

EXIT_STATUS: Final[dict[TuningOutcome, ExitStatus]] = {
    "improved": ExitStatus.OK,
    "meets": ExitStatus.OK,
    "today": ExitStatus.OK,
    "not met": ExitStatus.FINDINGS_OR_FAILED,
    "not shown": ExitStatus.INCONCLUSIVE,
    "incomplete": ExitStatus.INCONCLUSIVE,
}


@click.command("tune")
@options.spec_argument
@options.spec_options
@click.option(
    "--output",
    "-o",
    type=options.FOLDER,
    help="The folder of the search, new or empty.  [default: runs/NAME-tune-TIME]",
)
@click.option(
    "--trials",
    type=click.IntRange(min=1, max=10_000),
    help="The most combinations that are tried.  [default: tune.trials, or 30]",
)
@click.option(
    "--budget",
    type=options.duration("10 s", "168 h"),
    help="The time for search and proof.  [default: tune.budget, or 20 min]",
)
@click.option(
    "--minimize",
    metavar="METRIC",
    help="The metric to make least.  [default: tune.minimize, or cpu.graph.mean]",
)
@click.option(
    "--write",
    type=options.FILE,
    metavar="FILE",
    help="If values are proved, write a spec with them, which extends SPEC.",
)
@options.wait_option
@options.format_option("text", "json", "markdown")
@options.quiet_option
def command(
    spec: Path,
    values: SelectionValues,
    output: Path | None,
    trials: int | None,
    budget: Duration | None,
    minimize: str | None,
    write: Path | None,
    wait: Duration | None,
    output_format: str,
    quiet: bool,
) -> int:
    """Find values that meet the objectives of SPEC at the least cost, and prove them.

    'tune.values' in SPEC lists the values to try. Each trial is a start of all processes with a
    combination of them. The best race in further starts; the winner is compared
    with SPEC as it is, in interleaved pairs of new runs. The claim is what these pairs show.

    The folder of the search gets tuning.json, tuning.md and every run. Exit status: 0 values are
    proved, or today's are the best; 1 none meet the objectives; 3 nothing is shown.
    """
    selection = SpecSelection(spec, **values)
    prepared = prepare_and_report(selection)
    from r2bspec import api
    from r2bspec.report.output import echo_document
    from r2bspec.report.progress import shown_progress
    from r2bspec.tune.overlay import check_overlay_path
    from r2bspec.tune.run_search import require_extra, tune
    from r2bspec.tune.search import SearchLimits
    from r2bspec.tune.tuning_result import to_json, tuning_document

    require_extra()
    if write is not None:
        check_overlay_path(write, spec)
    loaded = prepared.loaded.spec if prepared.loaded is not None else None
    if loaded is None:
        raise click.UsageError(f"{spec} is a plan, whose values are fixed: give the spec")
    declared = loaded.tune
    limits = SearchLimits(
        trials or declared.trials, (budget or declared.budget).seconds, declared.pairs
    )
    wait_s = math.inf if wait is None else wait.seconds
    folder = output or api.default_run_folder(f"{prepared.plan.name}-tune")
    with (
        queued_host(f"{prepared.plan.name} tune", limits.budget_s, wait_s, quiet=quiet),
        shown_progress(quiet=quiet) as progress,
    ):
        result = tune(
            selection,
            prepared,
            folder,
            limits,
            minimize=minimize or declared.minimize,
            write=write,
            progress=progress,
            tell=progress.note,
        )
    if output_format == "json":
        echo_document(to_json(result), nl=False)
    elif output_format == "markdown":
        from r2bspec.report.markdown import to_markdown

        echo(to_markdown(tuning_document(result)), nl=False)
    else:
        from r2bspec.report.terminal import show_document

        show_document(tuning_document(result))
    echo(f"search: {folder}", err=True)
    if write is not None:
        done = "written" if result.is_proved else "not written: no values are proved"
        echo(f"{write} was {done}", err=True)
    return EXIT_STATUS[result.outcome]
