"""``r2bspec suggest``: propose objectives from what a run measured."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli import shared_options as options
from r2bspec.cli.spec_selection import SpecSelection, prepare_and_report
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.plan.plan import Plan
    from r2bspec.record.run_folder import Run


def _require_same_graph(prepared: PreparedBenchmark, measured: Plan, what: str, hint: str) -> None:
    """Refuse what was measured of another graph.

    Raises:
        IncomparableError: the graphs differ.
    """
    from r2bspec.plan.comparability import (
        IncomparableError,
        difference_lines,
        graph_differences,
        measured_hash,
    )

    if measured_hash(prepared.plan) != measured_hash(measured):
        differences = difference_lines(graph_differences(measured, prepared.plan))
        raise IncomparableError(
            f"{what} not of this spec:\n"
            + "\n".join(f"  {difference}" for difference in differences),
            hint=hint,
        )


def _show_change(
    file: str, before: str, after: str, notes: Sequence[str], nothing: str, *, write: bool
) -> None:
    """Print the proposed change of a spec as a patch, or apply it; `nothing` says there is none."""
    from r2bspec.cli.check_files import write_text
    from r2bspec.diagnostics.edits import unified_diff

    for note in notes:
        echo(note, err=True)
    if after == before:
        if not notes:
            echo(nothing, err=True)
    elif write:
        write_text(file, after)
        echo(f"{file} was changed", err=True)
    else:
        echo(unified_diff(before, after, file), nl=False)
        echo("--write applies this change", err=True)


@click.command("suggest")
@options.spec_argument
@click.argument("run", type=options.FOLDER)
@click.option("--write", is_flag=True, help="Apply the proposed change to SPEC.")
@click.option("--force", is_flag=True, help="Use a run of another graph than that of SPEC.")
@options.spec_options
def suggest_command(
    spec: Path, run: Path, write: bool, force: bool, values: SelectionValues
) -> int:
    """Propose objectives for SPEC from the finished run in the folder RUN, as a patch.

    Limits of latencies are prediction bounds from the scatter of the iterations. The run passes
    each proposed requirement. What the spec already requires is left alone.
    """
    if spec.suffix == ".json":
        raise click.UsageError("objectives cannot be proposed for a plan: give the spec")
    from r2bspec.record.run_folder import open_run

    prepared = prepare_and_report(SpecSelection(spec, **values))
    finished = open_run(run)
    if not force:
        _require_same_graph(
            prepared, finished.plan, f"the run in {run} is", "Run it again, or add --force."
        )
    _propose_objectives(spec, prepared, run, finished, write=write)
    return ExitStatus.OK


def _propose_objectives(
    spec: Path, prepared: PreparedBenchmark, folder: Path, finished: Run, *, write: bool
) -> None:
    from r2bspec.cli.check_files import read_text
    from r2bspec.compare.proposals import propose_objectives
    from r2bspec.compare.report_input import read_folder
    from r2bspec.judge.judge_run import result_of

    before = read_text(str(spec))
    if before is None or prepared.loaded is None:
        raise UsageError(
            f"{spec} cannot be changed: it is a link, or not a spec",
            hint="Give the file that the link leads to.",
        )
    proposal = propose_objectives(
        prepared.loaded,
        before,
        read_folder(folder).result,
        lambda objectives: result_of(finished, objectives, prepared.plan.name),
    )
    nothing = "the spec has a requirement for all that was measured"
    _show_change(str(spec), before, proposal.text, proposal.notes, nothing, write=write)
