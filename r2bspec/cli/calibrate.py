"""``r2bspec calibrate``: measure the noise of a graph on this machine."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.shared_options import SpecValues, max_bytes_option, spec_options
from r2bspec.cli.spec_selection import SpecSelection, prepare_and_report
from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.record.calibration_file import Calibration
    from r2bspec.record.comparison_folder import PairedComparison


@click.command("calibrate")
@click.argument("spec", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--pairs",
    type=click.IntRange(min=3),
    help="The number of pairs of runs.  [default: 10]",
)
@click.option("--runs", type=click.IntRange(min=6), hidden=True, help="Twice --pairs.")
@click.option(
    "--from",
    "source",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="Use the folder of an earlier calibration or 'run --control' instead of running.",
)
@click.option(
    "--output",
    "-o",
    type=click.Path(path_type=Path, file_okay=False),
    help="The folder of the runs, new or empty.  [default: runs/NAME-pairs-TIME]",
)
@click.option("--write", is_flag=True, help="Apply the proposed changes to SPEC.")
@spec_options
@max_bytes_option
@click.option("--quiet", "-q", is_flag=True, help="Show no progress.")
def command(
    spec: Path,
    pairs: int | None,
    runs: int | None,
    source: Path | None,
    output: Path | None,
    write: bool,
    values: SpecValues,
    quiet: bool,
) -> int:
    """Compare SPEC with itself to find the smallest detectable change.

    The result is stored next to the spec, in NAME.noise.json; 'r2bspec validate' reads it and warns
    of margins below the noise. Limits above the noise are proposed as a patch of the spec; --write
    applies it.
    """
    if spec.suffix == ".json":
        raise click.UsageError("limits cannot be proposed for a plan: give the spec")
    if runs is not None:
        pairs = math.ceil(runs / 2)
    if source is not None and (pairs is not None or output is not None):
        raise click.UsageError(
            "--from cannot be combined with --pairs or --output: it runs nothing"
        )
    from r2bspec.compare.calibration import compute_calibration, store_calibration
    from r2bspec.record.comparison_folder import open_comparison

    selection = SpecSelection(spec, *values)
    prepared = prepare_and_report(selection)
    folder = source or _run(prepared, pairs or 10, output, quiet=quiet)
    compared = open_comparison(folder)
    _require_same_graph(prepared, compared, folder)
    found = compute_calibration(compared)
    path = store_calibration(spec, compared, found)
    _show(found, prepared.plan.name, compared)
    echo(f"stored in {path}", err=True)
    _propose(selection, prepared, found, write=write)
    return ExitStatus.OK


def _run(prepared: PreparedBenchmark, pairs: int, output: Path | None, *, quiet: bool) -> Path:
    from r2bspec import api
    from r2bspec.cli.run_options import RunOptions
    from r2bspec.cli.run_single import locked_host
    from r2bspec.plan.time_estimate import estimate_pairs
    from r2bspec.report.progress import RemainingTime, shown_progress

    remaining = RemainingTime(estimate_pairs(prepared.plan, pairs))
    folder = output or api.default_run_folder(f"{prepared.plan.name}-pairs")
    with (
        locked_host(f"{prepared.plan.name}-pairs", RunOptions()),
        shown_progress(quiet=quiet, remaining=remaining) as progress,
    ):
        api.calibrate(prepared, folder, progress, pairs=pairs, lock="off")
    return folder


def _require_same_graph(prepared: PreparedBenchmark, pairs: PairedComparison, folder: Path) -> None:
    from r2bspec.compare.errors import IncomparableError
    from r2bspec.plan.comparability import difference_lines, graph_differences, measured_hash

    if measured_hash(prepared.plan) != measured_hash(pairs.plan):
        differences = difference_lines(graph_differences(pairs.plan, prepared.plan))
        raise IncomparableError(
            f"the runs in {folder} are not of this spec:\n"
            + "\n".join(f"  {each}" for each in differences),
            hint="Run again without --from.",
        )


def _show(found: Calibration, name: str, pairs: PairedComparison) -> None:
    """Print the noise: a line for each metric, the smallest change by the number of pairs."""
    from r2bspec.measure.units import show

    echo(f"{name} on {found.machine}")
    used = len(pairs.usable_pairs())
    echo(
        f"{used} pairs of the graph with itself, at {show(found.confidence, 'share')} confidence; "
        "smallest change detected with 90 % probability, by the number of pairs"
    )
    numbers = list(found.metrics[0].margins) if found.metrics else []
    rows = [("metric", "noise", "at most", *(f"{n} pairs" for n in numbers))]
    for one in found.metrics:
        metric = f"{one.monitor}.{one.metric}" if one.monitor else one.metric
        at = f" at {show(one.at_hz, 'Hz')}" if one.at_hz is not None else ""
        rows.append(
            (
                f"{metric}{at}{' (biased)' if one.biased else ''}",
                show(one.deviation, "share"),
                show(one.upper, "share"),
                *(_change_text(one.margins[n]) for n in numbers),
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        echo("  ".join(cells).rstrip())
    if any(one.biased for one in found.metrics):
        echo(
            "biased: the second run of a pair differs from the first; noise alone causes this in "
            "one of ten metrics",
            err=True,
        )


def _change_text(margin: float) -> str:
    """A margin, given as a logarithm; over 100 % its digits are omitted."""
    from r2bspec.measure.units import show

    change = math.expm1(min(margin, 1.0))
    return show(change, "share") if change <= 1 else "> 100 %"


def _propose(
    selection: SpecSelection, prepared: PreparedBenchmark, found: Calibration, *, write: bool
) -> None:
    """Print the proposed change of the spec as a patch, or apply it."""
    from r2bspec.cli.fix import read_text, write_text
    from r2bspec.compare.proposals import propose_limits
    from r2bspec.diagnostics.edits import unified_diff

    file = str(selection.spec)
    before = read_text(file)
    if before is None or prepared.loaded is None:
        return
    after, notes = propose_limits(prepared.loaded, found, before)
    for each in notes:
        echo(each, err=True)
    if after == before:
        if not notes:
            echo("every margin is above the noise: nothing is proposed", err=True)
    elif write:
        write_text(file, after)
        echo(f"{file} was changed", err=True)
    else:
        echo()
        echo(unified_diff(before, after, file), nl=False)
        echo("--write applies this change", err=True)
