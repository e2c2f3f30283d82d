"""The runs of a suite on a fleet: placed, made there, shown, and their folders fetched.

A terminal shows them as a live table, anything else as lines.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from r2bspec.cli.main import show_error
from r2bspec.cli.spec_selection import Playing, SuiteEntry, base_selection, prepare_and_report
from r2bspec.compare.base_tree import parse_base_reference
from r2bspec.compare.report_input import read_folder
from r2bspec.diagnostics.plain_text import plain
from r2bspec.diagnostics.quote import first_words, pluralize, time_text
from r2bspec.errors import R2bspecError
from r2bspec.fleet import fleet_runs
from r2bspec.fleet.client import FleetClient
from r2bspec.fleet.hosts import ALL, ANY, Host, place
from r2bspec.fleet.journal import Journal
from r2bspec.fleet.security import fleet_address
from r2bspec.report.output import console, echo
from r2bspec.report.terminal_tables import table

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live

    from r2bspec.cli.run import RunArguments
    from r2bspec.cli.run_suite import Suite
    from r2bspec.report.suite import SuiteRun


@contextlib.contextmanager
def fleet_executor(suite: Suite, root: Path, options: RunArguments) -> Iterator[FleetExecutor]:
    """Connect to the fleet of ``--on`` for as long as the context lasts.

    Raises:
        FleetError: it cannot be reached.
        UsageError: another client runs the suite in this folder.
    """
    assert options.on is not None  # noqa: S101 - see the caller
    connection = fleet_address(options.on, **options.connection)
    with FleetClient(connection) as client, contextlib.closing(Journal(root)) as journal:
        yield FleetExecutor(suite, root, options, client, journal)


@dataclass
class FleetExecutor:
    """Makes the runs of a suite on the hosts of a fleet."""

    suite: Suite
    root: Path
    options: RunArguments
    client: FleetClient
    journal: Journal

    def place(self, entries: Sequence[SuiteEntry]) -> list[SuiteEntry]:
        """An entry for each run: with ``--hosts all`` one on every host that fits."""
        self.client.wait_for_hosts(set(self.options.hosts) - {ALL, ANY})
        facts = {name: host.facts for name, host in self.client.hosts.items()}
        placed = []
        for entry in entries:
            if entry.prepared is None:
                placed.append(entry)
                continue
            expected = self.journal.hosts if self.options.resume else ()
            for assignment in place(entry.prepared.plan, facts, self.options.hosts, expected):
                if assignment.error is not None:
                    show_error(assignment.error)
                placed.append(replace(entry, **assignment._asdict()))
        return placed

    def announce(self, entries: Sequence[SuiteEntry]) -> str:
        """How long the runs will take if no host is lost."""
        alone: dict[str, float] = {}
        for entry in entries:
            alone[entry.host] = alone.get(entry.host, 0.0) + entry.seconds
        hosts = max(len(self.client.hosts), 1)
        total = max(alone.pop("", 0.0) / hosts, *alone.values(), 0.0)
        runs = f"{pluralize(len(entries), 'run')} on {pluralize(hosts, 'host')}"
        return f"{runs}: about {time_text(total)}"

    def play(self, entries: Sequence[SuiteEntry]) -> Playing:
        """Every run when it has ended: first those that need not be made."""
        by_folder: dict[Path, SuiteEntry] = {}
        runs: list[fleet_runs.FleetRun] = []
        for entry in entries:
            if (settled := self.suite.settled(entry)) is not None:
                yield entry, settled
                continue
            try:
                runs.append(self._fleet_run(entry))
            except R2bspecError as error:
                yield entry, self.suite.failed(entry, error)
                continue
            by_folder[entry.folder] = entry
        limits = fleet_runs.FleetLimits(
            lost_s=self.options.host_timeout, retry_invalid=self.options.retry_invalid
        )
        with shown_table(len(runs), quiet=self.options.quiet) as lines:
            making = fleet_runs.FleetRuns(
                self.client, self.root, self.journal, limits, lines.note, lines.show
            )
            with contextlib.closing(making.play(runs)) as playing:
                for ended in playing:
                    entry = by_folder[ended.run.folder]
                    run = self._row(entry, ended)
                    lines.ended(entry.name, ended.host, run.outcome)
                    yield entry, run

    def _row(self, entry: SuiteEntry, ended: fleet_runs.EndedRun) -> SuiteRun:
        try:
            if ended.error is not None:
                raise ended.error
            result = read_folder(entry.folder).result
        except R2bspecError as error:
            show_error(error)
            return self.suite.failed(entry, error, ended.host)
        return self.suite.keep(entry, result, resumed=False, host=ended.host)

    def _fleet_run(self, entry: SuiteEntry) -> fleet_runs.FleetRun:
        base = None
        fields: dict[str, Any] = {
            "smoke": self.options.smoke,
            "abort_on_fail": self.options.abort_on_fail,
        }
        if self.options.compares:
            reference = parse_base_reference(self.options.against)
            fields |= {
                "compares": True,
                "against": reference.text,
                "environments": reference.environments,
                "pairs": self.options.pairs,
                "control": self.options.control,
                "force": self.options.force,
            }
            if reference.changes_spec:
                base = prepare_and_report(base_selection(entry.selection, reference))
        return fleet_runs.FleetRun(
            name=entry.name,
            folder=entry.folder,
            head=entry.benchmark,
            base=base,
            hosts=entry.hosts,
            options=fields,
        )


_LINE_S: Final = 60.0
_MAX_ROWS: Final = 40
"""More rows than a terminal has are of no use; those that are being made come first."""


class FleetLines:
    """A line for each run that has ended, and one a minute; nothing if it is quiet."""

    def __init__(self, total: int, *, quiet: bool = False) -> None:
        self._total = total
        self._quiet = quiet
        self._done = 0
        self._next = time.monotonic() + _LINE_S

    def note(self, text: str) -> None:
        """Something that the user should know."""
        if not self._quiet:
            self._write(f"  {text}")

    def ended(self, name: str, host: str, outcome: str) -> None:
        """A run has ended."""
        self._done += 1
        if not self._quiet:
            on = f" on {host}" if host else ""
            self._write(f"[{self._done}/{self._total}] {name}{on}: {outcome}")

    def show(self, rows: Sequence[fleet_runs.RunStatus], hosts: Mapping[str, Host]) -> None:
        """What the runs do that have not ended."""
        if not self._quiet and time.monotonic() >= self._next:
            self._next = time.monotonic() + _LINE_S
            playing = [row for row in rows if row.host]
            shown = first_words([f"{entry.name} on {entry.host}" for entry in playing], 3)
            text = f"{self._done} of {self._total} runs on {len(hosts)} hosts"
            self._write(text + (f"; now {shown}" if shown else ""))

    def _write(self, text: str) -> None:
        echo(plain(text), err=True)


class FleetTable(FleetLines):
    """A table of the runs that are being made: host, state, what is left, p99 so far."""

    def __init__(self, total: int, live: Live) -> None:
        super().__init__(total)
        self._live = live

    def show(self, rows: Sequence[fleet_runs.RunStatus], hosts: Mapping[str, Host]) -> None:
        """Draw the table again."""
        self._live.update(_table(rows, hosts, self._done, self._total))

    def _write(self, text: str) -> None:
        self._live.console.print(plain(text), highlight=False, markup=False)


@contextlib.contextmanager
def shown_table(total: int, *, quiet: bool = False) -> Iterator[FleetLines]:
    """What shows the runs of a fleet, for as long as the context lasts."""
    if quiet or os.environ.get("CI") or not sys.stderr.isatty():
        yield FleetLines(total, quiet=quiet)
        return
    from rich.live import Live

    with Live(console=console(sys.stderr), refresh_per_second=2, transient=True) as live:
        yield FleetTable(total, live)


def _table(
    rows: Sequence[fleet_runs.RunStatus], hosts: Mapping[str, Host], done: int, total: int
) -> RenderableType:
    from rich.text import Text

    made = table(("benchmark", "host", "state", "left", "p99"))
    made.title = f"{done} of {total} runs, {len(hosts)} hosts"
    ordered = sorted(rows, key=lambda each: not each.host)
    for row in ordered[:_MAX_ROWS]:
        made.add_row(*(Text(plain(cell)) for cell in _row_cells(row, hosts)))
    if len(ordered) > _MAX_ROWS:
        made.add_row(Text(f"… {len(ordered) - _MAX_ROWS} more"), *[Text("")] * 4)
    return made


def _row_cells(row: fleet_runs.RunStatus, hosts: Mapping[str, Host]) -> tuple[str, ...]:
    host = hosts.get(row.host)
    if host is None or host.state.name != row.name:
        return (row.name, row.host, row.text, "", "")
    return (row.name, row.host, host.state.phase or row.text, *host.figures)
