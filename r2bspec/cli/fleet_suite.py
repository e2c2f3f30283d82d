"""The runs of a suite on a fleet: placed, made there, and their folders fetched."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from r2bspec.cli.spec_selection import base_selection, prepare_and_report
from r2bspec.cli.suite_entry import SuiteEntry
from r2bspec.errors import R2bspecError

if TYPE_CHECKING:
    from r2bspec.cli.run_options import RunOptions
    from r2bspec.cli.run_suite import Suite
    from r2bspec.fleet.bundle import SentSide
    from r2bspec.fleet.client import FleetClient
    from r2bspec.fleet.fleet_runs import Ended, FleetRun
    from r2bspec.fleet.journal import Journal
    from r2bspec.report.suite_summary import SuiteRun

_JOIN_S: Final = 30.0
"""For so long the first hosts are waited for: workers start with their scheduler."""


@contextlib.contextmanager
def fleet_executor(suite: Suite, root: Path, options: RunOptions) -> Iterator[FleetExecutor]:
    """Connect to the fleet of ``--on`` for as long as the context lasts.

    Raises:
        FleetError: it cannot be reached.
        UsageError: another client runs the suite in this folder.
    """
    from r2bspec.cli.fleet import address_of
    from r2bspec.fleet.client import FleetClient
    from r2bspec.fleet.journal import Journal

    assert options.on is not None  # noqa: S101 - see the caller
    address = address_of(options.on, dict(options.connection))
    with FleetClient(address) as client:
        journal = Journal(root)
        try:
            yield FleetExecutor(suite, root, options, client, journal)
        finally:
            journal.close()


class FleetExecutor:
    """Makes the runs of a suite on the hosts of a fleet."""

    def __init__(
        self,
        suite: Suite,
        root: Path,
        options: RunOptions,
        client: FleetClient,
        journal: Journal,
    ) -> None:
        self._suite = suite
        self._root = root
        self._options = options
        self._client = client
        self._journal = journal
        self._allowed: dict[int, frozenset[str]] = {}
        self._heads: dict[int, SentSide] = {}

    def place(self, entries: Sequence[SuiteEntry]) -> list[SuiteEntry]:
        """An entry for each run: with ``--hosts all`` one on every host that fits."""
        from r2bspec.cli.main import show_error
        from r2bspec.fleet.hosts import place

        self._wait_for_hosts()
        facts = {name: each.facts for name, each in self._client.hosts.items()}
        placed = []
        for entry in entries:
            if entry.prepared is None:
                placed.append(entry)
                continue
            expected = self._journal.hosts if self._options.resume else ()
            for found in place(entry.prepared.plan, facts, self._options.hosts, expected):
                one = replace(entry, host=found.host, error=found.error)
                if found.error is not None:
                    show_error(found.error)
                self._allowed[id(one)] = found.hosts
                placed.append(one)
        return placed

    def _wait_for_hosts(self) -> None:
        """Wait a moment for a first host, or for those that are named."""
        from r2bspec.fleet.hosts import ALL, ANY

        named = set(self._options.hosts) - {ALL, ANY}
        deadline = time.monotonic() + _JOIN_S
        while time.monotonic() < deadline:
            hosts = self._client.hosts
            if named <= set(hosts) if named else hosts:
                return
            time.sleep(0.5)
            self._client.refresh()

    def announce(self, entries: Sequence[SuiteEntry]) -> str:
        """How long the runs will take if no host is lost."""
        from r2bspec.plan.time_estimate import time_text

        alone: dict[str, float] = {}
        for entry in entries:
            alone[entry.host] = alone.get(entry.host, 0.0) + entry.seconds
        hosts = max(len(self._client.hosts), 1)
        total = max(alone.pop("", 0.0) / hosts, *alone.values(), 0.0)
        runs = f"{len(entries)} {'run' if len(entries) == 1 else 'runs'}"
        on = f"{hosts} {'host' if hosts == 1 else 'hosts'}"
        return f"{runs} on {on}: about {time_text(total)}"

    def play(
        self, entries: Sequence[SuiteEntry]
    ) -> Generator[tuple[SuiteEntry, SuiteRun], None, None]:
        """Every run when it has ended: first those that need not be made."""
        from r2bspec.cli.fleet_table import shown_table
        from r2bspec.cli.history import history_file
        from r2bspec.fleet.fleet_runs import FleetHistory, FleetLimits, FleetRuns

        by_folder: dict[Path, SuiteEntry] = {}
        runs: list[FleetRun] = []
        for entry in entries:
            if (settled := self._suite.settled(entry)) is not None:
                yield entry, settled
                continue
            try:
                runs.append(self._fleet_run(entry))
            except R2bspecError as error:
                yield entry, self._suite.failed(entry, error)
                continue
            by_folder[entry.folder] = entry
        history = None
        if self._options.history is not None:
            history = FleetHistory(history_file(self._options.history))
        limits = FleetLimits(
            lost_s=self._options.host_timeout, retry_invalid=self._options.retry_invalid
        )
        with shown_table(len(runs), quiet=self._options.quiet) as table:
            making = FleetRuns(
                self._client, self._root, self._journal, limits, table.note, table.show, history
            )
            with contextlib.closing(making.play(runs)) as playing:
                for ended in playing:
                    entry = by_folder[ended.run.folder]
                    run = self._row(entry, ended)
                    table.ended(entry.name, ended.host, run.outcome)
                    yield entry, run

    def _row(self, entry: SuiteEntry, ended: Ended) -> SuiteRun:
        from r2bspec.cli.main import show_error
        from r2bspec.compare.report_input import read_folder

        try:
            if ended.error is not None:
                raise ended.error
            result = read_folder(entry.folder).result
        except R2bspecError as error:
            show_error(error)
            return self._suite.failed(entry, error, ended.host)
        return self._suite.keep(entry, result, resumed=False, host=ended.host)

    def _fleet_run(self, entry: SuiteEntry) -> FleetRun:
        from r2bspec.fleet.bundle import SentSide
        from r2bspec.fleet.fleet_runs import FleetRun

        prepared = entry.prepared
        assert prepared is not None  # noqa: S101 - others are settled
        fields: dict[str, Any] = {
            "smoke": self._options.smoke,
            "abort_on_fail": self._options.abort_on_fail,
            "record_outputs": self._options.record_outputs,
        }
        base = None
        if self._options.compares:
            base, more = self._base(entry)
            fields |= more
        # One for all hosts: its files are read once.
        head = self._heads.setdefault(
            id(prepared), SentSide(prepared.plan, prepared.base_dir, prepared.spec_text)
        )
        return FleetRun(
            name=entry.name,
            folder=entry.folder,
            head=head,
            base=base,
            hosts=self._allowed[id(entry)],
            options=fields,
        )

    def _base(self, entry: SuiteEntry) -> tuple[Any, dict[str, Any]]:
        """The base of a comparison, if it is another spec, and what the host must know of it."""
        from r2bspec.compare.base_reference import parse_base_reference
        from r2bspec.fleet.bundle import SentSide

        reference = parse_base_reference(self._options.against)
        base = None
        if reference.changes_spec:
            prepared = prepare_and_report(base_selection(entry.item.selection, reference))
            base = SentSide(prepared.plan, prepared.base_dir, prepared.spec_text)
        return base, {
            "compares": True,
            "against": reference.text,
            "environments": reference.environments,
            "pairs": self._options.pairs,
            "control": self._options.control,
            "force": self._options.force,
        }
