"""``r2bspec run``: run benchmarks on real ROS 2 and judge them by their SLOs.

`RunArguments` says which of its options go together.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from r2bspec.cli import shared_options
from r2bspec.cli.spec_selection import ALL_CASES, SpecSelection, is_file_list, suite_entries
from r2bspec.language.quantities import Duration
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.report.output import echo
from r2bspec.safe_io.limits import MAX_PLANNED_ITERATIONS

if TYPE_CHECKING:
    from r2bspec.report.write_reports import ReportRequest


@dataclass(frozen=True, kw_only=True)
class RunArguments:
    """The options as they were given; the names are those of the command line.

    Attributes:
        suite_page: the HTML page of the suite that a run belongs to, to which its own pages link.
    """

    output: Path | None = None
    against: tuple[str, ...] = ()
    control: bool = False
    pairs: int | None = None
    force: bool = False
    each: bool = False
    select: tuple[str, ...] = ()
    scan: tuple[str, ...] = ()
    smoke: bool = False
    resume: bool = False
    fail_fast: bool = False
    anatomy: bool = False
    profile: str | None = None
    wait: Duration | None = None
    no_lock: bool = False
    on: str | None = None
    hosts: tuple[str, ...] = ("any",)
    output_format: str = "text"
    quiet: bool = False
    verbose: bool = False
    suite_page: Path | None = None
    reports: tuple[ReportRequest, ...] = ()

    @property
    def compares(self) -> bool:
        """Whether interleaved pairs are run."""
        return bool(self.against) or self.control

    @property
    def wait_s(self) -> float | None:
        """How long to wait while this host runs other benchmarks; None to run next to them."""
        if self.no_lock or self.smoke:
            return None
        return math.inf if self.wait is None else self.wait.seconds

    @property
    def needs_suite(self) -> bool:
        """Whether an option only makes sense for several runs."""
        return bool(self.select or self.scan or self.resume or self.fail_fast or self.each)

    def given(self, *options: str) -> list[str]:
        """Those of some options that are given."""
        unset: tuple[object, ...] = (None, False, (), "")
        return [name for name in options if getattr(self, name[2:].replace("-", "_")) not in unset]

    def refuse(self, why: str, *options: str) -> None:
        """Report the first of some options that is given, if one is.

        Raises:
            click.UsageError: with its name and `why`.
        """
        _refuse(self.given(*options), why)

    def check(self) -> None:
        """Report options that exclude each other, or need another one.

        Raises:
            click.UsageError: there are some.
        """
        if self.against:
            self.refuse(
                "cannot be combined with --against: it compares SPEC with itself", "--control"
            )
        if self.on is None:
            _refuse(["--hosts"] if self.hosts != ("any",) else [], "needs --on")
        comparisons = self.given("--against", "--control")
        if self.smoke:
            _refuse(comparisons, "cannot be combined with --smoke, which judges nothing")
        if self.compares:
            self.refuse("cannot be combined with --against or --control", "--anatomy", "--profile")
        if not self.against:
            self.refuse("needs --against", "--force")
        if self.output is None:
            self.refuse("needs the --output of the earlier call", "--resume")

    @contextlib.contextmanager
    def sparing_inputs(self) -> Iterator[None]:
        """Within this context, what is read is an input of the run, which no report may replace.

        Raises:
            ReportUsageError: a report would.
        """
        from r2bspec.report.write_reports import check_targets
        from r2bspec.safe_io.looked_up_files import looked_up_files

        with looked_up_files() as read:
            try:
                yield
            finally:
                check_targets(self.reports, read.files, self.output)

    def check_pairs(self) -> None:
        """Report ``--pairs`` without a comparison.

        Raises:
            click.UsageError: there is none.
        """
        if not self.compares:
            self.refuse("needs --against or --control", "--pairs")

    def check_fleet(self) -> None:
        """Report options that do not go with ``--on``.

        Raises:
            click.UsageError: there are some.
        """
        why = "cannot be combined with --on"
        self.refuse(why, "--no-lock", "--wait")
        self.refuse(why, "--anatomy", "--profile")

    def check_suite(self) -> None:
        """Report options that are for a single run.

        Raises:
            click.UsageError: there are some.
        """
        if self.compares:
            raise click.UsageError(
                "--against and --control take one SPEC, without --case all, --select, --scan, "
                "--resume, --fail-fast and --each; 'r2bspec gate' takes a folder"
            )


def _refuse(given: Sequence[str], why: str) -> None:
    if given:
        raise click.UsageError(f"{given[0]} {why}")


@click.command("run")
@click.argument("specs", nargs=-1, required=True, metavar="SPEC...")
@click.option(
    "--output",
    "-o",
    type=shared_options.FOLDER,
    help="The run folder, new or empty.  [default: runs/NAME-TIME]",
)
@shared_options.spec_options
@shared_options.flag_options(
    {
        "--smoke": "One short iteration that shows whether all works; no verdict.",
        "--each": "Run two specs one after the other; do not compare them.",
    }
)
@shared_options.repeatable_option(
    "--select",
    metavar="LABEL=VALUE",
    help="Only specs with this label, such as sensor=camera or sensor='cam*'",
)
@shared_options.repeatable_option(
    "--scan",
    metavar="NAME=VALUE,...",
    help="A run for each value of a variable, or of a key such as transport",
)
@shared_options.flag_options(
    {
        "--resume": "Run only what the folder of --output does not have yet.",
        "--fail-fast": "End after the first run that does not pass.",
        "--anatomy": "Play one more iteration, which counts for nothing, and observe from inside "
        "where each millisecond goes.",
    }
)
@click.option(
    "--profile",
    metavar="PROFILER",
    help="Play one more iteration, which counts for nothing, and start each node with "
    "perf, py-spy, nsys, or any program that runs the command after its own words.",
)
@click.option(
    "--on",
    metavar="SCHEDULER",
    help="Run on the hosts of a fleet: the address of its Dask scheduler ('r2bspec docs fleet').",
)
@click.option(
    "--hosts",
    default="any",
    show_default=True,
    metavar="any|all|NAME,...",
    help="With --on: each run on any host that fits, on every one of them, or on those named.",
)
@shared_options.queue_options
@shared_options.repeatable_option(
    "--against",
    "against",
    metavar="REF",
    help="Compare in interleaved runs with another spec, var:NAME=VALUE, set:PATH=VALUE, or env: "
    "with a setup file, an installed workspace or NAME=VALUE",
)
@click.option("--control", is_flag=True, help="Compare SPEC with itself to see the noise.")
@click.option(
    "--pairs",
    type=click.IntRange(min=1, max=MAX_PLANNED_ITERATIONS),
    help="The number of pairs of runs to compare.  [default: benchmark.iterations]",
)
@shared_options.flag_options(
    {
        "--force": "Compare even if the load differs.",
    }
)
@shared_options.format_option()
@shared_options.quiet_option
@shared_options.verbose_option
@shared_options.reports_option
def command(
    specs: tuple[str, ...],
    values: SelectionValues,
    reports: tuple[ReportRequest, ...],
    **others: Any,
) -> int:
    """Run SPEC and judge it by its SLOs.

    SPEC is a spec, or a plan written by 'r2bspec plan'. Progress is printed to standard error, the
    report to standard output. All samples and logs are stored in the run folder.

    Two specs are compared in interleaved runs, the first being the base. More of them, a folder, a
    pattern such as 'specs/*.r2b.yaml', '--case all' and --scan are run one after the other, with
    one summary and the worst exit status. With --on, they run on the hosts of a fleet.

    Requirements 'of baseline' are judged by interleaved runs of a base and of SPEC (--against).
    Without it they are inconclusive.

    The gate of a pull request is 'r2bspec gate'.
    """
    hosts = tuple(dict.fromkeys(host for host in others.pop("hosts").split(",") if host))
    options = RunArguments(reports=reports, hosts=hosts or ("any",), **others)
    options.check()
    from r2bspec.cli.check_files import spec_files
    from r2bspec.cli.run_single import run_single
    from r2bspec.cli.run_suite import run_suite

    several = options.needs_suite or values["case"] == ALL_CASES
    if options.on is not None:
        options.check_fleet()
    pair = len(specs) == 2 and not several and not options.smoke
    if pair and is_file_list(specs):
        base, head = specs
        echo(f"comparing {head} with {base} in pairs; --each runs them one by one", err=True)
        options = replace(options, against=(base, *options.against))
        options.check()
        if options.on is None:
            return run_single(SpecSelection(Path(head), **values), options)
        specs = (head,)
    options.check_pairs()
    if len(specs) == 1 and options.on is None and not several and not _is_collection(specs[0]):
        return run_single(SpecSelection(Path(specs[0]), **values), options)
    if options.on is None:
        options.check_suite()
    selection = SpecSelection(Path(), **values)
    return run_suite(
        suite_entries(selection, spec_files(specs), options.select, options.scan), options
    )


def _is_collection(path: str) -> bool:
    """Whether a path is a folder, or a pattern that is no file."""
    import glob

    # Not those of Path: a name may be too long.
    return os.path.isdir(path) or (glob.has_magic(path) and not os.path.exists(path))  # noqa: PTH110, PTH112
