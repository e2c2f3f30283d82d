"""``r2bspec judge``: judge a finished run again, by its own SLOs or by those of another spec."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.shared_options import junit_option, reports_option, verbose_option

if TYPE_CHECKING:
    from r2bspec.language.spec import Spec
    from r2bspec.report.write_reports import ReportRequest


@click.command("judge")
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--spec",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="SPEC",
    help="Judge by the SLOs and the gate of this spec instead of the run's own.",
)
@click.option(
    "--format",
    "output_format",
    type=click.Choice(["text", "json"]),
    default="text",
    show_default=True,
    help="The output format.",
)
@click.option("--write", is_flag=True, help="Replace result.json in the run folder.")
@reports_option
@junit_option
@verbose_option
def command(
    run: Path,
    spec: Path | None,
    output_format: str,
    write: bool,
    reports: tuple[ReportRequest, ...],
    junit: tuple[ReportRequest, ...],
    verbose: bool,
) -> int:
    """Judge the finished run or comparison in the folder RUN again; needs no ROS.

    The folder is not changed without --write. The same folder gives the same bytes each time. Of
    the gate of --spec, time_budget has no effect, because nothing is played. RUN
    may also be a report of ros2_benchmark, to be judged by the SLOs of --spec.
    """
    from r2bspec.compare.report_input import read_folder
    from r2bspec.judge.judge_run import to_json
    from r2bspec.plan.compile_plan import gate_plan
    from r2bspec.record.run_folder import RunFolder
    from r2bspec.report.terminal import show_result
    from r2bspec.report.write_reports import takes_stdout, write_reports
    from r2bspec.safe_io.safe_file import is_regular

    if is_regular(run):
        return _judge_report(run, spec, output_format, plain=not (write or reports or junit))
    if spec is None:
        found = read_folder(run)
    else:
        other = _load(spec)
        found = read_folder(
            run,
            spec_file=spec,
            objectives=other.slos,
            judged_by=other.name,
            gate=gate_plan(other),
        )
    if write:
        RunFolder(run.absolute()).write_result(to_json(found.result))
    if not takes_stdout(reports + junit):
        show_result(found.result, output_format, run, verbose=verbose)
    write_reports(reports + junit, replace(found, verbose=verbose))
    return found.result.verdict.exit_code


def _judge_report(report: Path, spec: Path | None, output_format: str, *, plain: bool) -> int:
    """Judge a report of the reference tool, which has no run folder and no samples."""
    from r2bspec.interop.imported_verdicts import judge_report
    from r2bspec.interop.ros2_benchmark import read_report
    from r2bspec.plan.compile_plan import gate_plan
    from r2bspec.report.terminal import show_verdict

    found = read_report(report)
    if spec is None:
        raise click.UsageError(f"{report} has no SLOs: give a spec with --spec")
    if not plain:
        raise click.UsageError("--write, --report and --junit-xml need a run folder")
    other = _load(spec)
    verdict = judge_report(found, other.slos, gate_plan(other))
    show_verdict(found.name or str(report), verdict, output_format)
    return verdict.exit_code


def _load(path: Path) -> Spec:
    """The other spec, with the findings about its SLOs and its gate only.

    Its bag and its nodes may be missing here: nothing is run.

    Raises:
        InvalidSpecError: it is not valid; the findings have been shown.
    """
    from r2bspec.api import InvalidSpecError
    from r2bspec.check import check
    from r2bspec.language.load_spec import load_spec
    from r2bspec.report.findings_text import print_findings as show

    loaded = load_spec(path)
    found = [
        each
        for each in check(loaded, offline=True)
        if loaded.spec is None
        or each.path[:1] == ("slos",)
        or each.path[:2] == ("benchmark", "gate")
    ]
    show(found, loaded.texts)
    if loaded.spec is None or any(each.severity == "error" for each in found):
        raise InvalidSpecError(loaded, found)
    return loaded.spec
