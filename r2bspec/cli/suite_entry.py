"""One run of a suite: prepared, or with the error that prevents it."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from r2bspec.cli.run_selection import RunItem
from r2bspec.errors import R2bspecError

if TYPE_CHECKING:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.plan.time_estimate import TimeEstimate
    from r2bspec.report.suite_summary import SuiteRun


@dataclass
class SuiteEntry:
    """One run of the suite.

    Attributes:
        host: of a fleet, if the run is made on that host; empty if any may make it, and here.
        folder: of the run.
    """

    item: RunItem
    name: str
    prepared: PreparedBenchmark | None = None
    error: R2bspecError | None = None
    estimate: TimeEstimate | None = None
    folder: Path = field(default_factory=Path)
    host: str = ""

    @property
    def seconds(self) -> float:
        """The expected time of the run."""
        return self.estimate.seconds if self.estimate is not None else 0.0


class Executor(Protocol):
    """Makes the runs of a suite: on this host, or on others."""

    def place(self, entries: Sequence[SuiteEntry]) -> list[SuiteEntry]:
        """The entries, one for each run: an entry may be run on several hosts."""

    def announce(self, entries: Sequence[SuiteEntry]) -> str:
        """How long the runs will take, in words."""

    def play(
        self, entries: Sequence[SuiteEntry]
    ) -> Generator[tuple[SuiteEntry, SuiteRun], None, None]:
        """Every run when it has ended; closing the iterator ends the suite."""
