"""``r2bspec fleet``: runs are placed on the hosts of a fleet, played there, and fetched."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from r2bspec.cli import shared_options
from r2bspec.cli.main import show_error
from r2bspec.cli.run import RunArguments, Runs, selected_runs
from r2bspec.cli.spec_selection import SuiteEntry, base_selection, prepare_and_report
from r2bspec.diagnostics.plain_text import plain
from r2bspec.diagnostics.quote import pluralize, time_text
from r2bspec.errors import R2bspecError
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.cli.suite import Playing, Suite
    from r2bspec.fleet.client import EndedRun, Fleet, FleetRun
    from r2bspec.language.selected_spec import SelectionValues
    from r2bspec.report.suite import SuiteRun
    from r2bspec.report.write_reports import ReportRequest


@click.group("fleet")
def command() -> None:
    """Run benchmarks on the hosts of a fleet ('r2bspec docs fleet')."""


@command.command("run")
@click.argument("specs", nargs=-1, required=True, metavar="SPEC...")
@click.option(
    "--on",
    required=True,
    metavar="SCHEDULER",
    help="The address of the Dask scheduler of the fleet.",
)
@click.option(
    "--hosts",
    default="any",
    show_default=True,
    metavar="any|all|NAME,...",
    help="Each run on any host that fits, on every host that fits, or on those named.",
)
@shared_options.output_option
@shared_options.spec_options
@shared_options.suite_options
@shared_options.against_option
@shared_options.pairs_option
@shared_options.result_options()
def run_command(
    specs: tuple[str, ...],
    values: SelectionValues,
    reports: tuple[ReportRequest, ...],
    **others: Any,
) -> int:
    """Run each SPEC on a host of a fleet, and judge it by its SLOs.

    As 'r2bspec run' does here; a host plays one run at a time. With --against, each SPEC is
    compared with its base in interleaved runs, both on one host.
    """
    hosts = tuple(dict.fromkeys(host for host in others.pop("hosts").split(",") if host))
    options = RunArguments(reports=reports, hosts=hosts or ("any",), **others)
    options.check_resume()
    if options.smoke:
        options.refuse("cannot be combined with --smoke, which judges nothing", "--against")
    if not options.compares:
        options.refuse("needs --against", "--pairs")
    from r2bspec.cli.run_specs import prepare_entries
    from r2bspec.cli.suite import Suite
    from r2bspec.fleet.client import Fleet
    from r2bspec.safe_io.private_files import private_files

    entries = selected_runs(specs, values, options)
    suite = Suite.of(options)
    prepare_entries(entries, options, several=True)
    with private_files(), Fleet(options.on) as fleet:
        executor = FleetExecutor(suite, options, fleet)
        placed = executor.place(entries)
        suite.enter(placed)
        return suite.run(executor.announce(placed), executor.play(placed))


@dataclass
class FleetExecutor:
    """Plays the runs of a suite on the hosts of a fleet."""

    suite: Suite
    options: RunArguments
    fleet: Fleet

    def place(self, entries: Sequence[SuiteEntry]) -> list[SuiteEntry]:
        """Return an entry for each run: with ``--hosts all`` for each host that fits."""
        from r2bspec.fleet.client import place

        hosts = list(self.fleet.hosts.values())
        placed = []
        runs = Runs[SuiteEntry](self.options)
        for entry in entries:
            if entry.prepared is None:
                placed.append(entry)
                continue
            entry.estimate = runs.estimate(entry)
            for assignment in place(entry.prepared.plan, self.options.hosts, hosts):
                if assignment.error is not None:
                    show_error(assignment.error)
                placed.append(replace(entry, host=assignment.host, error=assignment.error))
        return placed

    def announce(self, entries: Sequence[SuiteEntry]) -> str:
        """Return how long the runs will take if no host is lost."""
        hosts = max(len(self.fleet.hosts), 1)
        total = sum(entry.seconds for entry in entries) / hosts
        runs = f"{pluralize(len(entries), 'run')} on {pluralize(hosts, 'host')}"
        return f"{runs}: about {time_text(total)}"

    def play(self, entries: Sequence[SuiteEntry]) -> Playing:
        """Yield every run when it has ended, first those that need not be played."""
        by_run: dict[FleetRun, SuiteEntry] = {}
        for entry in entries:
            if (settled := self.suite.settled(entry)) is not None:
                yield entry, settled
                continue
            try:
                by_run[self._fleet_run(entry)] = entry
            except R2bspecError as error:
                yield entry, self.suite.failed(entry, error)
        with contextlib.closing(self.fleet.play(list(by_run), self._say)) as playing:
            for number, ended in enumerate(playing, start=1):
                entry = by_run[ended.run]
                run = self._row(entry, ended)
                on = f" on {ended.host}" if ended.host else ""
                self._say(f"[{number}/{len(by_run)}] {entry.name}{on}: {run.outcome}")
                yield entry, run

    def _say(self, text: str) -> None:
        if not self.options.quiet:
            echo(plain(text), err=True)

    def _row(self, entry: SuiteEntry, ended: EndedRun) -> SuiteRun:
        from r2bspec.compare.report_input import read_folder

        try:
            if ended.error is not None:
                raise ended.error
            result = read_folder(entry.folder).result
        except R2bspecError as error:
            show_error(error)
            return self.suite.failed(entry, error, ended.host)
        return self.suite.keep(entry, result, resumed=False, host=ended.host)

    def _fleet_run(self, entry: SuiteEntry) -> FleetRun:
        """Return what a host needs to make a run.

        Raises:
            R2bspecError: the base has errors, or the files cannot travel.
        """
        from r2bspec.compare.base_reference import parse_base_reference
        from r2bspec.fleet.bundle import make_bundle
        from r2bspec.fleet.client import FleetRun
        from r2bspec.fleet.host import Job

        options = self.options
        sides = [entry.benchmark]
        words = ["--smoke"] if options.smoke else []
        words += ["--pairs", str(options.pairs)] if options.pairs is not None else []
        if options.against:
            reference = parse_base_reference(options.against)
            words += [f"--against=env:{text}" for text in reference.environments]
            if reference.changes_spec:
                sides.append(prepare_and_report(base_selection(entry.selection, reference)))
        archive, (plan, *base) = make_bundle(sides)
        return FleetRun(
            name=entry.name,
            folder=Path(entry.folder),
            host=entry.host,
            plan=entry.benchmark.plan,
            job=Job(
                archive,
                "compare" if options.compares else "run",
                plan,
                "".join(base),
                tuple(words),
            ),
        )
