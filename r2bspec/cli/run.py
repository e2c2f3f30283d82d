"""``r2bspec run``: run benchmarks on real ROS 2 and judge them by their SLOs."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import click

from r2bspec.cli import shared_options
from r2bspec.cli.spec_selection import (
    ALL_CASES,
    SpecSelection,
    SuiteEntry,
    base_selection,
    prepare_and_report,
    suite_entries,
)
from r2bspec.language.quantities import Duration
from r2bspec.language.selected_spec import SelectionValues

if TYPE_CHECKING:
    from r2bspec.execute.states import Progress
    from r2bspec.judge.result import Result
    from r2bspec.plan.time_estimate import TimeEstimate
    from r2bspec.report.write_reports import ReportRequest


@dataclass(frozen=True, kw_only=True)
class RunArguments:
    """The options of the verbs that play; the names are those of the command line.

    Attributes:
        suite_page: the HTML page of the suite that a run belongs to, to which its own pages link.
    """

    output: Path | None = None
    against: tuple[str, ...] = ()
    control: bool = False
    pairs: int | None = None
    force: bool = False
    scan: tuple[str, ...] = ()
    smoke: bool = False
    resume: bool = False
    fail_fast: bool = False
    anatomy: bool = False
    profile: str | None = None
    wait: Duration | None = None
    no_lock: bool = False
    on: str = ""
    hosts: tuple[str, ...] = ("any",)
    output_format: str = "text"
    quiet: bool = False
    verbose: bool = False
    suite_page: Path | None = None
    reports: tuple[ReportRequest, ...] = ()

    @property
    def compares(self) -> bool:
        """Whether interleaved pairs are played."""
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
        return bool(self.scan or self.resume or self.fail_fast)

    def refuse(self, why: str, *options: str) -> None:
        """Report the first given option among some that do not apply.

        Raises:
            click.UsageError: with its name and `why`.
        """
        for option in options:
            if getattr(self, option[2:].replace("-", "_")) not in (None, False, (), ""):
                raise click.UsageError(f"{option} {why}")

    def check_resume(self) -> None:
        """Report ``--resume`` without the folder of an earlier call.

        Raises:
            click.UsageError: there is none.
        """
        if self.output is None:
            self.refuse("needs the --output of the earlier call", "--resume")


Entry = TypeVar("Entry", bound=SuiteEntry)


class Runs(Generic[Entry]):
    """How entries are played: as they are, or in pairs with the base of ``--against``.

    Attributes:
        notes: what is said of all entries together.
        needs_all: whether an error of one entry means that none is played.
    """

    notes: tuple[str, ...] = ()
    needs_all = False

    def __init__(self, options: RunArguments) -> None:
        self.options = options

    def name(self, entry: Entry) -> str:
        """Return the name of a single run in the queue, and of its folder."""
        options = self.options
        return entry.name + ("-pairs" if options.compares else "-smoke" if options.smoke else "")

    def check(self, entries: Sequence[Entry]) -> None:
        """Refuse what a prepared entry shows; nothing is played yet.

        An error of one of several entries is kept in it (`kept_error`).
        """

    def build(self, entry: Entry) -> None:
        """Make what is played beside the spec; this call has the host."""

    def estimate(self, entry: Entry) -> TimeEstimate:
        """Return how long an entry will take."""
        from r2bspec.plan.time_estimate import estimate_time

        if not self.options.compares:
            return estimate_time(entry.benchmark.plan)

        from r2bspec.compare.interleaved_comparison import estimate_comparison

        return estimate_comparison(entry.benchmark.plan, self.options.pairs)

    def play(self, entry: Entry, progress: Progress) -> Result:
        """Play an entry into its folder."""
        from r2bspec import api

        options = self.options
        if not options.compares:
            return api.run(
                entry.benchmark,
                entry.folder,
                progress,
                wait_s=None,
                anatomy=options.anatomy,
                profile=options.profile or "",
            )
        return api.run_pairs(
            entry.benchmark,
            options.against,
            entry.folder,
            progress,
            prepare_base=lambda reference: prepare_and_report(
                base_selection(entry.selection, reference)
            ),
            pairs=options.pairs,
            control=options.control,
            force=options.force,
            wait_s=None,
        )


@click.command("run")
@click.argument("specs", nargs=-1, required=True, metavar="SPEC...")
@shared_options.output_option
@shared_options.spec_options
@shared_options.suite_options
@shared_options.flag_options(
    {
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
@shared_options.queue_options
@shared_options.result_options()
def command(
    specs: tuple[str, ...],
    values: SelectionValues,
    reports: tuple[ReportRequest, ...],
    **others: Any,
) -> int:
    """Run SPEC and judge it by its SLOs.

    SPEC is a spec, or a plan written by 'r2bspec plan'. Progress is printed to standard error, the
    report to standard output. All samples and logs are stored in the run folder.

    Several specs, a folder, a pattern such as 'specs/*.r2b.yaml', '--case all' and --scan are run
    one after the other, with one summary and the worst exit status.

    Requirements 'of baseline' are inconclusive here: 'r2bspec gate' judges them against a revision,
    'r2bspec compare' against another spec.
    """
    options = RunArguments(reports=reports, **others)
    options.check_resume()
    from r2bspec.cli.run_specs import run_specs

    several = len(specs) > 1 or options.needs_suite or values["case"] == ALL_CASES
    if several or _is_collection(specs[0]):
        return run_specs(selected_runs(specs, values, options), Runs(options), several=True)
    entry = SuiteEntry(SpecSelection(Path(specs[0]), **values))
    return run_specs([entry], Runs(options), several=False)


def selected_runs(
    specs: Sequence[str], values: SelectionValues, options: RunArguments
) -> list[SuiteEntry]:
    """Return the runs of several specs, with their cases and scanned values."""
    from r2bspec.cli.check_files import spec_files

    selection = SpecSelection(Path(), **values)
    return suite_entries(selection, spec_files(specs), options.scan)


def _is_collection(path: str) -> bool:
    """Return whether a path is a folder, or a pattern that is no file."""
    import glob

    # Not those of Path: a name may be too long.
    return os.path.isdir(path) or (glob.has_magic(path) and not os.path.exists(path))  # noqa: PTH110, PTH112
