"""The verbs that propose changes of a spec from what was measured: ``calibrate``, ``suggest``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli import shared_options as options
from r2bspec.cli.spec_selection import SpecSelection, prepare_and_report
from r2bspec.cli.text_output import locked_host, print_table
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.report.output import echo
from r2bspec.safe_io.limits import MAX_PLANNED_ITERATIONS

if TYPE_CHECKING:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.plan.plan import Plan
    from r2bspec.record.calibration_file import Calibration
    from r2bspec.record.comparison_folder import PairedComparison
    from r2bspec.record.run_folder import Run


@click.command("calibrate")
@options.spec_argument
@click.option(
    "--pairs",
    type=click.IntRange(min=3, max=MAX_PLANNED_ITERATIONS),
    help="The number of pairs of runs.  [default: 10]",
)
@click.option(
    "--from",
    "source",
    type=options.FOLDER,
    metavar="FOLDER",
    help="Use the folder of an earlier calibration or 'run --control' instead of running.",
)
@click.option(
    "--output",
    "-o",
    type=options.FOLDER,
    help="The folder of the runs, new or empty.  [default: runs/NAME-pairs-TIME]",
)
@click.option("--write", is_flag=True, help="Apply the proposed changes to SPEC.")
@options.spec_options
@options.max_bytes_option
@options.quiet_option
def calibrate_command(
    spec: Path,
    pairs: int | None,
    source: Path | None,
    output: Path | None,
    write: bool,
    values: SelectionValues,
    quiet: bool,
) -> int:
    """Compare SPEC with itself to find the smallest detectable change.

    The result is stored next to the spec, in NAME.noise.json; 'r2bspec validate' reads it and warns
    of margins below the noise. Limits above the noise are proposed as a patch of the spec; --write
    applies it.
    """
    if spec.suffix == ".json":
        raise click.UsageError("limits cannot be proposed for a plan: give the spec")
    if source is not None and (pairs is not None or output is not None):
        raise click.UsageError(
            "--from cannot be combined with --pairs or --output: it runs nothing"
        )
    from r2bspec.compare.proposals import compute_calibration, store_calibration
    from r2bspec.record.comparison_folder import open_comparison

    selection = SpecSelection(spec, **values)
    prepared = prepare_and_report(selection)
    folder = source or _run_pairs(prepared, pairs or 10, output, quiet=quiet)
    compared = open_comparison(folder)
    _require_same_graph(
        prepared, compared.plan, f"the runs in {folder} are", "Run again without --from."
    )
    calibration = compute_calibration(compared)
    path = store_calibration(spec, compared, calibration)
    _show_noise(calibration, prepared.plan.name, compared)
    echo(f"stored in {path}", err=True)
    _propose_limits(selection, prepared, calibration, write=write)
    return ExitStatus.OK


def _run_pairs(
    prepared: PreparedBenchmark, pairs: int, output: Path | None, *, quiet: bool
) -> Path:
    from r2bspec import api
    from r2bspec.plan.time_estimate import estimate_pairs
    from r2bspec.report.progress import RemainingTime, shown_progress

    remaining = RemainingTime(estimate_pairs(prepared.plan, pairs))
    folder = output or api.default_run_folder(f"{prepared.plan.name}-pairs")
    with (
        locked_host(f"{prepared.plan.name}-pairs"),
        shown_progress(quiet=quiet, remaining=remaining) as progress,
    ):
        api.calibrate(prepared, folder, progress, pairs=pairs, lock="off")
    return folder


def _require_same_graph(prepared: PreparedBenchmark, measured: Plan, what: str, hint: str) -> None:
    """Refuse what was measured of another graph.

    Raises:
        IncomparableError: the graphs differ.
    """
    from r2bspec.compare.errors import IncomparableError
    from r2bspec.plan.comparability import difference_lines, graph_differences, measured_hash

    if measured_hash(prepared.plan) != measured_hash(measured):
        differences = difference_lines(graph_differences(measured, prepared.plan))
        raise IncomparableError(
            f"{what} not of this spec:\n"
            + "\n".join(f"  {difference}" for difference in differences),
            hint=hint,
        )


def _show_noise(found: Calibration, name: str, pairs: PairedComparison) -> None:
    """Print the noise: a line for each metric, the smallest change by the number of pairs."""
    from r2bspec.judge.measure.units import show

    echo(f"{name} on {found.machine}")
    used = len(pairs.usable_pairs())
    echo(
        f"{used} pairs of the graph with itself, at {show(found.confidence, 'share')} confidence; "
        "smallest change detected with 90 % probability, by the number of pairs"
    )
    numbers = list(found.metrics[0].margins) if found.metrics else []
    header = ("metric", "noise", "at most", *(f"{n} pairs" for n in numbers))
    rows = []
    for noise in found.metrics:
        metric = f"{noise.monitor}.{noise.metric}" if noise.monitor else noise.metric
        at = f" at {show(noise.at_hz, 'Hz')}" if noise.at_hz is not None else ""
        rows.append(
            (
                f"{metric}{at}{' (biased)' if noise.biased else ''}",
                show(noise.deviation, "share"),
                show(noise.upper, "share"),
                *(_change_text(noise.margins[n]) for n in numbers),
            )
        )
    print_table(header, rows, right_columns=range(1, len(header)))
    if any(metric_noise.biased for metric_noise in found.metrics):
        echo(
            "biased: the second run of a pair differs from the first; noise alone causes this in "
            "one of ten metrics",
            err=True,
        )


def _change_text(margin: float) -> str:
    """A margin, given as a logarithm; over 100 % its digits are omitted."""
    from r2bspec.judge.measure.units import show

    change = math.expm1(min(margin, 1.0))
    return show(change, "share") if change <= 1 else "> 100 %"


def _propose_limits(
    selection: SpecSelection, prepared: PreparedBenchmark, found: Calibration, *, write: bool
) -> None:
    """Print the proposed change of the spec as a patch, or apply it."""
    from r2bspec.cli.check_files import read_text
    from r2bspec.compare.proposals import propose_limits

    file = str(selection.spec)
    before = read_text(file)
    if before is None or prepared.loaded is None:
        return
    after, notes = propose_limits(prepared.loaded, found, before)
    if after != before and not write:
        echo()  # between the table and the patch
    nothing = "every margin is above the noise: nothing is proposed"
    _show_change(file, before, after, notes, nothing, write=write)


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

    Limits of latencies are prediction bounds from the scatter of the iterations, with the margin of
    'r2bspec calibrate' if the spec has been calibrated. Each proposed requirement is one that the
    run passes. What the spec already requires is left alone.
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
        _calibrations(spec, prepared),
    )
    nothing = "the spec has a requirement for all that was measured"
    _show_change(str(spec), before, proposal.text, proposal.notes, nothing, write=write)


def _calibrations(spec: Path, prepared: PreparedBenchmark) -> list[Calibration]:
    from r2bspec.record.calibration_file import calibration_path, read_calibration_file
    from r2bspec.safe_io.safe_file import is_regular

    file = calibration_path(spec)
    if not is_regular(file) or prepared.loaded is None:
        return []
    calibration = read_calibration_file(file)
    if calibration is None:
        return []
    return list(calibration.benchmarks.get(prepared.loaded.id, {}).values())
