"""The runs of a suite on a fleet: placed, made there, and their folders fetched."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.cli.main import show_error
from r2bspec.cli.spec_selection import Playing, SuiteEntry, base_selection, prepare_and_report
from r2bspec.compare.base_reference import parse_base_reference
from r2bspec.compare.report_input import read_folder
from r2bspec.diagnostics.plain_text import plain
from r2bspec.diagnostics.quote import pluralize, time_text
from r2bspec.errors import R2bspecError
from r2bspec.fleet.bundle import make_bundle
from r2bspec.fleet.client import EndedRun, Fleet, FleetRun, place
from r2bspec.fleet.host import Job
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.cli.run import RunArguments
    from r2bspec.cli.run_suite import Suite
    from r2bspec.report.suite import SuiteRun


@contextlib.contextmanager
def fleet_executor(suite: Suite, options: RunArguments) -> Iterator[FleetExecutor]:
    """Connect to the fleet of ``--on`` for as long as the context lasts.

    Raises:
        FleetError: it cannot be reached.
    """
    assert options.on is not None  # noqa: S101 - see the caller
    with Fleet(options.on) as fleet:
        yield FleetExecutor(suite, options, fleet)


@dataclass
class FleetExecutor:
    """Makes the runs of a suite on the hosts of a fleet."""

    suite: Suite
    options: RunArguments
    fleet: Fleet

    def place(self, entries: Sequence[SuiteEntry]) -> list[SuiteEntry]:
        """Return an entry for each run: with ``--hosts all`` for each host that fits."""
        hosts = list(self.fleet.hosts.values())
        placed = []
        for entry in entries:
            if entry.prepared is None:
                placed.append(entry)
                continue
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
        """Yield every run when it has ended: first those that need not be made."""
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
        options = self.options
        sides = [entry.benchmark]
        flags = {
            "--smoke": options.smoke,
            "--control": options.control,
            "--force": options.force,
        }
        words = [name for name, is_given in flags.items() if is_given]
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
            job=Job(archive, plan, "".join(base), tuple(words)),
        )
