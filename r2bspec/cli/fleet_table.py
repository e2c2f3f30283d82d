"""What the runs of a fleet do, on standard error: a live table on a terminal, lines elsewhere."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from r2bspec.diagnostics.plain_text import plain
from r2bspec.report.output import console, echo

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live

    from r2bspec.fleet.fleet_runs import RunStatus
    from r2bspec.fleet.hosts import Host

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

    def show(self, rows: Sequence[RunStatus], hosts: Mapping[str, Host]) -> None:
        """What the runs do that have not ended."""
        if not self._quiet and time.monotonic() >= self._next:
            self._next = time.monotonic() + _LINE_S
            playing = [each for each in rows if each.host]
            shown = ", ".join(f"{each.name} on {each.host}" for each in playing[:3])
            more = f" and {len(playing) - 3} more" if len(playing) > 3 else ""
            text = f"{self._done} of {self._total} runs on {len(hosts)} hosts"
            self._write(text + (f"; now {shown}{more}" if shown else ""))

    def _write(self, text: str) -> None:
        echo(plain(text), err=True)


class FleetTable(FleetLines):
    """A table of the runs that are being made: host, state, what is left, p99 so far."""

    def __init__(self, total: int, live: Live) -> None:
        super().__init__(total)
        self._live = live

    def show(self, rows: Sequence[RunStatus], hosts: Mapping[str, Host]) -> None:
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
    rows: Sequence[RunStatus], hosts: Mapping[str, Host], done: int, total: int
) -> RenderableType:
    from rich.text import Text

    from r2bspec.report.terminal_tables import table

    made = table(("benchmark", "host", "state", "left", "p99"))
    made.title = f"{done} of {total} runs, {len(hosts)} hosts"
    ordered = sorted(rows, key=lambda each: not each.host)
    for each in ordered[:_MAX_ROWS]:
        made.add_row(*(Text(plain(cell)) for cell in _cells(each, hosts)))
    if len(ordered) > _MAX_ROWS:
        made.add_row(Text(f"… {len(ordered) - _MAX_ROWS} more"), *[Text("")] * 4)
    return made


def _cells(row: RunStatus, hosts: Mapping[str, Host]) -> tuple[str, ...]:
    from r2bspec.measure.units import show
    from r2bspec.plan.time_estimate import time_text

    host = hosts.get(row.host)
    state = host.state if host is not None else {}
    if state.get("name") != row.name:
        return (row.name, row.host, row.text, "", "")
    left, p99 = state.get("left_s"), state.get("p99_ns")
    return (
        row.name,
        row.host,
        state.get("phase") or row.text,
        time_text(left) if left is not None else "",
        show(p99 / 1e9, "s") if p99 is not None else "",
    )
