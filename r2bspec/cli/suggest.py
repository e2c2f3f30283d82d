"""``r2bspec suggest``: propose objectives from what a run measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.shared_options import SpecValues, spec_options
from r2bspec.cli.spec_selection import SpecSelection, prepare_and_report
from r2bspec.errors import UsageError
from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.compare.proposals import Proposal
    from r2bspec.record.calibration_file import Calibration
    from r2bspec.record.run_folder import Run


@click.command("suggest")
@click.argument("spec", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("run", type=click.Path(path_type=Path, file_okay=False))
@click.option("--write", is_flag=True, help="Apply the proposed change to SPEC.")
@click.option("--force", is_flag=True, help="Use a run of another graph than that of SPEC.")
@spec_options
def command(spec: Path, run: Path, write: bool, force: bool, values: SpecValues) -> int:
    """Propose objectives for SPEC from the finished run in the folder RUN, as a patch.

    Limits of latencies are prediction bounds from the scatter of the iterations, with the margin of
    'r2bspec calibrate' if the spec has been calibrated. Each proposed requirement is one that the
    run passes. What the spec already requires is left alone.
    """
    if spec.suffix == ".json":
        raise click.UsageError("objectives cannot be proposed for a plan: give the spec")
    from r2bspec.record.run_folder import open_run

    prepared = prepare_and_report(SpecSelection(spec, *values))
    finished = open_run(run)
    if not force:
        _require_same_graph(prepared, finished, run)
    _propose(spec, prepared, run, finished, write=write)
    return ExitStatus.OK


def _require_same_graph(prepared: PreparedBenchmark, finished: Run, folder: Path) -> None:
    from r2bspec.compare.errors import IncomparableError
    from r2bspec.plan.comparability import difference_lines, graph_differences, measured_hash

    if measured_hash(prepared.plan) != measured_hash(finished.plan):
        differences = difference_lines(graph_differences(finished.plan, prepared.plan))
        raise IncomparableError(
            f"the run in {folder} is not of this spec:\n"
            + "\n".join(f"  {each}" for each in differences),
            hint="Run it again, or add --force.",
        )


def _propose(
    spec: Path, prepared: PreparedBenchmark, folder: Path, finished: Run, *, write: bool
) -> None:
    from r2bspec.cli.fix import read_text
    from r2bspec.compare.proposals import propose_objectives
    from r2bspec.compare.report_input import read_folder
    from r2bspec.judge.judge_run import result_of

    before = read_text(str(spec))
    if before is None or prepared.loaded is None:
        raise UsageError(f"{spec} cannot be changed: it is a link, or not a spec")
    proposal = propose_objectives(
        prepared.loaded,
        before,
        read_folder(folder).result,
        lambda objectives: result_of(finished, objectives, prepared.plan.name),
        _calibrations(spec, prepared),
    )
    _show(spec, before, proposal, write=write)


def _calibrations(spec: Path, prepared: PreparedBenchmark) -> list[Calibration]:
    from r2bspec.record.calibration_file import calibration_path, read_calibration_file
    from r2bspec.safe_io.safe_file import is_regular

    file = calibration_path(spec)
    if not is_regular(file) or prepared.loaded is None:
        return []
    found = read_calibration_file(file)
    if found is None:
        return []
    return list(found.benchmarks.get(prepared.loaded.id, {}).values())


def _show(spec: Path, before: str, proposal: Proposal, *, write: bool) -> None:
    from r2bspec.cli.fix import write_text
    from r2bspec.diagnostics.edits import unified_diff

    for each in proposal.notes:
        echo(each, err=True)
    if proposal.text == before:
        if not proposal.notes:
            echo("the spec has a requirement for all that was measured", err=True)
    elif write:
        write_text(str(spec), proposal.text)
        echo(f"{spec} was changed", err=True)
    else:
        echo(unified_diff(before, proposal.text, str(spec)), nl=False)
        echo("--write applies this change", err=True)
