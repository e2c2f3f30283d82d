"""Where the time of a run went: a line for each phase, and what was waited for in it."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Sequence

from rich.table import Table

from r2bspec.measure.units import show
from r2bspec.record.run_record import PhaseTime, RunRecord
from r2bspec.report.output import console
from r2bspec.report.terminal.style import heading, table

_SHOWN_WAITS = 3
_SHORTEST_WAIT_NS = 1_000_000
_ASKED_KINDS = frozenset({"iteration", "confirmation", "sustained"})


def show_phases(record: RunRecord, began_ns: int, ended_ns: int) -> None:
    """Print the table to standard error.

    Args:
        record: of the run.
        began_ns: when the command began (CLOCK_MONOTONIC), later by what it waited for the host.
        ended_ns: when it had written its reports.
    """
    if not record.phases:
        return
    page = console(sys.stderr, color_system=None, width=shutil.get_terminal_size((100, 24)).columns)
    before_ns = record.phases[0].began_ns - began_ns
    after_ns = ended_ns - record.phases[-1].ended_ns
    page.print(heading("time", "of each phase; CPU is that of the controller"))
    page.print(phase_table(record, before_ns, after_ns))


def phase_table(record: RunRecord, before_ns: int = 0, after_ns: int = 0) -> Table:
    """The phases of a run, those of the same name together.

    Args:
        record: of the run.
        before_ns: from the start of the command to the first phase; 0 if unknown.
        after_ns: from the end of the last phase to the end of the reports.
    """
    made = table(["phase", "took", "CPU", ""])
    made.columns[-1].justify = "left"
    made.columns[-1].no_wrap = False
    if before_ns:
        made.add_row("command", _s(before_ns), "", "interpreter, validating, planning")
    for phases in _by_name(record.phases):
        name = phases[0].name if len(phases) == 1 else f"{phases[0].name} ({len(phases)} times)"
        cpu_ns = sum(each.cpu_ns for each in phases)
        made.add_row(name, _s(took_ns(phases)), _s(cpu_ns), waits_text(phases))
    if after_ns:
        made.add_row("report", _s(after_ns), "", "metrics, verdict, reports")
    whole_ns = before_ns + took_ns(record.phases) + after_ns
    asked_ns = asked_playing_ns(record)
    made.add_row("in all", _s(whole_ns), "", "")
    made.add_row("beyond the playing", _s(whole_ns - asked_ns), "", f"of {_s(asked_ns)}")
    return made


def took_ns(phases: Iterable[PhaseTime]) -> int:
    """How long phases took together."""
    return sum(each.took_ns for each in phases)


def asked_playing_ns(record: RunRecord) -> int:
    """How long the iterations and sustained rates of a run were played; a search is not counted."""
    return sum(
        each.ended_ns - each.began_ns
        if not each.rate_hz
        else round(each.steps / each.rate_hz * 1e9)
        for each in record.segments
        if each.kind in _ASKED_KINDS
    )


def waits_text(phases: Sequence[PhaseTime]) -> str:
    """The longest waits of phases: ``relay: ready 0.41 s, endpoints: matched 0.1 s``."""
    found: dict[str, int] = {}
    for wait in (wait for each in phases for wait in each.waits):
        found[wait.what] = found.get(wait.what, 0) + wait.took_ns
    longest = sorted(found.items(), key=lambda each: each[1], reverse=True)[:_SHOWN_WAITS]
    return ", ".join(f"{what} {_s(took)}" for what, took in longest if took >= _SHORTEST_WAIT_NS)


def _by_name(phases: Iterable[PhaseTime]) -> list[list[PhaseTime]]:
    found: dict[str, list[PhaseTime]] = {}
    for each in phases:
        found.setdefault(each.name, []).append(each)
    return list(found.values())


def _s(time_ns: int) -> str:
    return show(time_ns / 1e9, "s", digits=2)
