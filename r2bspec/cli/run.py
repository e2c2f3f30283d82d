"""``r2bspec run``: run benchmarks on real ROS 2 and judge them by their SLOs."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from r2bspec.cli.run_options import ALL_CASES, RunOptions
from r2bspec.cli.shared_options import (
    SpecValues,
    connection_options,
    junit_option,
    max_bytes_option,
    reports_option,
    spec_options,
    verbose_option,
)
from r2bspec.cli.spec_selection import SpecSelection
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.report.write_reports import ReportRequest


@click.command("run")
@click.argument("specs", nargs=-1, required=True, metavar="SPEC...")
@click.option(
    "--output",
    "-o",
    type=click.Path(path_type=Path, file_okay=False),
    help="The run folder, new or empty.  [default: runs/NAME-TIME]",
)
@spec_options
@max_bytes_option
@click.option(
    "--smoke", is_flag=True, help="One short iteration that shows whether all works; no verdict."
)
@click.option(
    "--each", is_flag=True, help="Run two specs one after the other; do not compare them."
)
@click.option(
    "--select",
    multiple=True,
    metavar="LABEL=VALUE",
    help="Only specs with this label, such as sensor=camera or sensor='cam*'; may be repeated.",
)
@click.option(
    "--scan",
    multiple=True,
    metavar="NAME=VALUE,...",
    help="A run for each value of a variable, or of a key such as transport; may be repeated.",
)
@click.option(
    "--resume", is_flag=True, help="Run only what the folder of --output does not have yet."
)
@click.option("--fail-fast", is_flag=True, help="End after the first run that does not pass.")
@click.option(
    "--abort-on-fail",
    is_flag=True,
    help="End a rate as soon as a requirement at it can no longer be met.",
)
@click.option(
    "--record-outputs",
    is_flag=True,
    help="Record inputs and outputs of one more iteration, with latencies, as MCAP in 'outputs/'.",
)
@click.option(
    "--profile",
    metavar="PROFILER",
    help="Play one more iteration, which counts for nothing, with perf, py-spy, nsys, or any "
    "program that starts the command after its own words.",
)
@click.option(
    "--profile-node",
    metavar="NODE",
    help="The node that --profile observes.  [default: all nodes]",
)
@click.option(
    "--on",
    metavar="SCHEDULER",
    help="Run on the hosts of a fleet: the address of its scheduler, or a cluster file.",
)
@click.option(
    "--hosts",
    default="all",
    show_default=True,
    metavar="all|any|NAME,...",
    help="With --on: on every host that fits, on any one of them, or on those that are named.",
)
@click.option(
    "--host-timeout",
    type=click.FloatRange(min=0),
    default=600.0,
    show_default=True,
    metavar="SECONDS",
    help="With --on: how long runs wait for a host that left.",
)
@click.option(
    "--retry-invalid",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="With --on: how often an invalid run is made again, on the same host.",
)
@connection_options
@click.option(
    "--timings", is_flag=True, help="Print where the time of the run went, to standard error."
)
@click.option("--no-wait", is_flag=True, help="Refuse to run while this host runs a benchmark.")
@click.option("--no-lock", is_flag=True, help="Run even while this host runs a benchmark.")
@click.option(
    "--against",
    "against",
    multiple=True,
    metavar="REF",
    help="Compare with a base in interleaved runs: a revision of git such as origin/main, another "
    "work tree or spec, var:NAME=VALUE, set:PATH=VALUE, or env: with a setup file, an installed "
    "workspace or NAME=VALUE; may be repeated.",
)
@click.option(
    "--allow",
    multiple=True,
    metavar="NAME",
    help="With --against a revision: what may be weaker than in the base, such as 'objective "
    "fast', as the error names it; or 'base', which may fail. May be repeated.",
)
@click.option(
    "--base-build",
    multiple=True,
    metavar="COMMAND",
    help="With --against a revision: how the base is built in its work tree, where its spec does "
    "not say it (benchmark.gate.base); may be repeated.",
)
@click.option(
    "--base-setup",
    default="",
    metavar="PATH",
    help="With --against a revision: the setup file or installation of the base after its build, "
    "relative to its work tree.",
)
@click.option("--control", is_flag=True, help="Compare SPEC with itself to see the noise.")
@click.option(
    "--pairs",
    type=click.IntRange(min=1),
    help="The number of pairs of runs to compare.  [default: benchmark.iterations]",
)
@click.option(
    "--history",
    metavar="FILE",
    help="Gate by the earlier runs in FILE and add this one; 'user' is a file in your data folder.",
)
@click.option(
    "--baseline",
    type=click.Path(path_type=Path),
    metavar="RUN",
    help="Compare with a stored run or result; advisory, never gates.",
)
@click.option(
    "--require-slos",
    is_flag=True,
    help="Refuse a spec without an objective that can fail: nothing would gate.",
)
@click.option("--force", is_flag=True, help="Compare even if load, data or machine differ.")
@click.option(
    "--format",
    "output_format",
    type=click.Choice(["text", "json"]),
    default="text",
    show_default=True,
    help="The output format.",
)
@click.option("--quiet", "-q", is_flag=True, help="Show no progress.")
@verbose_option
@reports_option
@junit_option
def command(
    specs: tuple[str, ...],
    values: SpecValues,
    reports: tuple[ReportRequest, ...],
    junit: tuple[ReportRequest, ...],
    **others: Any,
) -> int:
    """Run SPEC and judge it by its SLOs.

    SPEC is a spec, or a plan written by 'r2bspec plan'. Progress is printed to standard error, the
    report to standard output. All samples and logs are stored in the run folder.

    Two specs are compared in interleaved runs, the first being the base. More of them, a folder, a
    pattern such as 'specs/*.r2b.yaml', '--case all' and --scan are run one after the other, with
    one summary and the worst exit status. With --on, specs run on the hosts of a
    fleet ('r2bspec fleet').

    Requirements 'of baseline' are judged by interleaved runs of a base and of SPEC (--against), or
    by earlier runs (--history). Without either they are inconclusive.

    --against REVISION is the gate of a pull request: the same spec with the code of the base and of
    this work tree. What the base demands must still be demanded ('r2bspec docs gate').
    """
    connection = {name: others.pop(name) for name in ("ca", "certificate", "key", "insecure")}
    hosts = tuple(dict.fromkeys(each for each in others.pop("hosts").split(",") if each))
    options = RunOptions(
        reports=reports + junit, connection=connection, hosts=hosts or ("all",), **others
    )
    options.check()
    from r2bspec.cli.run_selection import is_file_list, run_items
    from r2bspec.cli.run_single import run_single
    from r2bspec.cli.run_suite import run_suite
    from r2bspec.cli.spec_files import present_spec_files, spec_files

    # Whether a spec that is gone may be gone is for the gate to say, which knows the base.
    files = present_spec_files(specs) if options.has_base_tree else None
    several = options.needs_suite or values.case == ALL_CASES or files == []
    if options.on is not None:
        options.check_fleet()
    pair = len(specs) == 2 and not several and not options.smoke and not options.has_base_tree
    if pair and is_file_list(specs):
        base, head = specs
        echo(f"comparing {head} with {base} in pairs; --each runs them one by one", err=True)
        options = replace(options, against=(base, *options.against))
        options.check()
        if options.on is None:
            return run_single(SpecSelection(Path(head), *values), options)
        specs = (head,)
    options.check_pairs()
    if len(specs) == 1 and options.on is None and not several and not _is_collection(specs[0]):
        return run_single(SpecSelection(Path(specs[0]), *values), options)
    if options.on is None:
        options.check_suite()
    if files is None:
        files = spec_files(specs)
    selection = SpecSelection(Path(), *values)
    items = run_items(selection, files, options.select, options.scan) if files else []
    return run_suite(items, options, specs)


def _is_collection(path: str) -> bool:
    """Whether a path is a folder, or a pattern that is no file."""
    import glob

    # Not those of Path: a name may be too long.
    return os.path.isdir(path) or (glob.has_magic(path) and not os.path.exists(path))  # noqa: PTH110, PTH112
