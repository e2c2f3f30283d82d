"""The verbs about a finished run: ``judge`` and ``report``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli import shared_options as options
from r2bspec.cli.spec_selection import SpecSelection, prepare_and_report
from r2bspec.cli.text_output import show_findings
from r2bspec.diagnostics.quote import quoted_list
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.compare.report_input import ReportInput
    from r2bspec.language.spec import Spec
    from r2bspec.report.write_reports import ReportRequest


@click.command("judge")
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--spec",
    type=options.FILE,
    metavar="SPEC",
    help="Judge by the SLOs and the gate of this spec instead of the run's own.",
)
@click.option(
    "--suggest",
    "suggest_for",
    type=options.FILE,
    metavar="SPEC",
    help="Propose objectives that the spec of the run lacks, as a patch, instead of judging.",
)
@options.spec_options
@options.format_option()
@click.option(
    "--write",
    is_flag=True,
    help="Replace result.json in the run folder; with --suggest, change SPEC.",
)
@options.reports_option
@options.verbose_option
def judge_command(
    run: Path,
    spec: Path | None,
    suggest_for: Path | None,
    values: SelectionValues,
    output_format: str,
    write: bool,
    reports: tuple[ReportRequest, ...],
    verbose: bool,
) -> int:
    """Judge the finished run or comparison in the folder RUN again; needs no ROS.

    The folder is not changed without --write. The same folder gives the same bytes each time. Of
    the gate of --spec, time_budget has no effect, because nothing is played.

    With --suggest, the run passes each proposed requirement. Limits of latencies have a margin for
    the scatter of the starts. What the spec already requires is left alone.
    """
    if suggest_for is not None:
        if spec is not None or reports or verbose or output_format != "text":
            raise click.UsageError("--suggest prints a patch: it takes --write and no report")
        return _suggest(run, SpecSelection(suggest_for, **values), write=write)
    from r2bspec.compare.report_input import read_folder
    from r2bspec.judge.judge_run import to_json
    from r2bspec.plan.compile_plan import gate_plan
    from r2bspec.record.run_folder import RunFolder
    from r2bspec.report.terminal import show_result
    from r2bspec.report.write_reports import check_targets, takes_stdout, write_reports
    from r2bspec.safe_io.safe_file import is_there

    if run.name == "result.json" and is_there(run.with_name("plan.json")):
        run = run.parent
    if spec is None:
        if any(values.values()):
            raise click.UsageError("--set, --var and --case are for --spec and --suggest")
        result = read_folder(run)
    else:
        check_targets(reports, [str(spec)])
        other = _load_objectives(SpecSelection(spec, **values))
        result = read_folder(
            run,
            spec_file=spec,
            objectives=other.slos,
            judged_by=other.name,
            gate=gate_plan(other),
        )
    _say_what_is_not_judged(result)
    if write:
        RunFolder(run.absolute()).write_result(to_json(result.result))
    if not takes_stdout(reports):
        show_result(result.result, output_format, run, verbose=verbose)
    write_reports(reports, replace(result, verbose=verbose))
    return result.result.verdict.exit_code


def _say_what_is_not_judged(found: ReportInput) -> None:
    names = found.run.unlisted_segments() if found.run is not None else []
    if names:
        echo(
            f"note: the record does not list the samples of {quoted_list(names)}; "
            "they were not judged",
            err=True,
        )


def _load_objectives(selection: SpecSelection) -> Spec:
    """Return the other spec, with the findings about its SLOs and its gate only.

    Its bag and its nodes may be missing here: nothing is run.

    Raises:
        InvalidSpecError: it is not valid; the findings have been shown.
    """
    from r2bspec.api import InvalidSpecError
    from r2bspec.check import check

    loaded = selection.load()
    findings = [
        finding
        for finding in check(loaded, offline=True)
        if loaded.spec is None
        or finding.path[:1] == ("slos",)
        or finding.path[:2] == ("benchmark", "gate")
    ]
    show_findings(findings, loaded)
    if loaded.spec is None or any(finding.severity == "error" for finding in findings):
        raise InvalidSpecError(loaded, findings)
    return loaded.spec


def _suggest(folder: Path, selection: SpecSelection, *, write: bool) -> int:
    """Print objectives that a run proposes for its spec as a patch, or apply them.

    Raises:
        IncomparableError: the run is of another graph.
        UsageError: the spec cannot be changed.
    """
    from r2bspec.cli.check_files import read_text, write_text
    from r2bspec.compare.proposals import propose_objectives
    from r2bspec.compare.report_input import read_folder
    from r2bspec.diagnostics.edits import unified_diff
    from r2bspec.judge.judge_run import result_of
    from r2bspec.plan import comparability
    from r2bspec.record.run_folder import open_run

    prepared = prepare_and_report(selection)
    finished, plan, file = open_run(folder), prepared.plan, str(selection.spec)
    before = read_text(file)
    if before is None or prepared.loaded is None:
        raise UsageError(
            f"{file} cannot be changed: it is a plan, or a link",
            hint="Give the spec, or the file that the link leads to.",
        )
    if comparability.measured_hash(plan) != comparability.measured_hash(finished.plan):
        differences = comparability.graph_differences(finished.plan, plan)
        lines = comparability.difference_lines(differences)
        raise comparability.IncomparableError(
            "\n  ".join([f"the run in {folder} is not of this spec:", *lines]),
            hint="Run it again, or give the --set, --var and --case of the run.",
        )
    proposal = propose_objectives(
        prepared.loaded,
        before,
        read_folder(folder).result,
        lambda objectives: result_of(finished, objectives, plan.name),
    )
    for note in proposal.notes:
        echo(note, err=True)
    if proposal.text == before:
        if not proposal.notes:
            echo("the spec has a requirement for all that was measured", err=True)
    elif write:
        write_text(file, proposal.text)
        echo(f"{file} was changed", err=True)
    else:
        echo(unified_diff(before, proposal.text, file), nl=False)
        echo("--write applies this change", err=True)
    return ExitStatus.OK


@click.command("report")
@click.argument("run", type=click.Path(path_type=Path))
@options.reports_option
@options.verbose_option
@click.option(
    "--spec",
    type=options.FILE,
    metavar="SPEC",
    help="The spec of the run, so that annotations can refer to its lines.",
)
def report_command(
    run: Path,
    reports: tuple[ReportRequest, ...],
    verbose: bool,
    spec: Path | None,
) -> int:
    """Write reports of RUN: the folder of a run or a comparison, or a result.json.

    A result.json gives fewer charts than the folder, which has every message. The exit status says
    whether the reports were written; for the verdict, use 'r2bspec judge'.
    """
    from r2bspec.compare.report_input import read_report_input
    from r2bspec.report.format_registry import ReportUsageError
    from r2bspec.report.write_reports import check_targets, write_reports

    if not reports:
        raise ReportUsageError(
            "no report was requested", hint="Name a format and a file: --report html=report.html"
        )
    check_targets(reports, [str(run), *([str(spec)] if spec is not None else ())])
    report_input = read_report_input(run, spec_file=spec)
    _say_what_is_not_judged(report_input)
    write_reports(reports, replace(report_input, verbose=verbose))
    return ExitStatus.OK
